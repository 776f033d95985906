#include "cortshift_tracking/field/summary.hpp"

#include <algorithm>
#include <cmath>

#include "cortshift_flow/text.hpp"

namespace cortshift_tracking {
namespace {

/// Welford's running mean and variance.
class Accumulator {
 public:
  void add(double value) {
    ++count_;
    const double gap = value - mean_;
    mean_ += gap / static_cast<double>(count_);
    squares_ += gap * (value - mean_);
  }
  Statistic result() const {
    if (count_ == 0) return {};
    return {mean_, count_ == 1 ? 0.0 : std::sqrt(squares_ / static_cast<double>(count_ - 1))};
  }

 private:
  std::size_t count_ = 0;
  double mean_ = 0, squares_ = 0;
};

/// The means of some of a field's vectors.
class Accumulators {
 public:
  Accumulators(const Eigen::Vector3d& normal, const std::optional<Eigen::Vector3d>& gravity)
      : along_normal_(normal), along_gravity_(gravity) {}

  void add(const Eigen::Vector3d& d) {
    const double along_normal = d.dot(along_normal_);
    ++points_;
    magnitude_.add(d.norm());
    normal_.add(along_normal);
    lateral_.add((d - along_normal * along_normal_).norm());
    if (along_gravity_) gravity_.add(d.dot(*along_gravity_));
  }
  Means result() const {
    return {points_, magnitude_.result(), gravity_.result(), normal_.result(), lateral_.result()};
  }

 private:
  const Eigen::Vector3d& along_normal_;
  const std::optional<Eigen::Vector3d>& along_gravity_;
  std::size_t points_ = 0;
  Accumulator magnitude_, gravity_, normal_, lateral_;
};

std::string millimetres(const Statistic& statistic) {
  if (std::isnan(statistic.mean)) return "not known";
  return cortshift_flow::formatted("%.2f +- %.2f mm", 1e3 * statistic.mean, 1e3 * statistic.sd);
}

}  // namespace

Summary summarise(const DisplacementField& field, double overlap, const Eigen::Vector3d& first_normal_pmr,
                  const std::optional<Eigen::Vector3d>& gravity_pmr) {
  Summary summary;
  summary.overlap = overlap;
  Accumulators all(first_normal_pmr, gravity_pmr), brain(first_normal_pmr, gravity_pmr);
  for (int row = 0; row < field.displacement_pmr.rows; ++row)
    for (int column = 0; column < field.displacement_pmr.cols; ++column) {
      const cv::Vec3f& v = field.displacement_pmr.at<cv::Vec3f>(row, column);
      if (std::isnan(v[0])) continue;
      const Eigen::Vector3d d(v[0], v[1], v[2]);
      all.add(d);
      if (!field.brain.empty() && field.brain.at<uchar>(row, column) != 0) brain.add(d);
    }
  const Means means = all.result();
  summary.valid_points = means.points;
  summary.magnitude = means.magnitude;
  summary.normal = means.normal;
  summary.lateral = means.lateral;
  summary.gravity = means.gravity;
  summary.brain = brain.result();
  if (gravity_pmr) summary.gravity_normal_angle = std::acos(std::clamp(gravity_pmr->dot(first_normal_pmr), -1.0, 1.0));
  return summary;
}

std::string describe(const Summary& summary) {
  std::string out = "magnitude " + millimetres(summary.magnitude) + ", along gravity " + millimetres(summary.gravity) +
                    ", along the normal " + millimetres(summary.normal) + ", lateral " + millimetres(summary.lateral);
  if (!std::isnan(summary.gravity_normal_angle))
    out += cortshift_flow::formatted(", gravity to normal %.1f deg", summary.gravity_normal_angle * 180 / M_PI);
  out += cortshift_flow::formatted("; %zu points, overlap %.0f %%", summary.valid_points, 1e2 * summary.overlap);
  if (summary.brain.points > 0) out += "; brain alone: magnitude " + millimetres(summary.brain.magnitude);
  if (!summary.surround.empty()) out += "; surround: " + summary.surround;
  for (const std::string& warning : summary.warnings) out += "; WARNING: " + warning;
  return out;
}

std::string toText(const Summary& summary) {
  return describe(summary) +
         cortshift_flow::formatted(", computed in %.2f s (projection %.2f, flow %.2f, inversion %.2f)",
                                   summary.compute_seconds(), summary.projection_seconds, summary.flow_seconds,
                                   summary.inversion_seconds);
}

}  // namespace cortshift_tracking
