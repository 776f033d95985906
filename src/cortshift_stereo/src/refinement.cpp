#include "cortshift_stereo/refinement.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "cubic.hpp"
#include "fill.hpp"
#include "thin_plate.hpp"

namespace cortshift_stereo {
namespace {

// Tuned on phantoms with and without noise; not per site.
constexpr double kSmoothness = 2e3;           // mu [px^2]: weight of bending against data
constexpr double kTypicalBending = 0.0007;    // [px / px^2] beyond which psi grows linearly
constexpr double kInterpolationError = 0.05;  // [px] the gradient times this is the error of resampling
constexpr double kOutlier = 4.5;              // [standard deviations] of the residual that halve its influence and more
constexpr double kCorrelatedPixels = 10;      // neighbours share their noise: images are blurred before resampling
constexpr double kLeastNoise = 0.25;          // [grey levels]: quantisation after the blur
constexpr double kPhotometricReach = 24;      // [px] over which gain and offset vary
constexpr double kTrustInStart = 0.05;        // [1/px^2] per pixel: holds where there is no texture to refine by
constexpr int kFinestCell = 4;                // [px]
constexpr int kSteps = 14;

constexpr double kHalfConfidence = 0.1;  // [px] deviation
constexpr float kSameSurface = 0.75f;    // [px] from the cells' surface: pixels beyond lie on another one

/// Weighted sums over cells of pixels: residual r, its derivative g, both images.
struct CellSums {
  explicit CellSums(const cv::Size& size) {
    for (cv::Mat_<float>* sum : {&w, &wr, &wg, &wgr, &wgg, &left, &right}) sum->create(size);
  }
  cv::Mat_<float> w, wr, wg, wgr, wgg, left, right;
};

cv::Size cellsOf(const cv::Size& image, int cell) {
  return {(image.width + cell - 1) / cell, (image.height + cell - 1) / cell};
}

/// Large cells have more than enough rows.
int rowStep(int cell) { return cell > 4 ? 2 : 1; }

cv::Mat blurCells(const cv::Mat& values, double sigma) {
  cv::Mat out;
  cv::GaussianBlur(values, out, {}, std::max(0.5, sigma), 0, cv::BORDER_REFLECT);
  return out;
}

/// Linearised comparison of the left image with the warped right one.
class DataTerm {
 public:
  /// @param known  CV_8UC1, 255 where the left pixel may be used
  DataTerm(const RectifiedPair& pair, const cv::Mat& known) : pair_(pair), known_(known) {}

  /// @param d        CV_32FC1 [px], finite
  /// @param surface  the cells' surface at each pixel; pixels of `d` far from it do not count
  /// @param gain     of the right image, per cell
  /// @param noise    [grey levels] standard deviation of the residual
  CellSums sum(const cv::Mat& d, const cv::Mat& surface, const cv::Mat& gain, double noise, int cell) const {
    CellSums cells(cellsOf(d.size(), cell));
    cv::parallel_for_(cv::Range(0, cells.w.rows), [&](const cv::Range& rows) {
      Row row(d.cols);
      for (int cy = rows.start; cy < rows.end; ++cy) {
        row.clear();
        for (int y = cy * cell; y < std::min((cy + 1) * cell, d.rows); y += rowStep(cell)) {
          warp(y, d.ptr<float>(y), surface.ptr<float>(y), row);
          add(y, gain.ptr<float>(cy), static_cast<float>(noise * noise), cell, row);
        }
        for (std::size_t k = 0; k < Row::kSums; ++k) reduce(row.sums[k], cell, out(cells, k)[cy], cells.w.cols);
      }
    });
    return cells;
  }

  /// Standard deviation of the residual [grey levels], robust, from pixels that are two apart: what varies slowly
  /// (gain, offset, a disparity that is a little wrong) cancels.
  double noise(const cv::Mat& d) const {
    std::vector<float> differences;
    constexpr int kSkip = 5;
    for (int y = 2; y < d.rows - 2; y += kSkip)
      for (int x = 3; x < d.cols - 3; x += kSkip) {
        const float difference = residual(d, y, x) - residual(d, y, x - 2);
        if (std::isfinite(difference)) differences.push_back(std::abs(difference));
      }
    if (differences.empty()) return kLeastNoise;
    const auto middle = differences.begin() + static_cast<std::ptrdiff_t>(differences.size() / 2);
    std::nth_element(differences.begin(), middle, differences.end());
    return std::max(kLeastNoise, 1.4826 * static_cast<double>(*middle) / std::sqrt(2.0));
  }

