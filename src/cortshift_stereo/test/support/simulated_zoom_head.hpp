// A stereo microscope whose intrinsics, distortion and, if wanted, entrance pupils change with its two settings.
#pragma once

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/affine.hpp>
#include <random>
#include <vector>

#include "cortshift_stereo/calibration/settings/settings_calibration.hpp"
#include "cortshift_stereo/calibration/stereo/stereo_calibration.hpp"

namespace cortshift_stereo {

enum class Side { kLeft, kRight };

struct SimulatedZoomHead {
  cv::Size size{1024, 768};
  MicroscopeSetting reference{1.0, 0.3};
  double pupil_travel = 0;       ///< of both entrance pupils from the lowest to the highest magnification [m]
  bool travel_together = false;  ///< along the axis midway, the baseline unchanged; otherwise each along its own axis

  static constexpr double kWorkingDistance = 0.3;  // [m]
  static constexpr double kBaseline = 0.025;       // [m]

  /// Pose of the camera in the left camera at the reference setting.
  cv::Affine3d cameraPose(Side side, const MicroscopeSetting& setting) const {
    const double verging = 2 * std::atan(kBaseline / 2 / kWorkingDistance);
    cv::Affine3d pose = cv::Affine3d::Identity();
    if (side == Side::kRight)
      pose = cv::Affine3d(cv::Vec3d(0, -verging, 0), cv::Vec3d(kWorkingDistance * std::sin(verging), 0.0004,
                                                               kWorkingDistance * (1 - std::cos(verging))));
    const double along = pupil_travel * ((setting.magnification - reference.magnification) / 0.7 +
                                         0.4 * (setting.focal_length - reference.focal_length) / 0.1);
    const double inward = !travel_together ? 0 : (side == Side::kLeft ? 0.5 : -0.5) * verging;
    return pose * cv::Affine3d(cv::Vec3d(0, 0, 0), along * cv::Vec3d(std::sin(inward), 0, std::cos(inward)));
  }

  cv::Matx33d K(Side side, const MicroscopeSetting& setting) const {
    const double sign = side == Side::kLeft ? 1 : -1;
    const double m = setting.magnification, f = setting.focal_length / reference.focal_length;
    const double focal = 3600 * m * std::pow(f, -0.8) * (1 + 0.03 * (m - 1) * (m - 1) + 0.02 * (m - 1) * (f - 1));
    return {focal * (1 + 0.002 * sign),
            0,
            512 + sign * 9 + 12 * sign * (m - 1) + 20 * (f - 1),
            0,
            focal,
            384 - 5 + 7 * std::log(m) - 9 * sign * (f - 1),
            0,
            0,
            1};
  }

  /// A few pixels at the image's corner, from barrel to pincushion with zoom.
  std::vector<double> D(Side side, const MicroscopeSetting& setting) const {
    const double sign = side == Side::kLeft ? 1 : -1;
    const double m = setting.magnification, f = setting.focal_length / reference.focal_length;
    return {-0.35 + 0.5 * (m - 1) - 0.3 * (f - 1), 0.4 * m, 0.0008 * sign, -0.0005 * (m - 1), 0};
  }

  std::vector<cv::Point2d> project(Side side, const MicroscopeSetting& setting,
                                   const std::vector<cv::Point3d>& points_left) const {
    const cv::Affine3d T_camera_left = cameraPose(side, setting).inv();
    std::vector<cv::Point2d> pixels;
    cv::projectPoints(points_left, T_camera_left.rvec(), T_camera_left.translation(), K(side, setting),
                      D(side, setting), pixels);
    return pixels;
  }

  /// What calibrate_stereo would find at the reference setting.
  StereoModel referenceModel() const {
    const cv::Affine3d T_right_left = cameraPose(Side::kRight, reference).inv();
    return rectify({size, K(Side::kLeft, reference), K(Side::kRight, reference), LensModel::kPlumbBob,
                    D(Side::kLeft, reference), D(Side::kRight, reference), T_right_left.rotation(),
                    T_right_left.translation()});
  }
};

/// Corners of a board in the left camera, a little tilted, its middle at the working distance.
inline std::vector<cv::Point3d> boardInLeft(const Board& board) {
  const cv::Affine3d tilt(cv::Vec3d(0.06, -0.04, 0.03));
  const cv::Point3d middle((board.corners.width - 1) * board.square / 2, (board.corners.height - 1) * board.square / 2,
                           0);
  std::vector<cv::Point3d> points;
  for (const auto& corner : board.points())
    points.push_back(tilt * (corner - middle) + cv::Point3d(0, 0, SimulatedZoomHead::kWorkingDistance));
  return points;
}

}  // namespace cortshift_stereo
