#include "cortshift_stereo/geometry/transform_tree.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace cortshift_stereo {
namespace {

using Reason = PoseError::Reason;

std::string seconds(int64_t ns) {
  char text[40];
  std::snprintf(text, sizeof text, "%.6f s", 1e-9 * static_cast<double>(ns));
  return text;
}

std::string edgeName(const std::string& parent, const std::string& child) { return parent + " -> " + child; }

Eigen::Isometry3d isometry(const Eigen::Vector3d& translation, const Eigen::Quaterniond& rotation) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = rotation.toRotationMatrix();
  T.translation() = translation;
  return T;
}

}  // namespace

TransformTree::TransformTree(double max_pose_gap, double history)
    : max_gap_ns_(std::llround(1e9 * max_pose_gap)), history_ns_(std::llround(1e9 * history)) {
  if (!(max_pose_gap > 0) || !(history >= max_pose_gap))
    throw std::invalid_argument("TransformTree: max_pose_gap must be positive and history not shorter than it");
}

TransformTree::Sample TransformTree::makeSample(const std::string& parent, const Eigen::Vector3d& translation,
                                                const Eigen::Quaterniond& rotation) {
  constexpr double kNormTolerance = 1e-3;
  const bool rigid =
      translation.allFinite() && rotation.coeffs().allFinite() && std::abs(rotation.norm() - 1) < kNormTolerance;
  return {parent, translation, rigid ? rotation.normalized() : rotation, rigid, false};
}

void TransformTree::addFixed(const std::string& parent, const std::string& child, const Eigen::Vector3d& translation,
                             const Eigen::Quaterniond& rotation, std::optional<double> when) {
  constexpr double kAtOnce = 0.3;  // [s] latched messages of several publishers come together
  Edge& edge = edges_[child];
  const Sample fixed = makeSample(parent, translation, rotation);
  const bool another = edge.fixed && !samePose(*edge.fixed, fixed);
  edge.contradicted = another && when && edge.fixed_since && std::abs(*when - *edge.fixed_since) < kAtOnce;
  edge.fixed = fixed;
  edge.fixed_since = when;
}

void TransformTree::addSample(const std::string& parent, const std::string& child, int64_t stamp_ns,
                              const Eigen::Vector3d& translation, const Eigen::Quaterniond& rotation) {
  std::map<int64_t, Sample>& samples = edges_[child].samples;
  if (!samples.empty() && stamp_ns < samples.rbegin()->first - history_ns_) samples.clear();
  const Sample sample = makeSample(parent, translation, rotation);
  const auto [same_stamp, added] = samples.emplace(stamp_ns, sample);
  if (!added && !samePose(same_stamp->second, sample)) same_stamp->second.contradicted = true;
  samples.erase(samples.begin(), samples.lower_bound(samples.rbegin()->first - history_ns_));
}

void TransformTree::forgetSamples() {
  for (auto& [child, edge] : edges_) edge.samples.clear();
}

const std::string* TransformTree::parentOf(const std::string& frame) const {
  const auto found = edges_.find(frame);
  if (found == edges_.end()) return nullptr;
  if (found->second.fixed) return &found->second.fixed->parent;
  return found->second.samples.empty() ? nullptr : &found->second.samples.rbegin()->second.parent;
}

bool TransformTree::known(const std::string& frame) const {
  if (parentOf(frame)) return true;
  for (const auto& [child, edge] : edges_) {
    const std::string* parent = parentOf(child);
    if (parent && *parent == frame) return true;
  }
  return false;
}

std::vector<std::string> TransformTree::chainToRoot(const std::string& frame) const {
  std::vector<std::string> chain{frame};
  for (const std::string* parent = parentOf(frame); parent; parent = parentOf(*parent)) {
    if (std::find(chain.begin(), chain.end(), *parent) != chain.end())
      throw PoseError(Reason::kNotConnected, false,
                      "the frames " + *parent + " and " + frame + " form a loop; check who publishes them");
    chain.push_back(*parent);
  }
  return chain;
}

bool TransformTree::samePose(const Sample& a, const Sample& b) {
  constexpr double kSame = 1e-6;  // [m], [rad] rounding
  return a.parent == b.parent && (a.translation - b.translation).norm() <= kSame &&
         a.rotation.angularDistance(b.rotation) <= kSame;
}

void TransformTree::refuseSecondSource(const std::string& child, const Edge& edge, int64_t stamp_ns) const {
  if (edge.contradicted)
    throw PoseError(Reason::kTwoSources, false,
                    "edge " + edgeName(edge.fixed->parent, child) +
                        " came twice on /tf_static at the same time, with two poses: two sources for one frame; stop "
                        "the one that is wrong");
  if (edge.samples.empty()) return;
  auto near = edge.samples.lower_bound(stamp_ns);
  if (near == edge.samples.end()) --near;
  const Sample &fixed = *edge.fixed, &moving = near->second;
  if (samePose(fixed, moving)) return;  // publishers of fixed edges may repeat them on /tf
  throw PoseError(Reason::kTwoSources, false,
                  "edge " + edgeName(fixed.parent, child) + " is fixed on /tf_static, and " +
                      edgeName(moving.parent, child) +
                      " moves on /tf with another pose: two sources for one frame; stop the one that is wrong");
}

