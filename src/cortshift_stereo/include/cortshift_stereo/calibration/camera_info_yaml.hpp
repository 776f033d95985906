// The YAML files of ROS's camera_info (the layout of camera_calibration_parsers), without ROS.
#pragma once

#include <string>

#include "cortshift_stereo/geometry/camera_model.hpp"

namespace cortshift_stereo {

/// One camera as its file has it.
struct NamedCamera {
  std::string name;  ///< camera_name
  CameraModel model;
};

/// Read one camera. Matrices and coefficients may also be flat lists or lists of rows, and the keys those of the
/// message (width, height, K, D, R, P), as `rostopic echo` writes them.
/// @throws CalibrationError naming the file, what is wrong in it and the remedy: no such file, not YAML, a key missing,
///         a matrix of another shape, a number that is not finite, a distortion model that is none
///         of LensModel or has another number of coefficients, binning or a region of interest.
NamedCamera readCameraInfoYaml(const std::string& path);

/// Read both cameras of one calibration and check that they can be true (StereoModel::validate).
/// @throws CalibrationError as above, naming both files where they do not belong together.
StereoModel readStereoModelYaml(const std::string& left_path, const std::string& right_path);

/// Write one camera so that every number reads back exactly.
/// @param remarks  lines for people (date, board, errors), written as comments at the top; may be empty
/// @throws CalibrationError if the file cannot be written.
void writeCameraInfoYaml(const std::string& path, const NamedCamera& camera, const std::string& remarks = {});

}  // namespace cortshift_stereo
