// ROS messages to core types and back. Everything that crosses the border passes here and is checked here.
#pragma once

#include <geometry_msgs/Pose.h>
#include <geometry_msgs/Transform.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/Header.h>
#include <stereo_msgs/DisparityImage.h>

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <stdexcept>

#include "cortshift_stereo/geometry/camera_model.hpp"
#include "cortshift_stereo/geometry/surface.hpp"

namespace cortshift_stereo {

/// A message that does not keep the contract. The text names the field, what is wrong and the remedy.
class MessageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Organised cloud: float32 x y z [m], packed rgb (alpha 0, so that it is never a float NaN), confidence.
/// @param header  frame of the points and stamp of the pair
sensor_msgs::PointCloud2 toPointCloud2(const Surface& surface, const std_msgs::Header& header);

/// Any organised little-endian cloud with x y z (float32 or float64) and rgb or rgba, in any order and stride.
/// Without a `confidence` field each valid point has confidence 1.
/// @throws MessageError
Surface surfaceFromPointCloud2(const sensor_msgs::PointCloud2& cloud);

/// Whether that can be read, without doing it. @throws MessageError as above
void requireSurface(const sensor_msgs::PointCloud2& cloud);

/// @throws CalibrationError for an uncalibrated camera, binning, a region of interest, a distortion model that is none
///         of LensModel, or another number of coefficients than it has
CameraModel cameraModelFromInfo(const sensor_msgs::CameraInfo& info);

/// Validated pair. @throws CalibrationError
StereoModel stereoModelFromInfo(const sensor_msgs::CameraInfo& left, const sensor_msgs::CameraInfo& right);

sensor_msgs::CameraInfo toCameraInfo(const CameraModel& camera, const std_msgs::Header& header);

/// Pixels as blue green red, CV_8UC3 or CV_16UC3 as the message has them (BitDepth brings pairs of 16 bits to 8); mono,
/// RGB, Bayer are converted. @throws MessageError naming encoding, size, or bytes not in the order is_bigendian says
cv::Mat bgrFromImage(const sensor_msgs::Image& image);

/// The same from png or jpeg data. @throws MessageError if the data cannot be decoded or ask for rotated pixels
cv::Mat bgrFromImage(const sensor_msgs::CompressedImage& image);

/// @param disparity  CV_32FC1 x_left - x_right [px], NaN where invalid
/// @param search_range  [px] lowest and highest disparity that was searched
/// The message holds disparities without the difference of the principal points, so that its Z = f T / d holds
/// for verging cameras too.
stereo_msgs::DisparityImage toDisparityImage(const cv::Mat& disparity, const StereoModel& model,
                                             const cv::Range& search_range, const std_msgs::Header& header);

/// @throws MessageError unless finite with a unit quaternion (within 0.1 %)
Eigen::Isometry3d isometryFromMessage(const geometry_msgs::Pose& pose);
Eigen::Isometry3d isometryFromMessage(const geometry_msgs::Transform& transform);

/// @throws MessageError unless finite with a rotation that is orthonormal
geometry_msgs::Pose toPose(const Eigen::Isometry3d& T);
geometry_msgs::Transform toTransform(const Eigen::Isometry3d& T);

}  // namespace cortshift_stereo
