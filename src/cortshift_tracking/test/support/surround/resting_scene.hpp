// Displacement fields put together by numbers: brain in a craniotomy with dura, bone and drape around it, each moved as
// a test says. No picture is rendered and nothing is matched, so that hundreds take a second.
#pragma once

#include <Eigen/Geometry>
#include <functional>
#include <opencv2/core.hpp>
#include <string>

#include "cortshift_tracking/field/displacement_field.hpp"

namespace cortshift_tracking {

/// 80 x 60 mm at 0.4 mm; x, y [m] from the middle of the view. Somewhere in pmr, as a craniotomy on the left is.
struct RestingScene {
  enum Matter { kBrain, kDura, kBone, kDrape, kCotton, kNothing };

  double radius_x = 0.028, radius_y = 0.022;  ///< of the brain [m]
  double bone = 0.0085;                       ///< width of dura and bone around it [m]
  double sag = 0.005;                         ///< of the brain's middle along -z of the frame [m]
  double noise = 0.00004;                     ///< standard deviation of a coordinate, smooth over 2 mm [m]
  unsigned seed = 1;
  std::function<Matter(double x, double y, Matter)> cover;              ///< changes what is seen somewhere
  std::function<Eigen::Vector3d(double x, double y, Matter)> movement;  ///< added to what the brain does [frame, m]

  /// @param drift  where tracking sees a point p of the later surface: drift * p
  DisplacementField seen(const Eigen::Isometry3d& drift = Eigen::Isometry3d::Identity()) const;

  /// The displacement without drift and noise, NaN where there is none.
  cv::Mat truth() const;

  /// CV_8UC1 255 on the brain.
  cv::Mat brain() const;

  static Eigen::Vector3d middle_pmr();

  /// By `translation` [m] and `rotation` [rad] about the middle of the view, in directions given by `seed`.
  static Eigen::Isometry3d drift(unsigned seed, double translation, double rotation);

 private:
  Matter matterAt(double x, double y) const;
  DisplacementField made(const Eigen::Isometry3d& drift, double noise) const;
};

struct ErrorsAgainst {
  double median = 0, p95 = 0, rms = 0;  ///< [m] of |d - true d| over the brain
};

ErrorsAgainst errorsOnBrain(const cv::Mat& displacements, const RestingScene& scene);

}  // namespace cortshift_tracking