 private:
  /// One line of pixels, kept apart in arrays so that the arithmetic runs in vector registers.
  struct Row {
    static constexpr std::size_t kSums = 7;
    explicit Row(int width) : warped(static_cast<std::size_t>(width)), slope(warped), counts(warped), fraction(warped) {
      for (std::vector<float>& tap : taps) tap.resize(warped.size());
      for (std::vector<float>& sum : sums) sum.resize(warped.size());
    }
    void clear() {
      for (std::vector<float>& sum : sums) std::fill(sum.begin(), sum.end(), 0.0f);
    }
    std::vector<float> warped, slope, counts, fraction;
    std::vector<float> taps[4];
    std::vector<float> sums[kSums];
  };
  static cv::Mat_<float>& out(CellSums& cells, std::size_t k) {
    cv::Mat_<float>* const all[Row::kSums] = {&cells.w,   &cells.wr,   &cells.wg,   &cells.wgr,
                                              &cells.wgg, &cells.left, &cells.right};
    return *all[k];
  }

  /// right(x - d) and its derivative; counts is 1 where both images can be compared, else 0.
  void warp(int y, const float* d, const float* surface, Row& row) const {
    const int width = pair_.right.cols;
    const float* right = pair_.right.ptr<float>(y);
    const uint8_t* known = known_.ptr<uint8_t>(y);
    const uint8_t* usable = pair_.right_usable.ptr<uint8_t>(y);
    const auto last = static_cast<float>(width - 3);
    float *p0 = row.taps[0].data(), *p1 = row.taps[1].data(), *p2 = row.taps[2].data(), *p3 = row.taps[3].data();
    float *fraction = row.fraction.data(), *counts = row.counts.data();
    for (int x = 0; x < width; ++x) {
      const float at = static_cast<float>(x) - d[x];
      const float inside = std::min(std::max(at, 1.0f), last);
      const int column = static_cast<int>(inside);
      const float* p = right + column - 1;
      p0[x] = p[0];
      p1[x] = p[1];
      p2[x] = p[2];
      p3[x] = p[3];
      fraction[x] = inside - static_cast<float>(column);
      const bool good = (known[x] & usable[column] & usable[column + 1]) != 0 && at == inside;
      counts[x] = good ? 1.0f : 0.0f;
    }
    float *warped = row.warped.data(), *slope = row.slope.data();
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {  // cubic convolution as a polynomial, as the derivative is wanted too
      const float t = fraction[x];
      const float c1 = 0.5f * (p2[x] - p0[x]);
      const float c2 = p0[x] - 2.5f * p1[x] + 2 * p2[x] - 0.5f * p3[x];
      const float c3 = 1.5f * (p1[x] - p2[x]) + 0.5f * (p3[x] - p0[x]);
      warped[x] = p1[x] + t * (c1 + t * (c2 + t * c3));
      slope[x] = c1 + t * (2 * c2 + t * 3 * c3);
      counts[x] = std::abs(d[x] - surface[x]) < kSameSurface ? counts[x] : 0.0f;
    }
  }

  void add(int y, const float* gain, float noise2, int cell, Row& row) const {
    const int width = pair_.left.cols;
    const float* left = pair_.left.ptr<float>(y);
    const float* up = pair_.left.ptr<float>(std::max(y - 1, 0));
    const float* down = pair_.left.ptr<float>(std::min(y + 1, pair_.left.rows - 1));
    constexpr auto outlier = static_cast<float>(1 / (kOutlier * kOutlier));
    const auto registration2 = static_cast<float>(kInterpolationError * kInterpolationError);
    const float *warped = row.warped.data(), *slope = row.slope.data(), *counts = row.counts.data();
    float *w_ = row.sums[0].data(), *wr = row.sums[1].data(), *wg = row.sums[2].data(), *wgr = row.sums[3].data(),
          *wgg = row.sums[4].data(), *sum_left = row.sums[5].data(), *sum_right = row.sums[6].data();
    for (int begin = 0; begin < width; begin += cell) {
      const float a = gain[begin / cell];
      const int end = std::min(begin + cell, width - 2);
#pragma GCC ivdep
      for (int x = std::max(begin, 2); x < end; ++x) {
        const float slope_left = (8 * (left[x + 1] - left[x - 1]) - (left[x + 2] - left[x - 2])) * (1.0f / 12);
        const float slope_down = 0.5f * (down[x] - up[x]);
        const float r = left[x] - a * warped[x];
        const float g = 0.5f * (slope_left + a * slope[x]);
        const float variance = noise2 + registration2 * (slope_left * slope_left + slope_down * slope_down);
        const float soft = 1 / (variance + r * r * outlier);
        const float w = counts[x] * variance * soft * soft;  // falls faster than the gradient of any outlier grows
        w_[x] += w;
        wr[x] += w * r;
        wg[x] += w * g;
        wgr[x] += w * g * r;
        wgg[x] += w * g * g;
        sum_left[x] += counts[x] * left[x];
        sum_right[x] += counts[x] * warped[x];
      }
    }
  }

