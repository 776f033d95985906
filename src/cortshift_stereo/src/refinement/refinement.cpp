#include "cortshift_stereo/refinement/refinement.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <opencv2/core/hal/intrin.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "cortshift_flow/vectorised.hpp"
#include "rectification/fill.hpp"
#include "refinement/cubic.hpp"
#include "refinement/thin_plate.hpp"

namespace cortshift_stereo {
namespace {

// Chosen on phantoms with and without noise; the same at every site.
constexpr double kSmoothness = 2e3;           // mu [px^2]: weight of bending against data
constexpr double kTypicalBending = 0.0021;    // [px / px^2] above it psi grows only slowly
constexpr double kInterpolationError = 0.05;  // [px] times the gradient: the error of resampling
constexpr double kOutlier = 4.5;          // [standard deviations] a residual of this size keeps a quarter of its weight
constexpr double kCorrelatedPixels = 10;  // neighbours share their noise: images are blurred before resampling
constexpr double kLeastNoise = 0.25;      // [grey levels]: quantisation after the blur
constexpr double kPhotometricReach = 24;  // [px] over which gain and offset vary
constexpr double kTrustInStart = 0.05;    // [1/px^2] per pixel: keeps the start where there is no texture
constexpr int kFinestCell = 4;            // [px]
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

cv::Mat blurCells(const cv::Mat& values, double sigma) {
  cv::Mat out;
  cv::GaussianBlur(values, out, {}, std::max(0.5, sigma), 0, cv::BORDER_REFLECT);
  return out;
}

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

/// Linearised comparison of the left image with the warped right one.
class DataTerm {
 public:
  /// @param known  CV_8UC1, 255 where the left pixel may be used
  DataTerm(const RectifiedPair& pair, const cv::Mat& known) : pair_(pair), known_(known) {}

