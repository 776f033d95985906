#include "sources/phantom/phantom_motion.hpp"

#include <algorithm>
#include <cmath>

namespace cortshift_stereo {
namespace {

/// From one pose to another along a straight line and one axis, with soft start and stop.
Eigen::Isometry3d between(const Eigen::Isometry3d& from, const Eigen::Isometry3d& to, double share) {
  const double t = std::clamp(share, 0.0, 1.0), soft = t * t * (3 - 2 * t);
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() = (1 - soft) * from.translation() + soft * to.translation();
  pose.linear() =
      Eigen::Quaterniond(from.linear()).slerp(soft, Eigen::Quaterniond(to.linear())).normalized().toRotationMatrix();
  return pose;
}

}  // namespace

PhantomMotion::PhantomMotion(std::shared_ptr<const cortshift_stereo_phantom::PhantomScene> scene,
                             const PhantomMotionSettings& settings, int stage, Stamp start)
    : scene_(std::move(scene)), settings_(settings), from_(stage), to_(stage), start_(start), arrival_(start) {}

Stamp PhantomMotion::moveTo(int stage, Stamp start) {
  from_ = to_;
  to_ = stage;
  start_ = std::max(start, arrival_);
  arrival_ = start_ + fromSeconds(settings_.move_time);
  return arrival_;
}

Eigen::Isometry3d PhantomMotion::T_reference_microscope(Stamp time) const {
  if (time >= arrival_) return scene_->T_reference_microscope(to_);
  if (time <= start_) return scene_->T_reference_microscope(from_);
  return between(scene_->T_reference_microscope(from_), scene_->T_reference_microscope(to_),
                 toSeconds(time - start_) / toSeconds(arrival_ - start_));
}

std::optional<PhantomMotion::ProbePhase> PhantomMotion::probePhase(Stamp time) const {
  const auto& targets = scene_->description().stages[static_cast<std::size_t>(to_)].probe;
  if (targets.empty() || time < arrival_) return std::nullopt;
  const double cycle = settings_.probe_dwell + settings_.probe_travel;
  const double since = toSeconds(time - arrival_), cycles = std::floor(since / cycle);
  ProbePhase phase;
  phase.index = static_cast<std::size_t>(cycles) % targets.size();
  const double within = since - cycles * cycle;
  phase.travelled = within <= settings_.probe_dwell ? 0 : (within - settings_.probe_dwell) / settings_.probe_travel;
  return phase;
}

Eigen::Isometry3d PhantomMotion::T_pmr_probe(std::size_t target) const {
  const auto& description = scene_->description();
  const auto& place = description.stages[static_cast<std::size_t>(to_)].probe[target];
  const double x = place.at.x(), y = place.at.y();
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() = scene_->pointAt(to_, x, y) - place.lift * description.gravity_pmr;
  pose.linear() = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), -description.T_pmr_brain.linear().col(2))
                      .toRotationMatrix();
  return pose;
}

std::optional<Eigen::Isometry3d> PhantomMotion::T_reference_probe_tip(Stamp time) const {
  const auto phase = probePhase(time);
  if (!phase) return std::nullopt;
  const auto& targets = scene_->description().stages[static_cast<std::size_t>(to_)].probe;
  const Eigen::Isometry3d T_pmr_tip =
      between(T_pmr_probe(phase->index), T_pmr_probe((phase->index + 1) % targets.size()), phase->travelled);
  return scene_->description().T_pmr_reference.inverse() * T_pmr_tip;
}

std::string PhantomMotion::probeTarget(Stamp time) const {
  const auto phase = probePhase(time);
  if (!phase || phase->travelled > 0) return "";
  return scene_->description().stages[static_cast<std::size_t>(to_)].probe[phase->index].label;
}

}  // namespace cortshift_stereo
