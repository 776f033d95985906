#include "cortshift_stereo/averaging/view_frames.hpp"

#include <algorithm>

#include "cortshift_stereo/admission/verdict.hpp"

namespace cortshift_stereo {

bool ViewFrames::agree(const PosedFrame& earlier, const PosedFrame& newest) const {
  const Eigen::Isometry3d movement = earlier.T_pmr_left.inverse() * newest.T_pmr_left;
  const auto age = static_cast<double>(newest.stamp_ns - earlier.stamp_ns) * 1e-9;
  return age > 0 && age <= tolerance_.age && earlier.rectifier == newest.rectifier &&
         movement.translation().norm() <= tolerance_.translation &&
         Eigen::AngleAxisd(movement.linear()).angle() <= tolerance_.rotation;
}

void ViewFrames::add(const PosedFrame& newest) {
  frames_.erase(
      std::remove_if(frames_.begin(), frames_.end(), [&](const PosedFrame& frame) { return !agree(frame, newest); }),
      frames_.end());
  if (frames_.size() == capacity_) frames_.erase(frames_.begin());
  frames_.push_back(newest);
}

ViewFrames::Mean ViewFrames::mean() const {
  std::vector<Frame> frames;
  const Eigen::Quaterniond newest(frames_.back().T_pmr_left.linear());
  Eigen::Vector3d translation(0, 0, 0);
  Eigen::Vector4d rotation(0, 0, 0, 0);  // quaternions this close have a mean
  for (const PosedFrame& posed : frames_) {
    frames.push_back(posed.frame);
    translation += posed.T_pmr_left.translation();
    const Eigen::Quaterniond q(posed.T_pmr_left.linear());
    rotation += q.coeffs() * (q.dot(newest) < 0 ? -1 : 1);
  }
  Mean mean{averageFrames(frames, frames_.back().rectifier->model()), Eigen::Isometry3d::Identity(), {}};
  for (const PosedFrame& posed : frames_) addWarnings(mean.warnings, posed.warnings);
  mean.T_pmr_left.linear() = Eigen::Quaterniond(rotation.normalized()).toRotationMatrix();
  mean.T_pmr_left.translation() = translation / static_cast<double>(frames_.size());
  return mean;
}

}  // namespace cortshift_stereo
