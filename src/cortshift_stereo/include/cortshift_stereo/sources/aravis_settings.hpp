// Two GigE Vision or USB3 Vision cameras as the source aravis drives them. Knows neither ROS nor Aravis.
#pragma once

#include <string>
#include <vector>

namespace cortshift_stereo {

/// Each default once.
struct AravisCameraSettings {
  std::string device;                 ///< address, serial number or Aravis' device id; must be given
  std::string trigger_source;         ///< "": free running; Software; or a line such as Line1 that fires the camera
  std::vector<std::string> features;  ///< GenICam features set last, as NAME=VALUE in this order (digital I/O, ...)
};

/// What both cameras have in common: they must see alike.
struct AravisSettings {
  AravisCameraSettings left, right;
  std::string pixel_format = "BayerRG8";
  double exposure = 0.01;        ///< [s]
  double gain = 0;               ///< in the camera's own unit, mostly dB
  double frame_rate = 10;        ///< free running [Hz]
  double sync_tolerance = 0.01;  ///< largest difference of the two exposures of a pair [s]
  double timeout = 1;            ///< longest wait for a pair [s]
  double transfer_delay = 0;     ///< time of the fastest transfer, taken off every stamp [s]
  int packet_size = 0;           ///< GigE Vision, bytes; 0: negotiated
  bool packet_socket = true;     ///< GigE Vision: receive by a packet socket where the system permits
  double frame_retention = 0.2;  ///< GigE Vision: how long an image may wait for its missing packets [s]
  double reconnect_min = 0.2;    ///< first wait before connecting again [s]; doubles ...
  double reconnect_max = 1;      ///< ... up to this

  /// @throws std::invalid_argument naming setting, value and what is allowed
  void validate() const;
};

}  // namespace cortshift_stereo
