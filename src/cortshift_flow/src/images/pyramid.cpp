#include "images/pyramid.hpp"

#include <algorithm>

#include "parallel.hpp"

namespace cortshift_flow {
namespace {

CORTSHIFT_VECTORISED
void lowPassColumns(const float* above2, const float* above, const float* here, const float* below, const float* below2,
                    float* out, int count) {
#pragma GCC ivdep
  for (int i = 0; i < count; ++i)
    out[i] = (above2[i] + below2[i]) * (1 / 16.f) + (above[i] + below[i]) * (4 / 16.f) + here[i] * (6 / 16.f);
}

/// `row` holds pixels -2...2 * width + 1 of four channels.
CORTSHIFT_VECTORISED
void lowPassRow(const float* row, float* out, int width) {
#pragma GCC ivdep
  for (int x = 0; x < width; ++x)
    for (int c = 0; c < 4; ++c) {
      const float* r = row + 8 * x + c;
      out[4 * x + c] = (r[-8] + r[8]) * (1 / 16.f) + (r[-4] + r[4]) * (4 / 16.f) + r[0] * (6 / 16.f);
    }
}

}  // namespace

cv::Mat4f halve(const cv::Mat4f& fine, int threads) {
  cv::Mat4f coarse((fine.rows + 1) / 2, (fine.cols + 1) / 2);
  forRows(coarse.rows, threads, [&](int begin, int end) {
    std::vector<float> buffer(static_cast<std::size_t>(fine.cols + 6) * 4);
    float* row = buffer.data() + 8;
    const auto source = [&](int y) { return fine.ptr<float>(std::clamp(y, 0, fine.rows - 1)); };
    for (int y = begin; y < end; ++y) {
      lowPassColumns(source(2 * y - 2), source(2 * y - 1), source(2 * y), source(2 * y + 1), source(2 * y + 2), row,
                     4 * fine.cols);
      for (int c = 0; c < 4; ++c) {
        row[c - 8] = row[c - 4] = row[c];
        for (int beyond = 0; beyond < 3; ++beyond) row[4 * (fine.cols + beyond) + c] = row[4 * (fine.cols - 1) + c];
      }
      lowPassRow(row, coarse.ptr<float>(y), coarse.cols);
    }
  });
  return coarse;
}

std::vector<cv::Mat4f> buildPyramid(const cv::Mat4f& image, int coarsest_side, int threads) {
  std::vector<cv::Mat4f> levels = {image};
  while (std::min(levels.back().rows, levels.back().cols) >= 2 * coarsest_side)
    levels.push_back(halve(levels.back(), threads));
  return levels;
}

}  // namespace cortshift_flow
