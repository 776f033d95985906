// One GigE Vision or USB3 Vision camera through Aravis: configured, watched and connected again when it is lost.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "cortshift_stereo/sources/aravis_settings.hpp"
#include "cortshift_stereo/sources/stereo_source.hpp"

namespace cortshift_stereo {

/// One image, or the knowledge that it did not arrive whole.
struct CameraFrame {
  std::uint64_t id = 0;
  Stamp stamp{};  ///< middle of the exposure, host time
  cv::Mat image;  ///< CV_8UC3 blue green red; empty: incomplete
};

struct CameraState {
  bool connected = false;
  int connections = 0;  ///< so far
  std::string fault;    ///< why it is not connected
  std::uint64_t frames = 0, incomplete = 0;
  double clock_drift = 0;         ///< of our clock against the camera's [s/s]
  int clock_jumps = 0;            ///< of the camera's clock, so far
  double last_clock_jump = 0;     ///< [s]
  double exposure = 0, gain = 0;  ///< as the camera reports them
};

class AravisCamera {
 public:
  /// @param on_frame  called from the camera's own thread
  AravisCamera(const std::string& name, const AravisCameraSettings& camera, const AravisSettings& common,
               std::function<void(CameraFrame)> on_frame);
  ~AravisCamera();
  AravisCamera(const AravisCamera&) = delete;
  AravisCamera& operator=(const AravisCamera&) = delete;

  /// @throws SourceError; the camera is then connected anew
  void softwareTrigger();

  /// Gives the connection up and makes a new one.
  void reconnect(const std::string& reason);

  CameraState state() const;

 private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace cortshift_stereo
