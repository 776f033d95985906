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
constexpr double kByChance = 1e-3;      // a repetition that a tracker which rounds would show more often is none

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

/// Probability that two samples which are not of one stretch without any change are the same: of a tracker that rounds
/// what it says. Those that are as `asked` do not count.
double chanceOfTheSame(const std::vector<EdgeSample>& samples, const EdgeSample& asked) {
  std::vector<const EdgeSample*> others;  // the first of each stretch
  for (std::size_t i = 0; i < samples.size(); ++i)
    if (!same(samples[i], asked) && (i == 0 || !same(samples[i], samples[i - 1]))) others.push_back(&samples[i]);
  if (others.size() < 2) return 1;
  const auto less = [](const EdgeSample* a, const EdgeSample* b) {
    const auto &first = a->T_parent_child.matrix(), &second = b->T_parent_child.matrix();
    return std::lexicographical_compare(first.data(), first.data() + first.size(), second.data(),
                                        second.data() + second.size());
  };
  std::sort(others.begin(), others.end(), less);
  double pairs = 0, alike = 0;
  for (std::size_t i = 1; i <= others.size(); ++i) {
    if (i < others.size() && same(*others[i], *others[i - 1])) {
      ++alike;
      continue;
    }
    pairs += alike * (alike + 1) / 2;
    alike = 0;
  }
  const auto count = static_cast<double>(others.size());
  return std::min(1.0, (pairs + 1) / (count * (count - 1) / 2));  // one more: where none was seen one may come
}

/// How many samples in a row, that at `at` among them, are each the same as the one as far away as `other` is from
/// `at`.
int repeatedAround(const std::vector<EdgeSample>& samples, std::size_t at, std::size_t other) {
  int count = 1;
  for (std::size_t i = 1; std::max(at, other) + i < samples.size() && same(samples[at + i], samples[other + i]); ++i)
    ++count;
  for (std::size_t i = 1; i <= std::min(at, other) && same(samples[at - i], samples[other - i]); ++i) ++count;
  return count;
}

/// Seconds of a sample since the first.
double timeOf(const MovingEdge& edge, std::size_t sample) {
  return 1e-9 * static_cast<double>(edge.samples[sample].stamp_ns - edge.samples[0].stamp_ns);
}

/// Where the samples place what the camera sees at a depth.
std::vector<Eigen::Vector3d> placesOf(const MovingEdge& edge, double depth) {
  const Eigen::Vector3d seen = edge.T_child_source * Eigen::Vector3d(0, 0, depth);
  std::vector<Eigen::Vector3d> at;
  for (const EdgeSample& sample : edge.samples) at.push_back(sample.T_parent_child * seen);
  return at;
}

/// Of each sample from what those on either side of it lead to expect.
std::vector<double> deviationsOf(const MovingEdge& edge, const std::vector<Eigen::Vector3d>& at) {
  std::vector<double> deviations;
  for (std::size_t i = 1; i + 1 < at.size(); ++i) {
    const double share = (timeOf(edge, i) - timeOf(edge, i - 1)) / (timeOf(edge, i + 1) - timeOf(edge, i - 1));
    deviations.push_back((at[i] - (1 - share) * at[i - 1] - share * at[i + 1]).norm());
  }
  return deviations;
}

/// Root mean square of a sample.
double jitterOf(const std::vector<double>& deviations) {
  double squares = 0;
  for (const double deviation : deviations) squares += deviation * deviation;
  return std::sqrt(squares / static_cast<double>(deviations.size()) / kNeighbours);
}

/// Of the straight line through the samples [m/s].
Eigen::Vector3d velocityOf(const MovingEdge& edge, const std::vector<Eigen::Vector3d>& at) {
  double middle = 0;
  for (std::size_t i = 0; i < at.size(); ++i) middle += timeOf(edge, i) / static_cast<double>(at.size());
  Eigen::Vector3d moments = Eigen::Vector3d::Zero();
  double squares = 0;
  for (std::size_t i = 0; i < at.size(); ++i) {
    const double time = timeOf(edge, i) - middle;
    moments += time * (at[i] - at[0]);
    squares += time * time;
  }
  return moments / squares;
}

