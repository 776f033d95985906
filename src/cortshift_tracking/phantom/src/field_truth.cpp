#include "cortshift_tracking_phantom/field_truth.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <opencv2/core/utility.hpp>
#include <optional>
#include <vector>

#include "cortshift_tracking/trust/probability.hpp"

namespace cortshift_tracking_phantom {
namespace {

using cortshift_stereo_phantom::Material;
using cortshift_stereo_phantom::PhantomScene;
using cortshift_stereo_phantom::Side;
using cortshift_tracking::DisplacementField;
using cortshift_tracking::kRightWithin;

constexpr double kSampleSpacing = 0.001;  // of the material points that coverage is counted on [m]

Eigen::Vector3d toEigen(const cv::Vec3f& v) { return {v[0], v[1], v[2]}; }

struct RowResult {
  std::vector<double> errors;
  double squares = 0;  // of error / uncertainty
  std::size_t foreign = 0;
  Reliability reliability;
};

RowResult compareRow(const DisplacementField& field, const PhantomScene& scene, int from, int to, int row, int stride) {
  RowResult result;
  for (int column = 0; column < field.frame.size.width; column += stride) {
    const auto error = errorAt(field, scene, from, to, row, column);
    if (!error) continue;
    result.reliability.add(field.confidence.at<float>(row, column), error->right());
    if (error->foreign) {
      ++result.foreign;
      continue;
    }
    result.errors.push_back(error->length);
    if (!field.uncertainty.empty())
      result.squares += std::pow(error->length / field.uncertainty.at<float>(row, column), 2);
  }
  return result;
}

bool isCorresponding(const PhantomScene& scene, int stage, double x, double y) {
  return scene.materialAt(stage, x, y) == Material::kBrain &&
         scene.isVisible(stage, x, y, scene.view(stage, Side::kLeft)) &&
         scene.isVisible(stage, x, y, scene.view(stage, Side::kRight));
}

bool isReported(const DisplacementField& field, const Eigen::Vector3d& start_pmr) {
  const Eigen::Vector3d p = field.frame.T_pmr_projection.inverse() * start_pmr / field.frame.resolution;
  const auto column = static_cast<int>(std::lround(p[0])), row = static_cast<int>(std::lround(p[1]));
  if (column < 0 || row < 0 || column >= field.frame.size.width || row >= field.frame.size.height) return false;
  return !std::isnan(field.displacement_pmr.at<cv::Vec3f>(row, column)[0]);
}

double coverageOf(const DisplacementField& field, const PhantomScene& scene, int from, int to) {
  const Eigen::Vector2d centre = scene.description().head.craniotomy.centre;
  const Eigen::Vector2d reach = 1.5 * scene.description().head.craniotomy.radii;
  std::vector<Eigen::Vector2d> samples;
  for (double y = centre[1] - reach[1]; y <= centre[1] + reach[1]; y += kSampleSpacing)
    for (double x = centre[0] - reach[0]; x <= centre[0] + reach[0]; x += kSampleSpacing)
      if (scene.rimDistance(x, y) > 0) samples.emplace_back(x, y);
  std::vector<char> corresponding(samples.size(), 0), reported(samples.size(), 0);
  cv::parallel_for_(cv::Range(0, static_cast<int>(samples.size())), [&](const cv::Range& range) {
    for (int i = range.start; i < range.end; ++i) {
      const auto at = static_cast<std::size_t>(i);
      const double x = samples[at][0], y = samples[at][1];
      if (!isCorresponding(scene, from, x, y) || !isCorresponding(scene, to, x, y)) continue;
      corresponding[at] = 1;
      reported[at] = isReported(field, scene.pointAt(from, x, y)) ? 1 : 0;
    }
  });
  const auto all = std::count(corresponding.begin(), corresponding.end(), 1);
  return all == 0 ? 0.0
                  : static_cast<double>(std::count(reported.begin(), reported.end(), 1)) / static_cast<double>(all);
}

}  // namespace

bool VectorError::right() const { return !foreign && in_plane <= kRightWithin && height <= kRightWithin; }

std::optional<VectorError> errorAt(const DisplacementField& field, const PhantomScene& scene, int from, int to, int row,
                                   int column) {
  const cv::Vec3f& d = field.displacement_pmr.at<cv::Vec3f>(row, column);
  if (std::isnan(d[0])) return std::nullopt;
  const auto tissue = scene.materialOf(toEigen(field.start_pmr.at<cv::Vec3f>(row, column)), from);
  if (!tissue) return VectorError{true};
  const double x = tissue->material[0], y = tissue->material[1];
  if (scene.rimDistance(x, y) < 0) return std::nullopt;
  if (scene.materialAt(to, x, y) == Material::kHole) return VectorError{true};
  const Eigen::Vector3d error = toEigen(d) - scene.displacement(from, to, x, y), normal = field.frame.normal_pmr();
  const double height = error.dot(normal);
  return VectorError{false, error.norm(), (error - height * normal).norm(), std::abs(height)};
}

void Reliability::add(double confidence, bool right) {
  Bin& bin = bins[std::min(bins.size() - 1, static_cast<std::size_t>(confidence * static_cast<double>(bins.size())))];
  bin.confidence += confidence;
  ++bin.vectors;
  if (right) ++bin.right;
}

Reliability& Reliability::operator+=(const Reliability& other) {
  for (std::size_t i = 0; i < bins.size(); ++i) {
    bins[i].confidence += other.bins[i].confidence;
    bins[i].vectors += other.bins[i].vectors;
    bins[i].right += other.bins[i].right;
  }
  return *this;
}

FieldError compareWithTruth(const DisplacementField& field, const PhantomScene& scene, int from, int to, int stride) {
  const int rows = (field.frame.size.height + stride - 1) / stride;
  std::vector<RowResult> results(static_cast<std::size_t>(rows));
  cv::parallel_for_(cv::Range(0, rows), [&](const cv::Range& range) {
    for (int i = range.start; i < range.end; ++i)
      results[static_cast<std::size_t>(i)] = compareRow(field, scene, from, to, i * stride, stride);
  });
  FieldError error;
  std::vector<double> errors;
  double squares = 0;
  for (const RowResult& row : results) {
    squares += row.squares;
    errors.insert(errors.end(), row.errors.begin(), row.errors.end());
    error.foreign_points += row.foreign;
    error.reliability += row.reliability;
  }
  std::sort(errors.begin(), errors.end());
  error.compared_points = errors.size();
  const double unknown = std::numeric_limits<double>::quiet_NaN();
  error.median = errors.empty() ? unknown : errors[errors.size() / 2];
  error.p95 = errors.empty() ? unknown : errors[errors.size() * 95 / 100];
  error.largest = errors.empty() ? unknown : errors.back();
  error.over_uncertainty =
      errors.empty() || field.uncertainty.empty() ? unknown : std::sqrt(squares / static_cast<double>(errors.size()));
  error.coverage = coverageOf(field, scene, from, to);
  return error;
}

OutlineError compareOutline(const DisplacementField& field, const cv::Mat& shown, const cv::Mat& height,
                            const PhantomScene& scene, int from, int stride) {
  OutlineError error;
  error.known = !field.brain.empty();
  if (!error.known) return error;
  std::vector<cortshift_stereo_phantom::Outline> cotton;
  for (const auto& pool : scene.description().stages[static_cast<std::size_t>(from)].blood)
    if (pool.cotton) cotton.emplace_back(pool.outline);
  double both = 0, either = 0, true_count = 0, true_sum = 0, said_count = 0, said_sum = 0;
  for (int row = 0; row < field.frame.size.height; row += stride)
    for (int column = 0; column < field.frame.size.width; column += stride) {
      if (shown.at<uchar>(row, column) == 0) continue;
      const Eigen::Vector3d point =
          field.frame.T_pmr_projection *
          Eigen::Vector3d(column * field.frame.resolution, row * field.frame.resolution, height.at<float>(row, column));
      const auto tissue = scene.materialOf(point, from);
      const bool truly = tissue && scene.rimDistance(tissue->material[0], tissue->material[1]) > 0 &&
                         std::none_of(cotton.begin(), cotton.end(), [&](const auto& pad) {
                           return pad.radius(tissue->material[0], tissue->material[1]).value < 1;
                         });
      const bool said = field.brain.at<uchar>(row, column) != 0;
      both += truly && said ? 1 : 0;
      either += truly || said ? 1 : 0;
      const cv::Vec3f& d = field.displacement_pmr.at<cv::Vec3f>(row, column);
      if (std::isnan(d[0])) continue;
      true_sum += truly ? cv::norm(d) : 0;
      true_count += truly ? 1 : 0;
      said_sum += said ? cv::norm(d) : 0;
      said_count += said ? 1 : 0;
    }
  error.intersection_over_union = both / either;
  error.mean_ratio = (said_sum / said_count) / (true_sum / true_count);
  return error;
}

std::string toText(const FieldError& error) {
  char text[320];
  std::snprintf(text, sizeof text,
                "error_median_mm: %.4f\nerror_p95_mm: %.4f\nerror_max_mm: %.4f\ncoverage: %.4f\ncompared_points: %zu\n"
                "foreign_points: %zu\n",
                1e3 * error.median, 1e3 * error.p95, 1e3 * error.largest, error.coverage, error.compared_points,
                error.foreign_points);
  return text;
}

}  // namespace cortshift_tracking_phantom
