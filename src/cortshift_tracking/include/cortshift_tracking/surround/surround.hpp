// What does not move tells where tracking was wrong: bone around the craniotomy is fixed to the clamp that the
// reference frame hangs on, so that the rigid motion that it seems to make is the difference of two poses' errors.
#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cortshift_tracking/field/displacement_field.hpp"
#include "cortshift_tracking/field/exclusion.hpp"
#include "cortshift_tracking/surround/pose_uncertainty.hpp"

namespace cortshift_tracking {

enum class SurroundMode { kOff, kCheck, kCorrect };

/// What the fields that undo zoom and focus leave, at every setting but the reference.
struct SettingsError {
  double magnification = 1, focal_length = 0;  ///< of the reference [m]
  double disparity_sd = 0;                     ///< of 1 / depth [1/m]

  /// Whether a setting is another one; NaN: the reference.
  bool counts(double at_magnification, double at_focal_length) const;
};

struct SurroundSettings {
  SurroundMode mode = SurroundMode::kCorrect;
  double pose_translation_sd = 0.00025;      ///< of one pose where nothing better is known [m], 0 ... 0.01
  double pose_rotation_sd = 0.0017;          ///< the same [rad], 0 ... 0.1
  double pose_latency_sd = 0.01;             ///< of the pose's stamp against the exposure [s], 0 ... 1
  std::vector<PoseErrorSource> calibration;  ///< what every pose of a camera is off by in common, of calibration files
  std::vector<DepthErrorSource> depths;      ///< what all depths are off by in common, of calibration files
  std::optional<SettingsError> zoom;         ///< what other settings of the microscope add; empty: not known

  /// @throws TrackingError naming the setting, its value and the allowed range.
  void validate() const;
};

/// What a pair of stages is known to be besides its surfaces.
struct PairKnowledge {
  std::optional<PlacedCamera> earlier, later;  ///< empty: the cameras' poses are not known
  std::vector<Region> brain;  ///< as drawn by hand on the earlier stage, in its projection frame; empty: not drawn
  double baseline = 0.025;    ///< of the stereo head [m]; that of surgical microscopes where none is known
};

enum class SurroundFinding {
  kOff,       ///< nobody asked
  kUnseen,    ///< no bone in view, or too little
  kUnclear,   ///< refused as evidence: it contradicts itself, or says too little
  kAgrees,    ///< tracking and surround agree
  kDisagrees  ///< they do not: `motion` is what they disagree by
};

struct Surround {
  SurroundFinding finding = SurroundFinding::kOff;
  bool corrected = false;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< [pmr, m] of the field
  Vector6 motion = Vector6::Zero();  ///< about the centre; of the surround as tracked, where it was fitted
  Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();  ///< the same: as tracked = transform * as it is
  Matrix6 tracking = Matrix6::Zero();    ///< covariance that tracking alone leaves, about the centre
  Matrix6 covariance = Matrix6::Zero();  ///< what is left of it in the field
  double area = 0;                       ///< of the surround that was used [m^2]
  std::vector<PoseErrorShare> sources;   ///< what `tracking` is made of
  double size = 0;                       ///< root mean square length of the motion over the field [m]
  std::string text;                      ///< for people: what was found and done
  std::vector<std::string> warnings;     ///< what a person should know before believing the field
};

/// Judges a field. Nothing of it is changed.
/// @param opening CV_8UC1 255 on the brain and what lies on it; empty: nothing lies on it
Surround assessSurround(const DisplacementField& field, const PairKnowledge& knowledge,
                        const SurroundSettings& settings = {}, const cv::Mat& opening = {});

/// Takes the motion out: what was at `transform` * p ends at p. `starts_pmr` and `displacements_pmr` are CV_32FC3 [m].
void takeOut(const Eigen::Isometry3d& transform, const cv::Mat& starts_pmr, cv::Mat& displacements_pmr);

}  // namespace cortshift_tracking
