// From two surfaces to the displacement between them: the steps of Ji et al. 2014, section 2.5, in their order.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "cortshift_stereo/geometry/surface.hpp"
#include "cortshift_tracking/field/displacement_field.hpp"
#include "cortshift_tracking/field/exclusion.hpp"
#include "cortshift_tracking/field/inversion.hpp"
#include "cortshift_tracking/field/strain.hpp"
#include "cortshift_tracking/field/summary.hpp"
#include "cortshift_tracking/matching/image_matching.hpp"
#include "cortshift_tracking/projection/projection.hpp"
#include "cortshift_tracking/projection/projection_frame.hpp"
#include "cortshift_tracking/surround/outline.hpp"
#include "cortshift_tracking/surround/surround.hpp"
#include "cortshift_tracking/trust/trust.hpp"

namespace cortshift_tracking {

struct ShiftSettings {
  FrameSettings frame;
  ProjectionSettings projection;
  ImageMatchingSettings matching;
  TrustSettings trust;
  InversionSettings inversion;
  SurroundSettings surround;
  bool with_own_points = false;  ///< fills the result's own points
  bool with_strain = false;      ///< fills the field's strains
  bool with_evidence = false;    ///< fills the result's evidence
  StrainSettings strain;
  std::string configuration;  ///< hash of all parameters in force, for the summary; empty: not known

  /// @throws TrackingError naming the setting, its value and the allowed range.
  void validate() const;
  void setThreads(int threads);
};

/// What the field is measured against.
struct Directions {
  Eigen::Vector3d first_normal_pmr;            ///< average normal of the case's first stage, unit length
  std::optional<Eigen::Vector3d> gravity_pmr;  ///< unit length; empty: not known
};

struct ShiftResult {
  DisplacementField field;
  Summary summary;
  Projection earlier;
  Projection later;
  cv::Mat flow;  ///< CV_32FC2 [grid units]

  /// The earlier surface's own points and their displacements, see displacementsOfPoints; empty if not asked for.
  cv::Mat own_points_pmr, own_displacements_pmr;  ///< CV_32FC3 [m], NaN where there is none

  VectorEvidence evidence;  ///< what `confidence` was made from; empty if not asked for
};

/// The earlier surface made ready; serves for any number of later ones.
struct Reference {
  cv::Mat points_pmr;  ///< CV_32FC3 of the surface [m]
  ProjectionFrame frame;
  Projection projection;
  cv::Mat usable;    ///< CV_8UC1, see usableMask; without the excluded regions
  cv::Mat excluded;  ///< CV_8UC1 255: excluded by hand
  Outline outline;   ///< of the brain, as proposed
  double seconds = 0;
};

/// @param excluded regions of the surface's own projection frame that take no part
/// @throws TrackingError if the surface is unusable or a region is not one
Reference prepareReference(const cortshift_stereo::Surface& earlier_pmr, const ShiftSettings& settings = {},
                           const std::vector<Region>& excluded = {});

/// Displacement field from a prepared earlier surface to a later one. `projection_seconds` counts the later one only.
/// @param prediction of the flow, for instance from the moment before (see predictionOf), or empty
/// @param knowledge of both stages beside their surfaces. Where what does not move shows that tracking was wrong, the
/// field is corrected by it (see SurroundSettings); `later`, `flow` and the pictures stay as tracked.
/// @throws TrackingError if the later surface is unusable, the two do not overlap or no vector can be trusted
ShiftResult computeShift(const Reference& earlier, const cortshift_stereo::Surface& later_pmr,
                         const Directions& directions, const ShiftSettings& settings = {},
                         const cv::Mat& prediction = {}, const PairKnowledge& knowledge = {});

/// Displacement field from the earlier to the later surface.
/// @throws TrackingError as the two above
ShiftResult computeShift(const cortshift_stereo::Surface& earlier_pmr, const cortshift_stereo::Surface& later_pmr,
                         const Directions& directions, const ShiftSettings& settings = {},
                         const std::vector<Region>& excluded = {}, const PairKnowledge& knowledge = {});

}  // namespace cortshift_tracking
