#include "trust/mismatch.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "parallel.hpp"

namespace cortshift_flow {

namespace {

constexpr int kAdoptWindow = 3;        // half width of the windows that choose between two flows [px of the level]
constexpr float kAdoptIfBelow = 0.9f;  // of the present mismatch

typedef float Float8 __attribute__((vector_size(32)));
typedef float Float4 __attribute__((vector_size(16)));

/// Absolute differences of four channels; `corner` is null where the second image is not seen.
struct Sample {
  const float* corner;
  float fx, fy;
};

CORTSHIFT_VECTORISED
void compareRow(const Sample* samples, std::size_t step, const float* first, float* out, int count) {
  for (int i = 0; i < count; ++i, first += 4) {
    const Sample& at = samples[i];
    if (!at.corner) {
      out[i] = kUnseen;
      continue;
    }
    Float8 top, bottom;
    std::memcpy(&top, at.corner, sizeof(top));
    std::memcpy(&bottom, at.corner + step, sizeof(bottom));
    const Float8 column = top + at.fy * (bottom - top);
    Float4 side[2], here;
    std::memcpy(side, &column, sizeof(side));
    std::memcpy(&here, first, sizeof(here));
    const Float4 gap = side[0] + at.fx * (side[1] - side[0]) - here;
    out[i] = std::min(std::abs(gap[0]) + std::abs(gap[1]) + std::abs(gap[2]), kLargestMismatch);
  }
}

}  // namespace

void mismatchRow(const Level& level, int x0, int y, const float* u, const float* v, float* out, int count) {
  const int width = level.first.cols, height = level.first.rows;
  const float* second = level.second.ptr<float>();
  const std::size_t step = level.second.step1();
  const uchar* first_valid = level.first_valid.empty() ? nullptr : level.first_valid.ptr(y);
  const auto last_x = static_cast<float>(width - 1), last_y = static_cast<float>(height - 1);
  constexpr int kPiece = 64;
  std::array<Sample, kPiece> samples;
  for (int from = 0; from < count; from += kPiece) {
    const int piece = std::min(kPiece, count - from);
    for (int i = 0; i < piece; ++i) {
      Sample& at = samples[static_cast<std::size_t>(i)];
      at.corner = nullptr;
      const int x = x0 + from + i;
      const float px = static_cast<float>(x) + u[from + i], py = static_cast<float>(y) + v[from + i];
      if (!(px >= 0 && py >= 0 && px < last_x && py < last_y) || (first_valid && !first_valid[x])) continue;
      const int ix = static_cast<int>(px), iy = static_cast<int>(py);
      if (!level.second_valid.empty() && !level.second_valid(iy, ix)) continue;
      at = {second + static_cast<std::size_t>(iy) * step + static_cast<std::size_t>(ix) * 4,
            px - static_cast<float>(ix), py - static_cast<float>(iy)};
    }
    compareRow(samples.data(), step, level.first.ptr<float>(y) + 4 * (x0 + from), out + from, piece);
  }
}

Plane windowMismatch(const Level& level, const FlowPlanes& flow, int window, int threads) {
  const int width = flow.u.width(), height = flow.u.height();
  cv::Mat1f pixel(height, width);
  forRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      mismatchRow(level, 0, y, flow.u.row(y), flow.v.row(y), pixel.ptr<float>(y), width);
  });
  cv::Mat1f mean;
  const int side = 2 * window + 1;
  cv::boxFilter(pixel, mean, -1, cv::Size(side, side), cv::Point(-1, -1), true, cv::BORDER_REPLICATE);
  Plane result(height, width);
  for (int y = 0; y < height; ++y) std::copy_n(mean.ptr<float>(y), width, result.row(y));
  return result;
}

MismatchScale mismatchScale(const Level& level, const FlowPlanes& flow, int threads) {
  const Plane mean = windowMismatch(level, flow, kMatchWindow, threads);
  std::vector<float> values;
  for (int y = 0; y < mean.height(); y += 2)
    for (int x = 0; x < mean.width(); x += 2)
      if (level.first_valid.empty() || level.first_valid(y, x)) values.push_back(mean.row(y)[x]);
  if (values.empty()) values.push_back(0);
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  const float usual = *middle;
  MismatchScale scale;
  scale.suspect = std::max(std::clamp(4 * usual, 0.02f, 0.12f), 1.5f * usual);
  scale.unmatched = std::max(std::min(2 * scale.suspect, 0.065f), 1.7f * usual);
  return scale;
}

cv::Mat1b shown(const Level& level, const FlowPlanes& flow, int threads) {
  cv::Mat1b result(flow.u.size(), uchar{0});
  const auto last_x = static_cast<float>(result.cols - 1), last_y = static_cast<float>(result.rows - 1);
  forRows(result.rows, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < result.cols; ++x) {
        if (!level.first_valid.empty() && !level.first_valid(y, x)) continue;
        const float px = static_cast<float>(x) + flow.u.row(y)[x], py = static_cast<float>(y) + flow.v.row(y)[x];
        if (!(px >= 0 && py >= 0 && px <= last_x && py <= last_y)) continue;
        result(y, x) = level.second_valid.empty() || level.second_valid(static_cast<int>(py), static_cast<int>(px));
      }
  });
  return result;
}

cv::Mat1b matched(const Level& level, const FlowPlanes& flow, float limit, int threads) {
  const Plane mean = windowMismatch(level, flow, kMatchWindow, threads);
  cv::Mat1b result = shown(level, flow, threads);
  forRows(result.rows, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < result.cols; ++x) result(y, x) = result(y, x) && mean.row(y)[x] <= limit;
  });
  return result;
}

void adoptWhereBetter(const Level& level, const FlowPlanes& other, const cv::Mat1b& eligible, FlowPlanes& flow,
                      int threads) {
  const Plane present = windowMismatch(level, flow, kAdoptWindow, threads);
  const Plane offered = windowMismatch(level, other, kAdoptWindow, threads);
  forRows(present.height(), threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < present.width(); ++x)
        if (eligible(y, x) && offered.row(y)[x] < kAdoptIfBelow * present.row(y)[x]) {
          flow.u.row(y)[x] = other.u.row(y)[x];
          flow.v.row(y)[x] = other.v.row(y)[x];
        }
  });
}

}  // namespace cortshift_flow
