#include "refinement/data_term.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <opencv2/core/hal/intrin.hpp>
#include <vector>

#include "cortshift_flow/vectorised.hpp"
#include "refinement/cells.hpp"
#include "refinement/cubic.hpp"

namespace cortshift_stereo {
namespace {

constexpr double kInterpolationError = 0.05;  // [px] times the gradient: the error of resampling
constexpr double kOutlier = 4.5;      // [standard deviations] a residual of this size keeps a quarter of its weight
constexpr double kLeastNoise = 0.25;  // [grey levels]: quantisation after the blur
constexpr int kSums = 7;              // in CellSums

/// Where each pixel of a line lies in the right image: the pixel to the left of the place, and the distance from it; a
/// place outside the image is moved to its rim.
CORTSHIFT_VECTORISED
void landRow(const float* d, int* column, float* fraction, int width) {
  const auto last = static_cast<float>(width - 3);
#pragma GCC ivdep
  for (int x = 0; x < width; ++x) {
    const float at = std::min(std::max(static_cast<float>(x) - d[x], 1.0f), last);
    column[x] = static_cast<int>(at);
    fraction[x] = at - static_cast<float>(column[x]);
  }
}

/// Cubic convolution between four taps as a polynomial, as the derivative is wanted too.
/// @param seen    not 0 where both images show tissue
/// @param counts  1 where that holds inside the right image and on the cells' surface, else 0
CORTSHIFT_VECTORISED
void interpolateRow(const float* taps, const float* fraction, const int* seen, const float* d, const float* surface,
                    float* warped, float* slope, float* counts, int width) {
  const auto last = static_cast<float>(width - 3);
#pragma GCC ivdep
  for (int x = 0; x < width; ++x) {
    const float p0 = taps[4 * x], p1 = taps[4 * x + 1], p2 = taps[4 * x + 2], p3 = taps[4 * x + 3], t = fraction[x];
    const float c1 = 0.5f * (p2 - p0);
    const float c2 = p0 - 2.5f * p1 + 2 * p2 - 0.5f * p3;
    const float c3 = 1.5f * (p1 - p2) + 0.5f * (p3 - p0);
    warped[x] = p1 + t * (c1 + t * (c2 + t * c3));
    slope[x] = c1 + t * (2 * c2 + t * 3 * c3);
    const float at = static_cast<float>(x) - d[x];
    counts[x] =
        (seen[x] != 0) & (at >= 1.0f) & (at <= last) & (std::abs(d[x] - surface[x]) < kSameSurface) ? 1.0f : 0.0f;
  }
}

/// Adds each pixel of a line to the sums of its column of cells.
CORTSHIFT_VECTORISED
void addRow(const float* left, const float* up, const float* down, const float* gain, const float* warped,
            const float* slope, const float* counts, float noise2, float* const* sums, int width) {
  constexpr auto outlier = static_cast<float>(1 / (kOutlier * kOutlier));
  constexpr auto registration2 = static_cast<float>(kInterpolationError * kInterpolationError);
  float *sum_w = sums[0], *wr = sums[1], *wg = sums[2], *wgr = sums[3], *wgg = sums[4], *sum_left = sums[5],
        *sum_right = sums[6];
#pragma GCC ivdep
  for (int x = 2; x < width - 2; ++x) {
    const float slope_left = (8 * (left[x + 1] - left[x - 1]) - (left[x + 2] - left[x - 2])) * (1.0f / 12);
    const float slope_down = 0.5f * (down[x] - up[x]);
    const float r = left[x] - gain[x] * warped[x];
    const float g = 0.5f * (slope_left + gain[x] * slope[x]);
    const float variance = noise2 + registration2 * (slope_left * slope_left + slope_down * slope_down);
    const float soft = 1 / (variance + r * r * outlier);
    const float w = counts[x] * variance * soft * soft;  // falls as 1/r^4: outliers have no influence
    sum_w[x] += w;
    wr[x] += w * r;
    wg[x] += w * g;
    wgr[x] += w * g * r;
    wgg[x] += w * g * g;
    sum_left[x] += counts[x] * left[x];
    sum_right[x] += counts[x] * warped[x];
  }
}

cv::Mat_<float>& out(CellSums& cells, int k) {
  cv::Mat_<float>* const all[kSums] = {&cells.w,   &cells.wr,   &cells.wg,   &cells.wgr,
                                       &cells.wgg, &cells.left, &cells.right};
  return *all[k];
}

void reduce(const float* pixels, int width, int cell, float* cells) {
  for (int begin = 0; begin < width; begin += cell) {
    float sum = 0;
    for (int x = begin; x < std::min(begin + cell, width); ++x) sum += pixels[x];
    *cells++ = sum;
  }
}

}  // namespace

/// One line of pixels, kept apart in arrays so that the arithmetic runs in vector registers. Lines of a power of two
/// would share a few lines of the cache; a pad between them spreads them.
class DataTerm::Row {
 public:
  explicit Row(int width)
      : column(static_cast<std::size_t>(width)), seen(column.size()), lines_(kLines, width + kPad, 0.0f) {
    for (int k = 0; k < kSums; ++k) sums[k] = lines_[k];
    gain = lines_[kSums];
    warped = lines_[kSums + 1];
    slope = lines_[kSums + 2];
    counts = lines_[kSums + 3];
    fraction = lines_[kSums + 4];
    taps = lines_[kSums + 5];
  }
  void clear() { lines_.rowRange(0, kSums).setTo(0); }
  float *sums[kSums], *gain, *warped, *slope, *counts, *fraction, *taps;  // four taps a pixel
  std::vector<int> column, seen;

