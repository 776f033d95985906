// poses.csv: where the tracker saw the microscope when each image was taken.
#pragma once

#include <opencv2/core/affine.hpp>
#include <string>
#include <vector>

#include "cortshift_stereo/geometry/camera_model.hpp"

namespace cortshift_stereo {

/// One row.
struct TrackedPose {
  std::string image;                    ///< file name
  cv::Affine3d T_reference_microscope;  ///< [m]
};

/// Read a table with the header `image,x,y,z,qx,qy,qz,qw`: file name, position of the microscope in the reference frame
/// [m], unit quaternion of its rotation.
/// As spreadsheets and people write it: with the mark of UTF-8, blanks around and quotation marks about cells, empty
/// cells at the end of a line, lines ended by CR; columns separated by commas, or by semicolons or tabs, where the
/// numbers may have decimal commas.
/// @throws CalibrationError naming file and line: another header, a missing or stray column, a value that is not a
///         number, a quaternion that is not of unit length, a position beyond 10 m (millimetres?), or an image twice.
std::vector<TrackedPose> readPoseTable(const std::string& path);

}  // namespace cortshift_stereo