  static void reduce(const std::vector<float>& pixels, int cell, float* cells, int count) {
    for (int cx = 0; cx < count; ++cx) {
      const int end = std::min((cx + 1) * cell, static_cast<int>(pixels.size()));
      float sum = 0;
      for (int x = cx * cell; x < end; ++x) sum += pixels[static_cast<std::size_t>(x)];
      cells[cx] = sum;
    }
  }

  float residual(const cv::Mat& d, int y, int x) const {
    const float at = static_cast<float>(x) - d.at<float>(y, x);
    const int column = static_cast<int>(at);
    if (at < 1 || column >= d.cols - 2 || !known_.at<uint8_t>(y, x)) return std::numeric_limits<float>::quiet_NaN();
    const CubicWeights weights(at - static_cast<float>(column));
    return pair_.left.at<float>(y, x) - weights.apply(pair_.right.ptr<float>(y) + column - 1);
  }

  const RectifiedPair& pair_;
  const cv::Mat known_;
};

/// Smooths away matching noise below a pixel, keeps larger steps.
cv::Mat smoothBelowAPixel(const cv::Mat& d) {
  cv::Mat smooth(d.size(), CV_32FC1);
  constexpr double kStrips = 4;  // OpenCV blurs floats in one thread; it sees the rows around a strip
  cv::parallel_for_(
      cv::Range(0, d.rows),
      [&](const cv::Range& rows) { cv::GaussianBlur(d.rowRange(rows), smooth.rowRange(rows), {}, 2.0); }, kStrips);
  cv::parallel_for_(cv::Range(0, d.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      const float* from = d.ptr<float>(y);
      float* to = smooth.ptr<float>(y);
      for (int x = 0; x < d.cols; ++x) to[x] = std::abs(from[x] - to[x]) > kSameSurface ? from[x] : to[x];
    }
  });
  return smooth;
}

/// Mean over each cell of the pixels on the surface that its middle lies on.
cv::Mat meanOfCells(const cv::Mat& d, int cell) {
  cv::Mat_<float> means(cellsOf(d.size(), cell));
  cv::parallel_for_(cv::Range(0, means.rows), [&](const cv::Range& rows) {
    for (int cy = rows.start; cy < rows.end; ++cy)
      for (int cx = 0; cx < means.cols; ++cx) {
        const int end_y = std::min((cy + 1) * cell, d.rows), end_x = std::min((cx + 1) * cell, d.cols);
        const float middle = d.at<float>((cy * cell + end_y) / 2, (cx * cell + end_x) / 2);
        float sum = 0, count = 0;
        for (int y = cy * cell; y < end_y; ++y) {
          const float* row = d.ptr<float>(y);
          for (int x = cx * cell; x < end_x; ++x) {
            const float same = std::abs(row[x] - middle) < kSameSurface ? 1.0f : 0.0f;
            sum += same * row[x];
            count += same;
          }
        }
        means(cy, cx) = sum / count;
      }
  });
  return std::move(means);
}

/// Share of each cell that a mask covers.
cv::Mat shareOfCells(const cv::Mat& mask, int cell) {
  const cv::Size cells = cellsOf(mask.size(), cell);
  cv::Mat whole, share;
  cv::copyMakeBorder(mask, whole, 0, cells.height * cell - mask.rows, 0, cells.width * cell - mask.cols,
                     cv::BORDER_REPLICATE);
  whole.convertTo(whole, CV_32F, 1.0 / 255);
  cv::resize(whole, share, cells, 0, 0, cv::INTER_AREA);
  return share;
}

/// The surface through the cells, at each pixel.
cv::Mat surfaceThrough(const cv::Mat& cells, const cv::Size& size, int cell) {
  cv::Mat out;
  cv::resize(cells, out, cells.size() * cell, 0, 0, cv::INTER_CUBIC);
  return out(cv::Rect({0, 0}, size));
}

/// Pixels on the old surface move to the new one; others stay.
void follow(cv::Mat& d, const cv::Mat& before, const cv::Mat& after) {
  cv::parallel_for_(cv::Range(0, d.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      float* to = d.ptr<float>(y);
      const float *from = before.ptr<float>(y), *next = after.ptr<float>(y);
      for (int x = 0; x < d.cols; ++x) to[x] = std::abs(to[x] - from[x]) < kSameSurface ? next[x] : to[x];
    }
  });
}

