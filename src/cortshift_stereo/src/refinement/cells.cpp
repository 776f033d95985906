#include "refinement/cells.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core/hal/intrin.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "cortshift_flow/vectorised.hpp"
#include "refinement/cubic.hpp"

namespace cortshift_stereo {
namespace {

CORTSHIFT_VECTORISED
void followRow(float* d, const float* before, const float* after, int width) {
#pragma GCC ivdep
  for (int x = 0; x < width; ++x) d[x] = std::abs(d[x] - before[x]) < kSameSurface ? after[x] : d[x];
}

}  // namespace

cv::Mat blurCells(const cv::Mat& values, double sigma) {
  cv::Mat out;
  cv::GaussianBlur(values, out, {}, std::max(0.5, sigma), 0, cv::BORDER_REFLECT);
  return out;
}

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

cv::Mat shareOfCells(const cv::Mat& mask, int cell) {
  const cv::Size cells = cellsOf(mask.size(), cell);
  cv::Mat whole, share;
  cv::copyMakeBorder(mask, whole, 0, cells.height * cell - mask.rows, 0, cells.width * cell - mask.cols,
                     cv::BORDER_REPLICATE);
  whole.convertTo(whole, CV_32F, 1.0 / 255);
  cv::resize(whole, share, cells, 0, 0, cv::INTER_AREA);
  return share;
}

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

void follow(cv::Mat& d, const cv::Mat& before, const cv::Mat& after) {
  cv::parallel_for_(cv::Range(0, d.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y)
      followRow(d.ptr<float>(y), before.ptr<float>(y), after.ptr<float>(y), d.cols);
  });
}

}  // namespace cortshift_stereo
