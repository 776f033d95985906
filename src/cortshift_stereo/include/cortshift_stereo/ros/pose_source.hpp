// Poses at a stamp together with what speaks against them.
#pragma once

#include <functional>
#include <optional>
#include <type_traits>

#include "cortshift_stereo/admission/limits.hpp"
#include "cortshift_stereo/admission/pose_evidence.hpp"
#include "cortshift_stereo/admission/verdict.hpp"
#include "cortshift_stereo/ros/pose_tree.hpp"

namespace cortshift_stereo {

/// A pose, and what the samples around it say of it. From a PoseAt alone: nothing is known of the samples.
struct PoseSource {
  using Judge = std::function<Findings(const std::string& target, const std::string& source, const ros::Time& stamp)>;
  using MotionAt = std::function<std::optional<ExposureMotion>(const std::string& target, const std::string& source,
                                                               const ros::Time& stamp)>;

  template <typename Function, typename = std::enable_if_t<std::is_convertible_v<Function, PoseAt>>>
  PoseSource(const Function& pose_at) : at(pose_at) {}  // NOLINT
  PoseSource(PoseAt pose_at, Judge judge_poses, MotionAt motion_at = {})
      : at(std::move(pose_at)), judge(std::move(judge_poses)), motion(std::move(motion_at)) {}

  PoseAt at;
  Judge judge;      ///< asked after `at` has answered; may be empty
  MotionAt motion;  ///< the same
};

/// Findings about the moving edges between the two frames. @throws PoseError
Findings judgePoses(const TransformTree& tree, const std::string& target, const std::string& source,
                    const ros::Time& stamp, const PoseLimits& limits);

/// See exposureMotion. @throws PoseError
std::optional<ExposureMotion> poseMotion(const TransformTree& tree, const std::string& target,
                                         const std::string& source, const ros::Time& stamp);

}  // namespace cortshift_stereo
