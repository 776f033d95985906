#include "mismatch.hpp"

#include <algorithm>
#include <opencv2/core/hal/intrin.hpp>
#include <opencv2/imgproc.hpp>

#include "parallel.hpp"

namespace cortshift_flow {

void mismatchRow(const Level& level, int x0, int y, const float* u, const float* v, float* out, int count) {
  using cv::v_float32x4;
  const int width = level.first.cols, height = level.first.rows;
  const float* first = level.first.ptr<float>(y);
  const float* second = level.second.ptr<float>();
  const std::size_t step = level.second.step1();
  const uchar* first_valid = level.first_valid.empty() ? nullptr : level.first_valid.ptr(y);
  for (int i = 0; i < count; ++i) {
    const int x = x0 + i;
    const float px = static_cast<float>(x) + u[i], py = static_cast<float>(y) + v[i];
    if (!(px >= 0 && py >= 0 && px < static_cast<float>(width - 1) && py < static_cast<float>(height - 1)) ||
        (first_valid && !first_valid[x])) {
      out[i] = kUnseen;
      continue;
    }
    const int ix = static_cast<int>(px), iy = static_cast<int>(py);
    if (!level.second_valid.empty() && !level.second_valid(iy, ix)) {
      out[i] = kUnseen;
      continue;
    }
    const v_float32x4 fx = cv::v_setall_f32(px - static_cast<float>(ix)),
                      fy = cv::v_setall_f32(py - static_cast<float>(iy));
    const float* s = second + static_cast<std::size_t>(iy) * step + static_cast<std::size_t>(ix) * 4;
    const v_float32x4 a = cv::v_load(s), b = cv::v_load(s + 4), c = cv::v_load(s + step), d = cv::v_load(s + step + 4);
    const v_float32x4 top = a + fx * (b - a), bottom = c + fx * (d - c);
    const v_float32x4 difference = cv::v_abs(top + fy * (bottom - top) - cv::v_load(first + 4 * x));
    out[i] = std::min(cv::v_reduce_sum(difference), kLargestMismatch);
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

}  // namespace cortshift_flow