  /// @param d        CV_32FC1 [px], finite
  /// @param surface  the cells' surface at each pixel; pixels of `d` far from it do not count
  /// @param gain     of the right image, per cell
  /// @param noise    [grey levels] standard deviation of the residual
  /// @param row_step  every how many rows are summed
  CellSums sum(const cv::Mat& d, const cv::Mat& surface, const cv::Mat& gain, double noise, int cell,
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
        for (int k = 0; k < Row::kSums; ++k) reduce(row.sums[k], d.cols, cell, out(cells, k)[cy]);
      }
    });
    return cells;
  }

  /// Standard deviation of the residual [grey levels], robust, from pixels that are two apart: what varies slowly
  /// (gain, offset, a disparity that is a little wrong) cancels.
  double noise(const cv::Mat& d) const {
    constexpr int kSkip = 5;
    cv::Mat_<float> sampled(std::max(0, (d.rows - 4 + kSkip - 1) / kSkip),
                            std::max(0, (d.cols - 6 + kSkip - 1) / kSkip));
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

 private:
  /// One line of pixels, kept apart in arrays so that the arithmetic runs in vector registers. Lines of a power of two
  /// would share a few lines of the cache; a pad between them spreads them.
  class Row {
   public:
    static constexpr int kSums = 7;
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
  static cv::Mat_<float>& out(CellSums& cells, int k) {
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
    landRow(d, row.column.data(), row.fraction, width);
    for (int x = 0; x < width; ++x) {
      const int column = row.column[static_cast<std::size_t>(x)];
      cv::v_store(row.taps + 4 * x, cv::v_load(right + column - 1));
      row.seen[static_cast<std::size_t>(x)] = known[x] & usable[column] & usable[column + 1];
    }
    interpolateRow(row.taps, row.fraction, row.seen.data(), d, surface, row.warped, row.slope, row.counts, width);
  }

  void add(int y, float noise2, Row& row) const {
    const cv::Mat& left = pair_.left;
    addRow(left.ptr<float>(y), left.ptr<float>(std::max(y - 1, 0)), left.ptr<float>(std::min(y + 1, left.rows - 1)),
           row.gain, row.warped, row.slope, row.counts, noise2, row.sums, left.cols);
  }

  static void reduce(const float* pixels, int width, int cell, float* cells) {
    for (int begin = 0; begin < width; begin += cell) {
      float sum = 0;
      for (int x = begin; x < std::min(begin + cell, width); ++x) sum += pixels[x];
      *cells++ = sum;
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

/// Smooths differences of less than a pixel (noise of the matching) and keeps larger steps.
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

/// Mean of the pixels of each cell that lie on the same surface as the middle of the cell.
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

/// The surface through the values at the middles of the cells, at each pixel. A plane stays a plane exactly; with
/// OpenCV's cubic kernel (a = -3/4) it would not.
cv::Mat surfaceThrough(const cv::Mat& cells, const cv::Size& size, int cell) {
  CV_Assert(cell % 4 == 0);
  constexpr int kTaps = 5;  // a cell's pixels lie on both sides of its middle
  std::vector<float> weights(static_cast<std::size_t>(kTaps * cell), 0.0f);
  // The cell whose middle lies to the left of (or above) a pixel's middle, and the distance from it.
  const auto split = [cell](int pixel) {
    const float at = (static_cast<float>(pixel) + 0.5f) / static_cast<float>(cell) - 0.5f;
    return std::make_pair(static_cast<int>(std::floor(at)), at - std::floor(at));
  };
  for (int pixel = 0; pixel < cell; ++pixel) {
    const auto [before, t] = split(pixel);
    const CubicWeights cubic(t);
    for (int k = 0; k < 4; ++k) weights[static_cast<std::size_t>((before + 1 + k) * cell + pixel)] = cubic[k];
  }
  const int columns = cells.cols;
  cv::Mat out(size.height, columns * cell, CV_32FC1);
  cv::parallel_for_(cv::Range(0, size.height), [&](const cv::Range& rows) {
    std::vector<float> line(static_cast<std::size_t>(columns + 4));
    for (int y = rows.start; y < rows.end; ++y) {
      const auto [before, t] = split(y);
      const CubicWeights cubic(t);
      const float* from[4];
      for (int k = 0; k < 4; ++k) from[k] = cells.ptr<float>(std::clamp(before - 1 + k, 0, cells.rows - 1));
      for (int x = 0; x < columns; ++x)
        line[static_cast<std::size_t>(x + 2)] =
            cubic[0] * from[0][x] + cubic[1] * from[1][x] + cubic[2] * from[2][x] + cubic[3] * from[3][x];
      line[0] = line[1] = line[2];
      line[static_cast<std::size_t>(columns + 2)] = line[static_cast<std::size_t>(columns + 3)] =
          line[static_cast<std::size_t>(columns + 1)];
      float* to = out.ptr<float>(y);
      for (int x = 0; x < columns; ++x)
        for (int first = 0; first < cell; first += 4, to += 4) {
          cv::v_float32x4 sum = cv::v_setzero_f32();
          for (int k = 0; k < kTaps; ++k)
            sum = cv::v_muladd(cv::v_setall_f32(line[static_cast<std::size_t>(x + k)]),
                               cv::v_load(&weights[static_cast<std::size_t>(k * cell + first)]), sum);
          cv::v_store(to, sum);
        }
    }
  });
  return out(cv::Rect({0, 0}, size));
}

CORTSHIFT_VECTORISED
void followRow(float* d, const float* before, const float* after, int width) {
#pragma GCC ivdep
  for (int x = 0; x < width; ++x) d[x] = std::abs(d[x] - before[x]) < kSameSurface ? after[x] : d[x];
}

/// Pixels on the old surface move to the new one; others stay.
void follow(cv::Mat& d, const cv::Mat& before, const cv::Mat& after) {
  cv::parallel_for_(cv::Range(0, d.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y)
      followRow(d.ptr<float>(y), before.ptr<float>(y), after.ptr<float>(y), d.cols);
  });
}

/// Stiffness of each cell: mu, and less where the surface bends more than tissue does between its folds. There it falls
/// with the square of the bending, so that the bottom of a narrow fold is not flattened.
cv::Mat bendingWeights(const cv::Mat& cells, int cell) {
  const double typical = kTypicalBending * cell * cell;
  const cv::Mat bending = squaredBending(cells);
  const cv::Mat softer = (1 + bending / (typical * typical)).mul(1 + bending);
  return kSmoothness / (static_cast<double>(cell) * cell) / softer;
}

/// Expected error of each cell [px]. The posterior deviation of a stiff sheet that is fitted to data falls with the
/// information of the data and with the stiffness; the scale was fitted to phantoms, where it holds within a factor of
/// two from 0.01 to 0.5 px.
cv::Mat deviationOfCells(const cv::Mat& information, const cv::Mat& stiffness) {
  constexpr double kScale = 1.6;
  constexpr double kLeastStiffness = 1;  // at an edge of depth only the data count
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
      const bool last = cell == kFinestCell && round + 1 == level.rounds;
      const int row_step = last ? 1 : 2;  // every second row is enough before the last step
      const CellSums sums = data.sum(d, surface, gain, noise, cell, row_step);
      const cv::Mat offset = blurCells(sums.wr, reach) / (blurCells(sums.w, reach) + 1e-9f);
      const cv::Mat right = blurCells(sums.right, reach);
      gain = blurCells(sums.left, reach) / (right + 1e-3f);
      gain.setTo(1, right < 1);
      const double share = row_step / kCorrelatedPixels;
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
