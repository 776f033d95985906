// Displacement fields of the stereo phantom against the truth.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>

#include "cortshift_stereo_phantom/phantom_scene.hpp"
#include "cortshift_tracking/field/displacement_field.hpp"

namespace cortshift_tracking_phantom {

/// How wrong one vector is.
struct VectorError {
  bool foreign = false;  ///< it starts on no tissue (a retractor) or its tissue is gone: no displacement is right
  double length = 0;     ///< of true displacement less measured [m]; 0 where foreign, as the following
  double in_plane = 0;   ///< its part in the plane of the projection [m]
  double height = 0;     ///< and the one along its normal [m], 0 or more

  /// As the confidence means it: not foreign, in_plane and height at most kRightWithin.
  bool right() const;
};

/// Nothing where the field has no vector or it starts outside the craniotomy.
std::optional<VectorError> errorAt(const cortshift_tracking::DisplacementField& field,
                                   const cortshift_stereo_phantom::PhantomScene& scene, int from, int to, int row,
                                   int column);

/// Whether vectors of some confidence are right as often as it says.
struct Reliability {
  struct Bin {
    double confidence = 0;  ///< sum over the vectors
    std::size_t vectors = 0, right = 0;
  };
  std::array<Bin, 10> bins;  ///< of equal width over 0...1

  void add(double confidence, bool right);
  Reliability& operator+=(const Reliability& other);
};

/// 3D errors |d - true d| of the reported vectors that start inside the craniotomy. NaN where none was reported.
struct FieldError {
  double median = 0;    ///< [m]
  double p95 = 0;       ///< 95th percentile [m]
  double largest = 0;   ///< [m]
  double coverage = 0;  ///< reported part of the craniotomy that both cameras see as brain at both stages, 0...1
  std::size_t compared_points = 0;
  std::size_t foreign_points = 0;  ///< reported vectors that start on no tissue (a retractor) or whose tissue is gone
  double over_uncertainty = 0;     ///< root mean square of error / uncertainty, where the field has one
  Reliability reliability;
};

/// @param stride every how many grid points, in either direction, a vector is compared
FieldError compareWithTruth(const cortshift_tracking::DisplacementField& field,
                            const cortshift_stereo_phantom::PhantomScene& scene, int from, int to, int stride = 3);

/// A proposed outline of the brain, and the mean displacement within it, against the truth.
struct OutlineError {
  bool known = false;
  double intersection_over_union = 0;  ///< of the brain in view, with blood on it, without cotton; 0...1
  double mean_ratio = 0;               ///< mean length of the field's vectors within the outline over the true brain's
};

/// @param shown CV_8UC1 255 where the earlier stage's projection shows something (Projection::mask)
/// @param height CV_32FC1 of that projection [m]
OutlineError compareOutline(const cortshift_tracking::DisplacementField& field, const cv::Mat& shown,
                            const cv::Mat& height, const cortshift_stereo_phantom::PhantomScene& scene, int from,
                            int stride = 2);

/// `name: value` lines, lengths in millimetres.
std::string toText(const FieldError& error);

}  // namespace cortshift_tracking_phantom
