#include "cortshift_tracking/shift.hpp"

#include <chrono>
#include <string>
#include <utility>

#include "cortshift_flow/text.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/surround/uncertainty.hpp"

namespace cortshift_tracking {
namespace {

class Stopwatch {
 public:
  /// Seconds since the last call, or since construction.
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    const double seconds = std::chrono::duration<double>(now - last_).count();
    last_ = now;
    return seconds;
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

std::string gridOf(const ProjectionFrame& frame) {
  return cortshift_flow::formatted("metres of its projection frame, whose grid is %.3f m wide and %.3f m high",
                                   frame.resolution * (frame.size.width - 1),
                                   frame.resolution * (frame.size.height - 1));
}

/// @throws TrackingError if a region touches no point of the grid: it was drawn on something else, or not in metres
cv::Mat excludedOn(const ProjectionFrame& frame, const std::vector<Region>& regions) {
  cv::Mat all = excludedMask(frame, {});
  for (std::size_t i = 0; i < regions.size(); ++i) {
    const cv::Mat mask = excludedMask(frame, {regions[i]});
    if (cv::countNonZero(mask) == 0)
      throw TrackingError("excluded region " + std::to_string(i + 1) + " of " + std::to_string(regions.size()) +
                          " lies nowhere on the earlier stage; give the regions again with exclude_regions, in " +
                          gridOf(frame));
    all |= mask;
  }
  return all;
}

/// @throws TrackingError if next to nothing of the surface is within: all of it would count as what does not move
cv::Mat brainOn(const Reference& earlier, const std::vector<Region>& brain) {
  constexpr double kLeast = 25e-6;  // [m2] a window of 5 mm
  const ProjectionFrame& frame = earlier.frame;
  cv::Mat mask = excludedMask(frame, brain);
  const double area = frame.resolution * frame.resolution * cv::countNonZero(mask & earlier.projection.mask);
  if (area < kLeast)
    throw TrackingError(
        cortshift_flow::formatted("the outline that was drawn of the brain covers %.0f mm2 of the earlier "
                                  "stage's surface; draw it again with set_outline, in ",
                                  1e6 * area) +
        gridOf(frame) + ", or take it back with no polygon at all");
  return mask;
}

std::string percent(double part) { return std::to_string(static_cast<int>(100 * part)) + " %"; }

}  // namespace

void ShiftSettings::validate() const {
  frame.validate();
  projection.validate();
  matching.validate();
  trust.validate();
  inversion.validate();
  surround.validate();
  strain.validate();
}

void ShiftSettings::setThreads(int threads) {
  projection.threads = threads;
  matching.flow.threads = threads;
  inversion.threads = threads;
  strain.threads = threads;
}

Reference prepareReference(const cortshift_stereo::Surface& earlier_pmr, const ShiftSettings& settings,
                           const std::vector<Region>& excluded) {
  settings.validate();
  Stopwatch watch;
  Reference reference;
  reference.points_pmr = earlier_pmr.points;
  reference.frame = fitProjectionFrame(earlier_pmr, settings.frame);
  reference.projection = project(earlier_pmr, reference.frame, settings.projection);
  reference.excluded = excludedOn(reference.frame, excluded);
  reference.usable = usableMask(reference.projection, settings.trust);
  reference.usable.setTo(0, reference.excluded);
  reference.outline = proposeOutline(reference.projection);
  reference.seconds = watch.lap();
  return reference;
}

ShiftResult computeShift(const Reference& earlier, const cortshift_stereo::Surface& later_pmr,
                         const Directions& directions, const ShiftSettings& settings, const cv::Mat& prediction,
                         const PairKnowledge& knowledge) {
  settings.validate();
  Stopwatch watch;
  ShiftResult result;
  result.earlier = earlier.projection;
  result.later = project(later_pmr, earlier.frame, settings.projection);
  cv::Mat later_usable = usableMask(result.later, settings.trust);
  later_usable.setTo(0, earlier.excluded);
  const double overlap = overlapOf(result.earlier, result.later);
  if (!(overlap > 0))
    throw TrackingError("the two surfaces do not overlap in the projection; check the registration of both stages");
  const double projection_seconds = watch.lap();

  ProjectionMatch match =
      matchProjections(result.earlier, result.later, earlier.usable, later_usable, settings.matching, prediction);
  const auto pixelOf = [&](const Projection& projection, const std::optional<PlacedCamera>& camera) {
    const double spacing = projection.max_edge / settings.projection.max_edge_ratio * projection.resolution;
    return pixelOfDisparity(projection, spacing, earlier.frame, camera, knowledge.baseline);
  };
  const Measured measured{result.earlier,
                          result.later,
                          match.flow,
                          match.confidence,
                          pixelOf(result.earlier, knowledge.earlier),
                          pixelOf(result.later, knowledge.later)};
  VectorEvidence evidence;
  cv::Mat probability;
  const auto judge = [&] {
    evidence = evidenceOf(result.earlier, result.later, match, heightErrorsOf(measured), earlier.usable, later_usable,
                          settings.trust);
    probability = probabilityOfMatch(evidence);
  };
  judge();
  if (!prediction.empty() && settings.matching.channels == "auto" &&
      !isFollowed(probability, earlier.usable, later_usable)) {
    // No first look has chosen the channels, and tissue may bleed since the moment before.
    ImageMatchingSettings other = settings.matching;
    other.channels = chooseChannels(result.earlier, result.later, earlier.usable, later_usable, settings.matching);
    if (other.channels != match.channels) {
      match = matchProjections(result.earlier, result.later, earlier.usable, later_usable, other, prediction);
      judge();
    }
  }
  const double flow_seconds = watch.lap();
  result.flow = match.flow;
  const cv::Mat height_errors = evidence.height_errors;
  const cv::Mat confidence = confidenceOf(evidence, probability, settings.trust);
  if (settings.with_evidence) result.evidence = std::move(evidence);
  result.field = invert(earlier.frame, result.earlier, result.later, match.flow, confidence, settings.inversion);
  if (settings.with_own_points) {
    result.own_points_pmr = earlier.points_pmr;
    result.own_displacements_pmr =
        displacementsOfPoints(earlier.frame, result.earlier, result.later, match.flow, confidence, settings.inversion);
  }
  const Outline outline =
      knowledge.brain.empty() ? earlier.outline : Outline{brainOn(earlier, knowledge.brain), {}, "drawn by hand"};
  result.field.brain = outline.brain;
  const Surround surround = assessSurround(result.field, knowledge, settings.surround, outline.opening);
  if (surround.corrected) {
    takeOut(surround.transform, result.field.start_pmr, result.field.displacement_pmr);
    if (settings.with_own_points) takeOut(surround.transform, result.own_points_pmr, result.own_displacements_pmr);
  }
  const cv::Mat own = ownErrorsOf(measured, height_errors);
  result.field.uncertainty = uncertaintyOf(result.field, own, surround);
  if (settings.with_strain) {
    const Strain strain = surfaceStrain(result.field, settings.strain);
    result.field.strain_major = strain.major;
    result.field.strain_minor = strain.minor;
  }
  const double inversion_seconds = watch.lap();

  result.summary = summarise(result.field, overlap, directions.first_normal_pmr, directions.gravity_pmr);
  result.summary.projection_seconds = projection_seconds;
  result.summary.flow_seconds = flow_seconds;
  result.summary.inversion_seconds = inversion_seconds;
  result.summary.configuration = settings.configuration;
  addBudget(result.summary, result.field, own, surround);
  result.summary.outline = outline.text;
  result.summary.surround = surround.text;
  result.summary.warnings = surround.warnings;
  if (surround.corrected)
    result.summary.correction =
        Correction{surround.transform, aboutCentre(surround.covariance, surround.centre, Eigen::Vector3d::Zero())};
  if (result.summary.valid_points == 0)
    throw TrackingError("no displacement can be trusted (overlap " + percent(overlap) +
                        "); capture a stage with the same cortex in view, in focus and free of blood");
  return result;
}

ShiftResult computeShift(const cortshift_stereo::Surface& earlier_pmr, const cortshift_stereo::Surface& later_pmr,
                         const Directions& directions, const ShiftSettings& settings,
                         const std::vector<Region>& excluded, const PairKnowledge& knowledge) {
  const Reference reference = prepareReference(earlier_pmr, settings, excluded);
  ShiftResult result = computeShift(reference, later_pmr, directions, settings, {}, knowledge);
  result.summary.projection_seconds += reference.seconds;
  return result;
}

}  // namespace cortshift_tracking