TransformTree::Link TransformTree::evaluate(const std::string& child, int64_t stamp_ns) const {
  const Edge& edge = edges_.at(child);
  const auto refuseBroken = [&](const Sample& sample, const std::string& when) {
    if (!sample.rigid)
      throw PoseError(Reason::kNotRigid, false,
                      "edge " + edgeName(sample.parent, child) + ": the transform " + when +
                          " is not rigid (not finite, or its quaternion is not of unit length); check its publisher");
    if (sample.contradicted)
      throw PoseError(Reason::kTwoSources, false,
                      "edge " + edgeName(sample.parent, child) + " came twice " + when +
                          ", with two poses: two sources for one frame; stop the one that is wrong");
  };
  if (edge.fixed) {
    refuseBroken(*edge.fixed, "on /tf_static");
    refuseSecondSource(child, edge, stamp_ns);
    return {edge.fixed->parent, isometry(edge.fixed->translation, edge.fixed->rotation)};
  }
  const auto after = edge.samples.lower_bound(stamp_ns);
  const std::string name = edgeName(*parentOf(child), child);
  const std::string remedy = " (max_pose_gap is " + seconds(max_gap_ns_) +
                             "); check the tracker's line of sight and rate, and that the clocks agree";
  if (after != edge.samples.end() && after->first == stamp_ns) {
    refuseBroken(after->second, "at " + seconds(stamp_ns));
    return {after->second.parent, isometry(after->second.translation, after->second.rotation)};
  }
  if (after == edge.samples.begin())
    throw PoseError(Reason::kGapBefore, false,
                    "edge " + name + ": no sample before the stamp " + seconds(stamp_ns) + ", the first one comes " +
                        seconds(after->first - stamp_ns) + " after it" + remedy);
  const auto before = std::prev(after);
  const int64_t gap_before = stamp_ns - before->first;
  if (after == edge.samples.end())
    throw PoseError(Reason::kGapAfter, true,
                    "edge " + name + ": no sample after the stamp " + seconds(stamp_ns) + ", the last one is " +
                        seconds(gap_before) + " before it" + remedy);
  const int64_t gap_after = after->first - stamp_ns;
  if (gap_before > max_gap_ns_)
    throw PoseError(Reason::kGapBefore, false,
                    "edge " + name + ": the nearest sample before the stamp " + seconds(stamp_ns) + " is " +
                        seconds(gap_before) + " away" + remedy);
  if (gap_after > max_gap_ns_)
    throw PoseError(Reason::kGapAfter, false,
                    "edge " + name + ": the nearest sample after the stamp " + seconds(stamp_ns) + " is " +
                        seconds(gap_after) + " away" + remedy);
  refuseBroken(before->second, "at " + seconds(before->first));
  refuseBroken(after->second, "at " + seconds(after->first));
  if (before->second.parent != after->second.parent)
    throw PoseError(Reason::kNotConnected, false,
                    "frame " + child + " changes its parent from " + before->second.parent + " to " +
                        after->second.parent + " around the stamp " + seconds(stamp_ns) + "; check who publishes it");
  const double share = static_cast<double>(gap_before) / static_cast<double>(gap_before + gap_after);
  return {before->second.parent, isometry((1 - share) * before->second.translation + share * after->second.translation,
                                          before->second.rotation.slerp(share, after->second.rotation))};
}

std::vector<MovingEdge> TransformTree::movingEdges(const std::string& target, const std::string& source,
                                                   int64_t stamp_ns, int64_t half_window_ns) const {
  lookup(target, source, stamp_ns);  // or what is wrong is told
  const std::vector<std::string> targets = chainToRoot(target), sources = chainToRoot(source);
  std::vector<MovingEdge> moving;
  for (const std::vector<std::string>* own : {&targets, &sources}) {
    const std::vector<std::string>& other = own == &targets ? sources : targets;
    for (const std::string& child : *own) {
      if (std::find(other.begin(), other.end(), child) != other.end()) break;  // where the chains meet
      const auto edge = edges_.find(child);
      if (edge == edges_.end() || edge->second.fixed) continue;
      MovingEdge found{*parentOf(child), child, {}, lookup(child, source, stamp_ns)};
      const auto& samples = edge->second.samples;
      for (auto it = samples.lower_bound(stamp_ns - half_window_ns);
           it != samples.end() && it->first <= stamp_ns + half_window_ns; ++it)
        if (it->second.rigid)
          found.samples.push_back({it->first, isometry(it->second.translation, it->second.rotation)});
      moving.push_back(found);
    }
  }
  return moving;
}

Eigen::Isometry3d TransformTree::lookup(const std::string& target, const std::string& source, int64_t stamp_ns) const {
  for (const std::string& frame : {target, source})
    if (!known(frame))
      throw PoseError(Reason::kMissingFrame, true,
                      "frame " + frame + " is not in tf; check that its publisher runs and spells it so");
  const std::vector<std::string> targets = chainToRoot(target);
  const std::vector<std::string> sources = chainToRoot(source);
  const auto common = std::find_if(sources.begin(), sources.end(), [&](const std::string& frame) {
    return std::find(targets.begin(), targets.end(), frame) != targets.end();
  });
  if (common == sources.end())
    throw PoseError(Reason::kNotConnected, true,
                    "frames " + target + " and " + source + " are not connected: the chains end at " + targets.back() +
                        " and " + sources.back() + "; an edge above one of them is not published");
  const auto climb = [&](const std::string& from) {
    Eigen::Isometry3d T_common_from = Eigen::Isometry3d::Identity();
    std::size_t steps = 0;
    for (std::string frame = from; frame != *common;) {
      // A frame that had another parent at the stamp can lead elsewhere than the chain just found.
      if (edges_.count(frame) == 0 || !parentOf(frame) || ++steps > edges_.size())
        throw PoseError(Reason::kNotConnected, false,
                        "frames " + target + " and " + source + " were not connected at " + seconds(stamp_ns));
      const Link link = evaluate(frame, stamp_ns);
      T_common_from = link.T_parent_child * T_common_from;
      frame = link.parent;
    }
    return T_common_from;
  };
  return climb(target).inverse() * climb(source);
}

}  // namespace cortshift_stereo