/// Stiffness of each cell: mu, less where the surface bends more than tissue does between its folds.
cv::Mat bendingWeights(const cv::Mat& cells, int cell) {
  const double typical = kTypicalBending * cell * cell;
  cv::Mat bending = squaredBending(cells), weights;
  cv::sqrt(1 + bending / (typical * typical), weights);
  weights = kSmoothness / (static_cast<double>(cell) * cell) / weights.mul(1 + bending);
  return weights;
}

/// Error to expect of each cell [px]. The posterior deviation of a stiff sheet on data falls with both the information
/// and the stiffness; the scale was fitted to phantoms, where it holds within a factor of two from 0.01 to 0.5 px.
cv::Mat deviationOfCells(const cv::Mat& information, const cv::Mat& stiffness) {
  constexpr double kScale = 1.6;
  constexpr double kLeastStiffness = 1;  // at an edge of depth the data alone decide
  cv::Mat deviation;
  const cv::Mat stiff = cv::max(blurCells(stiffness, 0.7), kLeastStiffness);
  cv::pow(blurCells(information, 1.0).mul(stiff) + 1e-9, -0.5, deviation);
  return kScale * deviation;
}

}  // namespace

RefinedDisparity refineDisparity(const RectifiedPair& pair, const cv::Mat& start) {
  CV_Assert(start.type() == CV_32FC1 && start.size() == pair.left.size());
  const cv::Size size = start.size();
  const cv::Mat known = start == start;
  const DataTerm data(pair, known & pair.left_usable);
  RefinedDisparity out;
  cv::Mat& d = out.disparity;
  d = smoothBelowAPixel(fillUnknown(start, known));
  const cv::Mat begin = d.clone();
  cv::Mat gain, last_information, last_stiffness;
  struct Level {
    int cell, rounds;
  };
  for (const Level& level : {Level{2 * kFinestCell, 2}, Level{kFinestCell, 2}}) {
    const int cell = level.cell;
    const double reach = kPhotometricReach / cell;
    cv::Mat cells = meanOfCells(d, cell), surface = surfaceThrough(cells, size, cell);
    const cv::Mat start_cells = last_information.empty() ? cells.clone() : meanOfCells(begin, cell);
    const cv::Mat trust_in_start = kTrustInStart * cell * cell * shareOfCells(known, cell);
    const double noise = data.noise(d);
    if (gain.empty())
      gain = cv::Mat(cells.size(), CV_32FC1, cv::Scalar(1));
    else
      cv::resize(gain, gain, cells.size(), 0, 0, cv::INTER_LINEAR);
    for (int round = 0; round < level.rounds; ++round) {
      const CellSums sums = data.sum(d, surface, gain, noise, cell);
      const cv::Mat offset = blurCells(sums.wr, reach) / (blurCells(sums.w, reach) + 1e-9f);
      const cv::Mat right = blurCells(sums.right, reach);
      gain = blurCells(sums.left, reach) / (right + 1e-3f);
      gain.setTo(1, right < 1);
      const double share = rowStep(cell) / kCorrelatedPixels;
      const cv::Mat information = sums.wgg * share + trust_in_start;
      const cv::Mat gradient = (sums.wgr - offset.mul(sums.wg)) * share + trust_in_start.mul(cells - start_cells);
      last_stiffness = bendingWeights(cells, cell);
      const cv::Mat step = solveThinPlate(information, gradient, last_stiffness, cells, kSteps);
      cells += cv::min(cv::max(step, -1.0), 1.0);
      const cv::Mat next = surfaceThrough(cells, size, cell);
      follow(d, surface, next);
      surface = next;
      last_information = information;
    }
  }
  out.deviation = surfaceThrough(deviationOfCells(last_information, last_stiffness), size, kFinestCell).clone();
  return out;
}

double deviationOf(double confidence) { return kHalfConfidence * std::sqrt(std::max(0.0, 1 / confidence - 1)); }

cv::Mat confidenceOf(const cv::Mat& deviation) {
  CV_Assert(deviation.type() == CV_32FC1);
  cv::Mat confidence(deviation.size(), CV_32FC1);
  cv::parallel_for_(cv::Range(0, deviation.rows), [&](const cv::Range& rows) {
    constexpr auto kScale = static_cast<float>(1 / (kHalfConfidence * kHalfConfidence));
    for (int y = rows.start; y < rows.end; ++y) {
      const float* from = deviation.ptr<float>(y);
      float* to = confidence.ptr<float>(y);
      for (int x = 0; x < deviation.cols; ++x) {
        const float value = 1 / (1 + kScale * from[x] * from[x]);
        to[x] = value > 0 ? value : 0;  // for NaN too
      }
    }
  });
  return confidence;
}

}  // namespace cortshift_stereo
