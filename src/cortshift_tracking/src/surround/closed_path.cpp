#include "cortshift_tracking/surround/closed_path.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

namespace cortshift_tracking {
namespace {

constexpr int kSteepest = 2;  // rows from one column to the next
constexpr float kNever = -1e9F;

/// Once around and back to the first column, from the row `start`, or from any where it is negative, to `end`, or to
/// any.
std::vector<int> bestPath(const cv::Mat& score, float bend, int first_column, int start, int end) {
  const int rows = score.rows, columns = score.cols;
  std::vector<float> best(static_cast<std::size_t>(rows), start < 0 ? 0 : kNever), next(best.size());
  if (start >= 0) best[static_cast<std::size_t>(start)] = 0;
  cv::Mat from(columns, rows, CV_32SC1);
  for (int i = 0; i < columns; ++i) {
    const int column = (first_column + i) % columns;
    for (int row = 0; row < rows; ++row) {
      float most = 2 * kNever;
      for (int change = -kSteepest; change <= kSteepest; ++change) {
        const int before = row + change;
        if (before < 0 || before >= rows) continue;
        const float value = best[static_cast<std::size_t>(before)] - bend * static_cast<float>(std::abs(change));
        if (value <= most) continue;
        most = value;
        from.at<int>(i, row) = before;
      }
      next[static_cast<std::size_t>(row)] = most + score.at<float>(row, column);
    }
    best.swap(next);
  }
  std::vector<int> path(static_cast<std::size_t>(columns));
  int row = end >= 0 ? end : static_cast<int>(std::max_element(best.begin(), best.end()) - best.begin());
  for (int i = columns - 1; i >= 0; --i) {
    path[static_cast<std::size_t>((first_column + i) % columns)] = row;
    row = from.at<int>(i, row);
  }
  return path;
}

}  // namespace

cv::Point2f Unrolling::at(int column, float row) const {
  const double angle = 2 * CV_PI * column / kDirections;
  const float radius = base[static_cast<std::size_t>(column)] + first + row * step;
  return centre +
         cv::Point2f(radius * static_cast<float>(std::cos(angle)), radius * static_cast<float>(std::sin(angle)));
}

cv::Mat Unrolling::unroll(const cv::Mat& picture) const {
  cv::Mat places(rows, kDirections, CV_32FC2), out;
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < kDirections; ++column)
      places.at<cv::Point2f>(row, column) = at(column, static_cast<float>(row));
  cv::remap(picture, out, places, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_CONSTANT,
            cv::Scalar::all(std::numeric_limits<double>::quiet_NaN()));
  return out;
}

std::vector<int> bestClosedPath(const cv::Mat& score, float bend) {
  const int half = score.cols / 2;
  const int row = bestPath(score, bend, 0, -1, -1)[static_cast<std::size_t>(half)];
  return bestPath(score, bend, half + 1, row, row);
}

cv::Mat meanAround(const cv::Mat& unrolled, cv::Size window, cv::Mat& share) {
  cv::Mat known = unrolled == unrolled, value = unrolled.clone(), weight;
  cv::patchNaNs(value, 0);
  known.convertTo(weight, CV_32F, 1.0 / 255);
  const int margin = window.width;
  const auto mean = [&](const cv::Mat& of) {
    cv::Mat wide, out;
    cv::copyMakeBorder(of, wide, 0, 0, margin, margin, cv::BORDER_WRAP);
    cv::boxFilter(wide, out, CV_32F, window, cv::Point(-1, -1), true, cv::BORDER_CONSTANT);
    return cv::Mat(out.colRange(margin, margin + of.cols)).clone();
  };
  share = mean(weight);
  return mean(value) / cv::max(share, 1e-6F);
}

}  // namespace cortshift_tracking
