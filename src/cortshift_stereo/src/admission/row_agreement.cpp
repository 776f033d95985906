#include "cortshift_stereo/admission/row_agreement.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "cortshift_stereo/geometry/lens.hpp"

namespace cortshift_stereo {
namespace {

constexpr int kParameters = 4;  // turns about x, y, z and the scale
using Row = cv::Vec<double, kParameters>;
using Square = cv::Matx<double, kParameters, kParameters>;

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

cv::Point2f rawPosition(const cv::Mat& map, const cv::Point2d& rectified) {
  const int x = std::clamp(static_cast<int>(rectified.x), 0, map.cols - 2);
  const int y = std::clamp(static_cast<int>(rectified.y), 0, map.rows - 2);
  const auto u = static_cast<float>(rectified.x - x), v = static_cast<float>(rectified.y - y);
  const auto at = [&](int dx, int dy) { return map.at<cv::Vec2f>(y + dy, x + dx); };
  const cv::Vec2f raw = (1 - v) * ((1 - u) * at(0, 0) + u * at(1, 0)) + v * ((1 - u) * at(0, 1) + u * at(1, 1));
  return {raw[0], raw[1]};
}

double gapIfSwapped(const std::vector<MatchedPoint>& points, const Rectifier& rectifier) {
  std::vector<cv::Point2d> left_raw, right_raw;
  for (const MatchedPoint& point : points) {
    left_raw.push_back(rawPosition(rectifier.leftMap(), point.left));
    right_raw.push_back(rawPosition(rectifier.rightMap(), point.right));
  }
  const std::vector<cv::Point2d> left_as_right = rectifyPoints(rectifier.model().right, left_raw);
  const std::vector<cv::Point2d> right_as_left = rectifyPoints(rectifier.model().left, right_raw);
  std::vector<double> gaps;
  for (std::size_t i = 0; i < points.size(); ++i) gaps.push_back(std::abs(left_as_right[i].y - right_as_left[i].y));
  return median(gaps);
}

struct Fit {
  Row parameters = Row::all(0);
  Square covariance = Square::zeros();
  double spread = 0;
};

Fit fitMotion(const std::vector<Row>& rows, const std::vector<double>& gaps, const std::vector<MatchedPoint>& points) {
  constexpr double kTukey = 4.685;       // 95 % of the efficiency of least squares where errors are normal
  constexpr double kLeastSpread = 0.02;  // [px] interpolation
  constexpr int kRounds = 10;
  Fit fit;
  std::vector<double> own;
  for (const MatchedPoint& point : points) own.push_back(point.sd_row);
  fit.spread = std::max(kLeastSpread, 1.4826 * median([&] {
                                        const double middle = median(gaps);
                                        std::vector<double> away;
                                        for (const double gap : gaps) away.push_back(std::abs(gap - middle));
                                        return away;
                                      }()));
  for (int round = 0; round < kRounds; ++round) {
    Square A = Square::zeros();
    Row b = Row::all(0);
    double chi2 = 0, weights = 0;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const double variance = own[i] * own[i] + fit.spread * fit.spread;
      const double r = gaps[i] - (round == 0 ? median(gaps) : rows[i].dot(fit.parameters));
      const double t = r * r / (kTukey * kTukey * variance);
      if (t >= 1) continue;
      const double w = (1 - t) * (1 - t) / variance;
      A += w * rows[i] * rows[i].t();
      b += w * gaps[i] * rows[i];
      chi2 += w * r * r;
      weights += w * variance;
    }
    bool regular = false;
    const Square inverse = A.inv(cv::DECOMP_CHOLESKY, &regular);
    if (!regular) break;
    fit.parameters = inverse * b;
    // Weighted residuals tell what the standard errors of the points did not.
    fit.covariance = inverse * std::max(1.0, chi2 / std::max(1.0, weights - kParameters));
    std::vector<double> beyond;
    for (std::size_t i = 0; i < rows.size(); ++i) beyond.push_back(std::abs(gaps[i] - rows[i].dot(fit.parameters)));
    const double robust = 1.4826 * median(beyond), typical = median(own);
    fit.spread = std::max(kLeastSpread, std::sqrt(std::max(0.0, robust * robust - typical * typical)));
  }
  return fit;
}

}  // namespace

RowAgreement agreementOf(const std::vector<MatchedPoint>& points, const Rectifier& rectifier) {
  RowAgreement agreement;
  agreement.matched = static_cast<int>(points.size());
  if (points.size() <= kParameters) return agreement;
  const cv::Matx34d& P = rectifier.model().right.P;
  const double f = P(1, 1);
  std::vector<Row> rows;
  std::vector<double> gaps, sizes;
  for (const MatchedPoint& point : points) {
    const double u = (point.right.x - P(0, 2)) / P(0, 0), v = (point.right.y - P(1, 2)) / f;
    rows.push_back(f * Row(-(1 + v * v), u * v, u, v));
    gaps.push_back(point.right.y - point.left.y);
    sizes.push_back(std::abs(gaps.back()));
  }
  agreement.offset = median(gaps);
  agreement.spread_as_is = median(sizes);
  agreement.spread_if_swapped = gapIfSwapped(points, rectifier);
  const Fit fit = fitMotion(rows, gaps, points);
  agreement.spread = fit.spread;
  const auto estimate = [&](int i) { return Estimate{fit.parameters[i], std::sqrt(fit.covariance(i, i))}; };
  agreement.turn_x = estimate(0);
  agreement.turn_y = estimate(1);
  agreement.turn_z = estimate(2);
  agreement.scale = estimate(3);
  // Root mean square of the gaps of both turns, and its error by propagation.
  Square mean = Square::zeros();
  for (const Row& row : rows) {
    const Row turns(row[0], 0, row[2], 0);
    mean += turns * turns.t() * (1.0 / static_cast<double>(rows.size()));
  }
  const Row slope = mean * fit.parameters;
  const double size = std::sqrt(std::max(0.0, fit.parameters.dot(slope)));
  agreement.misalignment = {size, size > 0 ? std::sqrt(std::max(0.0, slope.dot(fit.covariance * slope))) / size : 0};
  return agreement;
}

}  // namespace cortshift_stereo
