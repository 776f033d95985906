#include "images/photometric.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "parallel.hpp"

namespace cortshift_flow {
namespace {

constexpr int kCells = 48;                                     // along the shorter side
constexpr double kSamples = 4;                                 // pixels that are read along a cell's side, at most all
constexpr double kSmoothing = 3;                               // standard deviation of the windows [cells]
constexpr float kGainScatter = 0.15f, kOffsetScatter = 0.05f;  // expected, where nothing is known
constexpr float kResidual = 0.02f;  // standard deviation of a good match: weights the data, rejects outliers

/// Moments over a cell, per channel: of 1, x, y, x^2 and x y, with x the first and y the warped second image.
struct Moments {
  cv::Mat4f weight, x, y, xx, xy;
};

cv::Vec4f bilinear(const cv::Mat4f& image, float px, float py) {
  const int ix = std::min(static_cast<int>(px), image.cols - 2), iy = std::min(static_cast<int>(py), image.rows - 2);
  const float fx = px - static_cast<float>(ix), fy = py - static_cast<float>(iy);
  return (1 - fy) * ((1 - fx) * image(iy, ix) + fx * image(iy, ix + 1)) +
         fy * ((1 - fx) * image(iy + 1, ix) + fx * image(iy + 1, ix + 1));
}

}  // namespace

BrightnessMap BrightnessMap::fit(const Level& level, const FlowPlanes& flow, const cv::Mat1b& visible, int threads) {
  const int width = level.first.cols, height = level.first.rows;
  const double cell = std::max(1.0, std::min(width, height) / static_cast<double>(kCells));
  const cv::Size cells(std::max(1, static_cast<int>(width / cell)), std::max(1, static_cast<int>(height / cell)));
  BrightnessMap map;
  map.gain_ = cv::Mat4f(cells, cv::Vec4f::all(1));
  map.offset_ = cv::Mat4f(cells, cv::Vec4f::all(0));
  if (width < 2 || height < 2) return map;

  const int step = std::max(1, static_cast<int>(cell / kSamples));
  constexpr int kRounds = 3;  // robust: each round weights the pixels by how well the last one fitted them
  for (int round = 0; round < kRounds; ++round) {
    // Wide at first, so that a large change of brightness is not taken for an outlier.
    const float tolerance = kResidual * static_cast<float>(1 << (kRounds - 1 - round)) * 2;
    Moments m;
    for (cv::Mat4f* p : {&m.weight, &m.x, &m.y, &m.xx, &m.xy}) *p = cv::Mat4f(cells, cv::Vec4f::all(0));
    forRows(cells.height, threads, [&](int begin, int end) {
      for (int j = begin; j < end; ++j)
        for (int y = j * height / cells.height; y < (j + 1) * height / cells.height; y += step)
          for (int x = 0; x < width; x += step) {
            if (!visible.empty() && !visible(y, x)) continue;
            if (!level.first_valid.empty() && !level.first_valid(y, x)) continue;
            const float px = static_cast<float>(x) + flow.u.row(y)[x], py = static_cast<float>(y) + flow.v.row(y)[x];
            if (!(px >= 0 && py >= 0 && px <= static_cast<float>(width - 1) && py <= static_cast<float>(height - 1)))
              continue;
            if (!level.second_valid.empty() && !level.second_valid(static_cast<int>(py), static_cast<int>(px)))
              continue;
            const cv::Vec4f first = level.first(y, x), second = bilinear(level.second, px, py);
            const int i = std::min(cells.width - 1, x * cells.width / width);
            const cv::Vec4f gap = second - (first.mul(map.gain_(j, i)) + map.offset_(j, i));
            const float ratio = 1 + static_cast<float>(gap.dot(gap)) / (tolerance * tolerance);
            const float weight = 1 / (ratio * ratio);
            for (int c = 0; c < 3; ++c) {
              m.weight(j, i)[c] += weight;
              m.x(j, i)[c] += weight * first[c];
              m.y(j, i)[c] += weight * second[c];
              m.xx(j, i)[c] += weight * first[c] * first[c];
              m.xy(j, i)[c] += weight * first[c] * second[c];
            }
          }
    });
    for (cv::Mat4f* p : {&m.weight, &m.x, &m.y, &m.xx, &m.xy}) {
      cv::Mat smooth;
      cv::GaussianBlur(*p, smooth, cv::Size(), kSmoothing, kSmoothing, cv::BORDER_CONSTANT);
      *p = smooth;
    }
    double change = 0, pixels = 0;
    for (int j = 0; j < cells.height; ++j)
      for (int i = 0; i < cells.width; ++i)
        for (int c = 0; c < 3; ++c) {
          // Least squares with a prior: the gain (about the mean) is pulled towards 1, the offset towards 0.
          const float n = m.weight(j, i)[c];
          const float mean_x = n > 0 ? m.x(j, i)[c] / n : 0, mean_y = n > 0 ? m.y(j, i)[c] / n : 0;
          const float var = m.xx(j, i)[c] - n * mean_x * mean_x, cov = m.xy(j, i)[c] - n * mean_x * mean_y;
          const float prior_gain = kResidual * kResidual / (kGainScatter * kGainScatter),
                      prior_offset = kResidual * kResidual / (kOffsetScatter * kOffsetScatter);
          const float gain = (std::max(cov, 0.f) + prior_gain) / (std::max(var, 0.f) + prior_gain);
          const float shift = n * (mean_y - mean_x) / (n + prior_offset);
          map.gain_(j, i)[c] = gain;
          map.offset_(j, i)[c] = shift + mean_x * (1 - gain);
          change += n * shift * shift;
          pixels += n;
        }
    map.root_mean_square_change_ = pixels > 0 ? static_cast<float>(std::sqrt(change / pixels)) : 0.f;
  }
  return map;
}

cv::Mat4f BrightnessMap::apply(const cv::Mat4f& image, int threads) const {
  cv::Mat4f result(image.size());
  const int width = image.cols, height = image.rows;
  // Cell centres, interpolated linearly between and constant beyond the outermost.
  const auto position = [](int i, int pixels, int cells, int& first, float& fraction) {
    const float at =
        std::clamp((static_cast<float>(i) + 0.5f) * static_cast<float>(cells) / static_cast<float>(pixels) - 0.5f, 0.f,
                   static_cast<float>(cells - 1));
    first = std::min(static_cast<int>(at), std::max(0, cells - 2));
    fraction = at - static_cast<float>(first);
  };
  std::vector<int> column(static_cast<std::size_t>(width));
  std::vector<float> fraction(static_cast<std::size_t>(width));
  for (int x = 0; x < width; ++x)
    position(x, width, gain_.cols, column[static_cast<std::size_t>(x)], fraction[static_cast<std::size_t>(x)]);
  forRows(height, threads, [&](int begin, int end) {
    std::vector<cv::Vec4f> gain(static_cast<std::size_t>(gain_.cols)), offset(gain.size());
    for (int y = begin; y < end; ++y) {
      int j;
      float fy;
      position(y, height, gain_.rows, j, fy);
      const int below = std::min(j + 1, gain_.rows - 1);
      for (int i = 0; i < gain_.cols; ++i) {
        gain[static_cast<std::size_t>(i)] = (1 - fy) * gain_(j, i) + fy * gain_(below, i);
        offset[static_cast<std::size_t>(i)] = (1 - fy) * offset_(j, i) + fy * offset_(below, i);
      }
      for (int x = 0; x < width; ++x) {
        const auto i = static_cast<std::size_t>(column[static_cast<std::size_t>(x)]);
        const std::size_t next = std::min(i + 1, gain.size() - 1);
        const float fx = fraction[static_cast<std::size_t>(x)];
        const cv::Vec4f& value = image(y, x);
        for (int c = 0; c < 4; ++c)
          result(y, x)[c] = value[c] * ((1 - fx) * gain[i][c] + fx * gain[next][c]) +
                            ((1 - fx) * offset[i][c] + fx * offset[next][c]);
      }
    }
  });
  return result;
}

}  // namespace cortshift_flow
