// What stereo_driver has to know of real cameras and recorded images.
#pragma once

#include <string>
#include <vector>

#include "cortshift_stereo/sources/aravis_settings.hpp"

namespace cortshift_stereo {

class ParameterReader;

/// Parameters of the sources aravis and folder, each default once.
struct LiveParameters {
  std::string calibration_left;   ///< camera_info YAML; must be given
  std::string calibration_right;  ///< must be given
  std::string hand_eye;           ///< hand_eye.yaml; empty: microscope -> left_optical is published elsewhere
  double max_pose_gap = 0.1;      ///< farthest tracker sample on either side of an exposure [s]

  AravisSettings aravis;

  std::string folder;  ///< of images: names that hold "left" and "right" and are otherwise alike
  bool loop = false;   ///< begin again after the folder's last pair
  int image_bits = 0;  ///< that the folder's 16-bit images use, 8 to 16; 0: recognised from the values

  /// Declares every parameter to the reader.
  void read(ParameterReader& reader);

  /// @throws ParameterError if what this source needs is not there
  void require(const std::string& source, const std::string& name_space) const;
};

}  // namespace cortshift_stereo
