// The film of water on the brain: its ripples and what they mirror.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include "cortshift_stereo_phantom/phantom_case.hpp"

namespace cortshift_stereo_phantom {

class RippledFilm {
 public:
  explicit RippledFilm(const FilmSettings& settings);

  /// Slope of the ripples along material x and y at a material point [m].
  Eigen::Vector2d slope(double x, double y) const;

  /// Light of the mirrored lamp, of full scale. All of unit length: the film's normal, directions to the lamp and to
  /// the eye.
  double mirrored(const Eigen::Vector3d& normal, const Eigen::Vector3d& to_lamp, const Eigen::Vector3d& to_eye) const;

 private:
  FilmSettings settings_;
  cv::Mat_<cv::Vec2f> slopes_;  // on a grid, as many sines for every ray would be slow
};

}  // namespace cortshift_stereo_phantom
