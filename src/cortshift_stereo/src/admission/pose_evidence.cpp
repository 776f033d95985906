#include "cortshift_stereo/admission/pose_evidence.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <vector>

namespace cortshift_stereo {
namespace {

constexpr std::size_t kFewest = 5;      // samples that show a tremble
constexpr double kSeen = 0.0001;        // [m] below, nothing of it shows in a surface
constexpr double kPlainly = 3;          // times: noise of one source has next_but_one as large as next
constexpr double kOutlier = 4;          // times the median deviation; of 10 samples of noise the worst is twice it
constexpr double kNeighbours = 1.5;     // variance of a deviation over that of a sample: 1 + 2 / 4
constexpr int64_t kPast = 10000000000;  // [ns] of samples that a repetition is looked for in

std::string millimetres(double metres) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f mm", 1e3 * metres);
  return text;
}

std::string name(const MovingEdge& edge) { return "The edge " + edge.parent + " -> " + edge.child; }

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

bool same(const EdgeSample& a, const EdgeSample& b) { return a.T_parent_child.matrix() == b.T_parent_child.matrix(); }

}  // namespace

EdgeTremble trembleOf(const MovingEdge& edge, double working_distance) {
  EdgeTremble worst_of_both;
  if (edge.samples.size() < kFewest) return worst_of_both;
  for (const double depth : {0.0, working_distance}) {
    const Eigen::Vector3d seen = edge.T_child_source * Eigen::Vector3d(0, 0, depth);
    std::vector<Eigen::Vector3d> at;
    for (const EdgeSample& sample : edge.samples) at.push_back(sample.T_parent_child * seen);
    std::vector<double> next, next_but_one, deviations;
    double squares = 0;
    for (std::size_t i = 0; i + 1 < at.size(); ++i) {
      next.push_back((at[i + 1] - at[i]).norm());
      if (i == 0) continue;
      next_but_one.push_back((at[i + 1] - at[i - 1]).norm());
      const auto time = [&](std::size_t k) {
        return static_cast<double>(edge.samples[k].stamp_ns - edge.samples[0].stamp_ns);
      };
      const double share = (time(i) - time(i - 1)) / (time(i + 1) - time(i - 1));
      deviations.push_back((at[i] - (1 - share) * at[i - 1] - share * at[i + 1]).norm());
      squares += deviations.back() * deviations.back();
    }
    EdgeTremble here;
    here.jitter = std::sqrt(squares / static_cast<double>(deviations.size()) / kNeighbours);
    here.middle = median(deviations);
    here.worst = *std::max_element(deviations.begin(), deviations.end());
    here.next = median(next);
    here.next_but_one = median(next_but_one);
    if (depth == 0 || here.worst > worst_of_both.worst) worst_of_both = here;
  }
  return worst_of_both;
}

Findings checkPublishers(const MovingEdge& edge, const EdgeTremble& tremble) {
  Findings found;
  if (tremble.next > kSeen && tremble.next > kPlainly * tremble.next_but_one)
    found.refuse(CheckId::kPosePublishers, name(edge),
                 "jumps by " + millimetres(tremble.next) + " from sample to sample and back (by " +
                     millimetres(tremble.next_but_one) + " over two)",
                 "two publishers say different poses in turn; stop the one that is wrong");
  return found;
}

Findings checkJitter(const MovingEdge& edge, const EdgeTremble& tremble, const PoseLimits& limits) {
  Findings found;
  const bool outlier = tremble.worst > kSeen && tremble.worst > kOutlier * tremble.middle;
  const double refused = PoseLimits::kRefusedJitter * limits.tracker_jitter;
  const std::string remedy =
      "check the tracker's line of sight, its markers and who publishes the pose, and capture again";
  const std::string known = " (tracker_jitter: known for " + millimetres(limits.tracker_jitter) + ")";
  if (tremble.jitter > refused || (outlier && tremble.worst > refused))
    found.refuse(CheckId::kPoseJitter, name(edge),
                 "trembles by " + millimetres(tremble.jitter) + " around the exposure, at worst by " +
                     millimetres(tremble.worst) + ", where the camera looks" + known,
                 remedy);
  else if (tremble.jitter > limits.tracker_jitter)
    found.warn(CheckId::kPoseJitter, name(edge),
               "trembles by " + millimetres(tremble.jitter) + " around the exposure, where the camera looks" + known,
               remedy);
  else if (outlier)
    found.warn(CheckId::kPoseJitter, name(edge),
               "jumps by " + millimetres(tremble.worst) + " around the exposure, while its other samples tremble by " +
                   millimetres(tremble.middle),
               remedy);
  return found;
}

Findings checkRepetition(const MovingEdge& edge, int64_t stamp_ns) {
  Findings found;
  const std::vector<EdgeSample>& all = edge.samples;
  const auto after = std::find_if(all.begin(), all.end(), [&](const EdgeSample& s) { return s.stamp_ns >= stamp_ns; });
  if (after == all.end()) return found;
  // A tracker that measures never says the same twice. One that has no noise (a simulated one) is not judged: its
  // samples are all the same while nothing moves, before the pose that is asked for as well.
  auto stood = after;
  while (stood != all.begin() && same(*std::prev(stood), *after)) --stood;
  std::size_t trembled = 0, turned = 0, still = 0;
  for (auto it = all.begin(); it + 2 <= after && it + 2 < all.end(); ++it) {
    const Eigen::Vector3d first = (it + 1)->T_parent_child.translation() - it->T_parent_child.translation();
    const Eigen::Vector3d second = (it + 2)->T_parent_child.translation() - (it + 1)->T_parent_child.translation();
    if (first.isZero(0) || second.isZero(0)) {
      still += it + 2 <= stood ? 1 : 0;
      continue;
    }
    ++trembled;
    turned += first.dot(second) < 0;
  }
  // Noise turns back in two of three steps.
  if (trembled < 2 * kFewest || 3 * turned < trembled || still > trembled) return found;
  for (auto it = all.begin(); it != all.end(); ++it) {
    if (it == after || !same(*it, *after)) continue;
    char text[32];
    std::snprintf(text, sizeof text, "%.3f s", 1e-9 * static_cast<double>(std::abs(after->stamp_ns - it->stamp_ns)));
    found.refuse(CheckId::kPoseRepeated, name(edge),
                 "says bit by bit the same pose as " + std::string(text) + (it < after ? " before" : " later") +
                     ", though its samples tremble",
                 "the tracker repeats itself and does not measure; check that it sees the tool, and its connection");
    return found;
  }
  return found;
}

Findings checkPoses(const TransformTree& tree, const std::string& target, const std::string& source, int64_t stamp_ns,
                    const PoseLimits& limits) {
  Findings found;
  const auto window = static_cast<int64_t>(1e9 * PoseLimits::kWindow);
  for (const MovingEdge& edge : tree.movingEdges(target, source, stamp_ns, window)) {
    const EdgeTremble tremble = trembleOf(edge);
    const Findings publishers = checkPublishers(edge, tremble);
    found.add(publishers);
    if (publishers.all().empty()) found.add(checkJitter(edge, tremble, limits));
  }
  for (const MovingEdge& edge : tree.movingEdges(target, source, stamp_ns, kPast))
    found.add(checkRepetition(edge, stamp_ns));
  return found;
}

}  // namespace cortshift_stereo