/// Variance of a pose between two samples over that of a sample: half of it in the middle, all of it beside one.
double shareOfNoise(const MovingEdge& edge, int64_t stamp_ns) {
  for (std::size_t i = 1; i < edge.samples.size(); ++i) {
    const int64_t before = edge.samples[i - 1].stamp_ns, after = edge.samples[i].stamp_ns;
    if (stamp_ns < before || stamp_ns > after) continue;
    const double later = static_cast<double>(stamp_ns - before) / static_cast<double>(after - before);
    return later * later + (1 - later) * (1 - later);
  }
  return 1;
}

/// From mean squares of lengths at the camera and where it looks.
PoseSpread spreadOf(double at_camera, double where_it_looks, double working_distance) {
  // Two of the three rotations move what lies ahead.
  return {std::sqrt(at_camera / 3), std::sqrt(std::max(0.0, where_it_looks - at_camera) / 2) / working_distance};
}

}  // namespace

EdgeTremble trembleOf(const MovingEdge& edge, double working_distance) {
  EdgeTremble worst_of_both;
  if (edge.samples.size() < kFewest) return worst_of_both;
  for (const double depth : {0.0, working_distance}) {
    const std::vector<Eigen::Vector3d> at = placesOf(edge, depth);
    std::vector<double> next, next_but_one;
    for (std::size_t i = 0; i + 1 < at.size(); ++i) {
      next.push_back((at[i + 1] - at[i]).norm());
      if (i > 0) next_but_one.push_back((at[i + 1] - at[i - 1]).norm());
    }
    const std::vector<double> deviations = deviationsOf(edge, at);
    EdgeTremble here;
    here.jitter = jitterOf(deviations);
    here.middle = median(deviations);
    here.worst = *std::max_element(deviations.begin(), deviations.end());
    here.next = median(next);
    here.next_but_one = median(next_but_one);
    if (depth == 0 || here.worst > worst_of_both.worst) worst_of_both = here;
  }
  return worst_of_both;
}

std::optional<ExposureMotion> exposureMotion(const TransformTree& tree, const std::string& target,
                                             const std::string& source, int64_t stamp_ns, double working_distance) {
  const auto window = static_cast<int64_t>(1e9 * PoseLimits::kWindow);
  const std::vector<MovingEdge> edges = tree.movingEdges(target, source, stamp_ns, window);
  if (edges.empty()) return std::nullopt;
  double tremble[2] = {0, 0}, speed[2] = {0, 0};  // squared lengths, at the camera and where it looks
  for (const MovingEdge& edge : edges) {
    if (edge.samples.size() < kFewest) return std::nullopt;
    const double share = shareOfNoise(edge, stamp_ns);
    for (const int place : {0, 1}) {
      const std::vector<Eigen::Vector3d> at = placesOf(edge, place * working_distance);
      const double jitter = jitterOf(deviationsOf(edge, at));
      tremble[place] += share * jitter * jitter;
      speed[place] += velocityOf(edge, at).squaredNorm();
    }
  }
  return ExposureMotion{spreadOf(tremble[0], tremble[1], working_distance),
                        spreadOf(speed[0], speed[1], working_distance)};
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
  // A tracker that measures hardly says the same twice, unless it rounds. One that has no noise (a simulated one) is
  // not judged: its samples are all the same while nothing moves, before the pose that is asked for as well.
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
  const auto at = static_cast<std::size_t>(after - all.begin());
  const double chance = std::max(chanceOfTheSame(all, *after), static_cast<double>(still) / (still + trembled));
  const std::size_t others = all.size() - 1;
  for (std::size_t other = 0; other < all.size(); ++other) {
    if (other == at || !same(all[other], *after)) continue;
    if (static_cast<double>(others) * std::pow(chance, repeatedAround(all, at, other)) > kByChance) continue;
    char text[32];
    std::snprintf(text, sizeof text, "%.3f s",
                  1e-9 * static_cast<double>(std::abs(after->stamp_ns - all[other].stamp_ns)));
    found.refuse(CheckId::kPoseRepeated, name(edge),
                 "says bit by bit the same pose as " + std::string(text) + (other < at ? " before" : " later") +
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