 private:
  static constexpr int kLines = kSums + 9, kPad = 48;
  cv::Mat_<float> lines_;
};
CellSums DataTerm::sum(const cv::Mat& d, const cv::Mat& surface, const cv::Mat& gain, double noise, int cell,
                       int row_step) const {
  CellSums cells(cellsOf(d.size(), cell));
  cv::parallel_for_(cv::Range(0, cells.w.rows), [&](const cv::Range& rows) {
    Row row(d.cols);
    for (int cy = rows.start; cy < rows.end; ++cy) {
      row.clear();
      for (int x = 0; x < d.cols; ++x) row.gain[x] = gain.at<float>(cy, x / cell);
      for (int y = cy * cell; y < std::min((cy + 1) * cell, d.rows); y += row_step) {
        warp(y, d.ptr<float>(y), surface.ptr<float>(y), row);
        add(y, static_cast<float>(noise * noise), row);
      }
      for (int k = 0; k < kSums; ++k) reduce(row.sums[k], d.cols, cell, out(cells, k)[cy]);
    }
  });
  return cells;
}

double DataTerm::noise(const cv::Mat& d) const {
  constexpr int kSkip = 5;
  cv::Mat_<float> sampled(std::max(0, (d.rows - 4 + kSkip - 1) / kSkip), std::max(0, (d.cols - 6 + kSkip - 1) / kSkip));
  cv::parallel_for_(cv::Range(0, sampled.rows), [&](const cv::Range& rows) {
    for (int row = rows.start; row < rows.end; ++row)
      for (int column = 0; column < sampled.cols; ++column) {
        const int y = 2 + row * kSkip, x = 3 + column * kSkip;
        sampled(row, column) = std::abs(residual(d, y, x) - residual(d, y, x - 2));
      }
  });
  std::vector<float> differences;
  std::copy_if(sampled.begin(), sampled.end(), std::back_inserter(differences),
               [](float difference) { return std::isfinite(difference); });
  if (differences.empty()) return kLeastNoise;
  const auto middle = differences.begin() + static_cast<std::ptrdiff_t>(differences.size() / 2);
  std::nth_element(differences.begin(), middle, differences.end());
  return std::max(kLeastNoise, 1.4826 * static_cast<double>(*middle) / std::sqrt(2.0));
}

/// right(x - d) and its derivative; counts is 1 where both images can be compared, else 0.
void DataTerm::warp(int y, const float* d, const float* surface, Row& row) const {
  const int width = pair_.right.cols;
  const float* right = pair_.right.ptr<float>(y);
  const uint8_t* known = known_.ptr<uint8_t>(y);
  const uint8_t* usable = pair_.right_usable.ptr<uint8_t>(y);
  landRow(d, row.column.data(), row.fraction, width);
  for (int x = 0; x < width; ++x) {
    const int column = row.column[static_cast<std::size_t>(x)];
    cv::v_store(row.taps + 4 * x, cv::v_load(right + column - 1));
    row.seen[static_cast<std::size_t>(x)] = known[x] & usable[column] & usable[column + 1];
  }
  interpolateRow(row.taps, row.fraction, row.seen.data(), d, surface, row.warped, row.slope, row.counts, width);
}

void DataTerm::add(int y, float noise2, Row& row) const {
  const cv::Mat& left = pair_.left;
  addRow(left.ptr<float>(y), left.ptr<float>(std::max(y - 1, 0)), left.ptr<float>(std::min(y + 1, left.rows - 1)),
         row.gain, row.warped, row.slope, row.counts, noise2, row.sums, left.cols);
}

float DataTerm::residual(const cv::Mat& d, int y, int x) const {
  const float at = static_cast<float>(x) - d.at<float>(y, x);
  const int column = static_cast<int>(at);
  if (at < 1 || column >= d.cols - 2 || !known_.at<uint8_t>(y, x)) return std::numeric_limits<float>::quiet_NaN();
  const CubicWeights weights(at - static_cast<float>(column));
  return pair_.left.at<float>(y, x) - weights.apply(pair_.right.ptr<float>(y) + column - 1);
}

}  // namespace cortshift_stereo
