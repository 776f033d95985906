// A phantom case whose tracker is off: pairs are rendered and reconstructed once, errors of the poses move the
// surfaces.
#pragma once

#include <cmath>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "cortshift_stereo/geometry/point_transform.hpp"
#include "cortshift_stereo/reconstruction.hpp"
#include "cortshift_stereo_phantom/phantom_renderer.hpp"
#include "cortshift_tracking/shift.hpp"
#include "cortshift_tracking_phantom/field_truth.hpp"

namespace cortshift_tracking_phantom {

using namespace cortshift_stereo_phantom;
using namespace cortshift_tracking;

constexpr double kDegree = M_PI / 180;

/// Error of one tracked pose, in the axes of the tracked body.
using PoseError = Eigen::Isometry3d;

inline PoseError poseError(const Eigen::Vector3d& way, const Eigen::Vector3d& turn) {
  PoseError error = PoseError::Identity();
  if (turn.norm() > 0) error.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()).matrix();
  error.translation() = way;
  return error;
}

/// Numbers that a seed repeats.
class PoseNoise {
 public:
  explicit PoseNoise(std::uint64_t seed) : random_(seed + 1) { random_.uniform(0, 9); }
  Eigen::Vector3d normal(double sd) { return {random_.gaussian(sd), random_.gaussian(sd), random_.gaussian(sd)}; }
  Eigen::Vector3d along(double length) { return length * normal(1).normalized(); }
  double upTo(double most) { return random_.uniform(0.0, most); }

 private:
  cv::RNG random_;
};

/// The surfaces of a case, rendered and reconstructed once; the tracker's errors move them afterwards.
class TrackedCase {
 public:
  explicit TrackedCase(const cortshift_stereo_phantom::PhantomCase& description, double resolution)
      : scene_(std::make_shared<const PhantomScene>(description)) {
    settings.frame.resolution = resolution;
    PhantomPairs pairs(scene_);
    const cortshift_stereo::Rectifier rectifier(scene_->stereoHead().model);
    for (int stage = 0; stage < scene_->stageCount(); ++stage) {
      const StereoImages images = pairs.take(stage, 1);
      left_.push_back(cortshift_stereo::reconstruct(images.left, images.right, rectifier).surface_left);
    }
  }

  const PhantomScene& scene() const { return *scene_; }
  int stages() const { return scene_->stageCount(); }

  /// The stage as a shift from it sees it.
  Reference reference(int stage, const std::vector<PoseError>& errors) const {
    return prepareReference(placed(stage, errors), settings);
  }

  /// @param errors of the pose of each stage
  ShiftResult shift(int from, int to, const std::vector<PoseError>& errors, SurroundMode mode) const {
    ShiftSettings with = settings;
    with.surround.mode = mode;
    const cortshift_stereo::Surface earlier = placed(from, errors), later = placed(to, errors);
    return computeShift(earlier, later, {averageNormal(earlier), std::nullopt}, with, {},
                        {camera(from, errors), camera(to, errors), {}});
  }

  /// Of the tissue that the earlier stage shows: where its pose put that tissue is no error of the displacement.
  FieldError errorOf(const ShiftResult& result, int from, int to, const std::vector<PoseError>& errors) const {
    DisplacementField field = result.field;
    const auto at = static_cast<std::size_t>(from);
    const Eigen::Isometry3d back = poseOf(from, PoseError::Identity()) * poseOf(from, errors[at]).inverse();
    field.start_pmr = cortshift_stereo::transformPoints(back, field.start_pmr);
    return compareWithTruth(field, *scene_, from, to, 4);
  }

  ShiftSettings settings;

 private:
  Eigen::Isometry3d poseOf(int stage, const PoseError& error) const {
    const Eigen::Isometry3d T_pmr_microscope =
        scene_->description().T_pmr_reference * scene_->T_reference_microscope(stage);
    return T_pmr_microscope * error * T_pmr_microscope.inverse() * scene_->view(stage, Side::kLeft).T_pmr_camera;
  }
  PlacedCamera camera(int stage, const std::vector<PoseError>& errors) const {
    return {poseOf(stage, errors[static_cast<std::size_t>(stage)]), {}};
  }
  cortshift_stereo::Surface placed(int stage, const std::vector<PoseError>& errors) const {
    const auto at = static_cast<std::size_t>(stage);
    cortshift_stereo::Surface surface = left_[at];
    surface.points = cortshift_stereo::transformPoints(poseOf(stage, errors[at]), surface.points);
    return surface;
  }

  std::shared_ptr<const PhantomScene> scene_;
  std::vector<cortshift_stereo::Surface> left_;
};

/// 0.15 mm and 0.04 degrees of noise on each coordinate, and a drift of 0.4 mm and 0.1 degrees from stage to stage.
inline std::vector<PoseError> ordinaryTracker(int stages, std::uint64_t seed) {
  PoseNoise random(seed);
  std::vector<PoseError> errors;
  Eigen::Vector3d way(0, 0, 0), turn(0, 0, 0);
  for (int stage = 0; stage < stages; ++stage) {
    errors.push_back(poseError(way + random.normal(0.00015), turn + random.normal(0.04 * kDegree)));
    way += random.along(0.0004);
    turn += random.along(0.1 * kDegree);
  }
  return errors;
}

inline std::vector<PoseError> exactTracker(int stages) {
  return std::vector<PoseError>(static_cast<std::size_t>(stages), PoseError::Identity());
}

/// A drift of up to 1.5 mm and 0.4 degrees before the last stage.
inline std::vector<PoseError> randomDrift(int stages, std::uint64_t seed) {
  PoseNoise random(1000 + seed);
  std::vector<PoseError> errors = exactTracker(stages);
  const double length = random.upTo(0.0015), angle = random.upTo(0.4 * kDegree);
  const Eigen::Vector3d way = random.along(length), turn = random.along(angle);
  errors.back() = poseError(way, turn);
  return errors;
}

}  // namespace cortshift_tracking_phantom
