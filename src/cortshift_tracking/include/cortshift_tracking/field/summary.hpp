// A displacement field in numbers (Ji et al. 2014, section 2.7.2 and Table 3).
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "cortshift_tracking/field/displacement_field.hpp"

namespace cortshift_tracking {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

/// Mean and standard deviation (of a sample, n - 1); NaN where there is nothing to average.
struct Statistic {
  double mean = kUnknown;
  double sd = kUnknown;
};

/// The rigid motion that was taken out of a field.
struct Correction {
  Eigen::Isometry3d transform_pmr;         ///< end point as tracked = transform * end point now
  Eigen::Matrix<double, 6, 6> covariance;  ///< of (x, y, z [m], rotation about x, y, z [rad]) about pmr's origin
};

/// One source of what a vector may be off by.
struct ErrorShare {
  std::string source, known_from;  ///< for people
  double sd = kUnknown;            ///< root mean square length at the centre of the brain, or of the field [m]
};

/// A set of vectors in numbers.
struct Means {
  std::size_t points = 0;
  Statistic magnitude, gravity, normal, lateral;  ///< as in Summary
};

/// Lengths in metres, angles in radians. NaN: not known.
struct Summary {
  std::size_t valid_points = 0;
  double overlap = 0;                      ///< 0...1, see overlapOf
  Statistic magnitude;                     ///< |d|
  Statistic gravity;                       ///< along gravity, positive: with it
  Statistic normal;                        ///< along the first stage's average normal, positive: bulging
  Statistic lateral;                       ///< |d perpendicular to that normal|
  double gravity_normal_angle = kUnknown;  ///< [rad]
  Means brain;                             ///< over the exposed brain alone; NaN where its outline is not known
  std::string outline;                     ///< where the outline is from, or why it is not known
  double common_sd = kUnknown;             ///< of the uncertainty, what all vectors have in common [m]
  std::vector<ErrorShare> budget;          ///< what the uncertainty is made of
  std::string surround;                    ///< what was found in what does not move, and done, in words
  std::optional<Correction> correction;    ///< what was taken out
  double projection_seconds = 0;           ///< wall time
  double flow_seconds = 0;
  double inversion_seconds = 0;       ///< with the assessment of trust
  std::vector<std::string> warnings;  ///< what a person should know before believing it
  std::string configuration;          ///< hash of the parameters it was computed with; empty: not known

  double compute_seconds() const { return projection_seconds + flow_seconds + inversion_seconds; }
};

/// @param first_normal_pmr average normal of the case's first stage, unit length
/// @param gravity_pmr direction of gravity, unit length, if known
Summary summarise(const DisplacementField& field, double overlap, const Eigen::Vector3d& first_normal_pmr,
                  const std::optional<Eigen::Vector3d>& gravity_pmr);

/// What was found, as one line for people: millimetres, degrees.
std::string describe(const Summary& summary);

/// The same and how long it took [s].
std::string toText(const Summary& summary);

}  // namespace cortshift_tracking
