// What a lens does to rays, and back: OpenCV's own models, each chosen here and nowhere else.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "cortshift_stereo/geometry/camera_model.hpp"

namespace cortshift_stereo {

/// As in camera_info: plumb_bob, rational_polynomial or equidistant.
std::string nameOf(LensModel lens);

/// "k1 k2 p1 p2 k3" and the like.
std::string termsOf(LensModel lens);

/// @param where  what the message begins with, such as a file
/// @throws CalibrationError listing the three models for any other name
LensModel lensNamed(const std::string& name, const std::string& where);

/// The coefficients in the number that belongs to the model (5, 8 or 4): missing k3 of plumb_bob and zeros behind what
/// the model has (OpenCV writes 12 or 14 numbers) are made up for.
/// @param where  what the message begins with, such as a file and its key
/// @throws CalibrationError for another number; 12 and 14 that are not zero by their names: thin prism, tilted sensor
std::vector<double> checkedCoefficients(LensModel lens, std::vector<double> D, const std::string& where);

/// Raw pixels of points.
/// @param points         [m]
/// @param turn, shift    rotation vector and translation [m] of the points' frame in the camera
std::vector<cv::Point2d> projectPoints(const CameraModel& camera, const std::vector<cv::Point3d>& points,
                                       const cv::Vec3d& turn, const cv::Vec3d& shift);

/// Directions (x, y, 1) in the raw camera frame that raw pixels look along.
std::vector<cv::Point2d> directionsOf(const CameraModel& camera, const std::vector<cv::Point2d>& pixels);

/// Where raw pixels lie in the rectified image [px].
std::vector<cv::Point2d> rectifyPoints(const CameraModel& camera, const std::vector<cv::Point2d>& pixels);

/// CV_32FC2: for each pixel of the rectified image its place in the raw one [px].
cv::Mat rectifyingMap(const CameraModel& camera);

}  // namespace cortshift_stereo
