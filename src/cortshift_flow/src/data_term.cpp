#include "data_term.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core/hal/intrin.hpp>

#include "parallel.hpp"

namespace cortshift_flow {

void lineariseRow(const ImagePair& images, int y, const float* u, const float* v, const cv::Vec4f& channel_weights,
                  const TensorRow& row) {
  using cv::v_float32x4;
  const v_float32x4 weights(channel_weights[0], channel_weights[1], channel_weights[2], channel_weights[3]);
  const int width = images.second.width, height = images.second.height;
  const float* first = images.first.ptr<float>(y);
  const uchar* first_valid = images.first_valid.empty() ? nullptr : images.first_valid.ptr(y);
  const std::size_t step = images.second.coefficients.step1();
  const float* coefficients = images.second.coefficients.ptr<float>();
  for (int x = 0; x < width; ++x) {
    const float px = static_cast<float>(x) + u[x], py = static_cast<float>(y) + v[x];
    bool seen = px >= 0 && py >= 0 && px <= static_cast<float>(width - 1) && py <= static_cast<float>(height - 1) &&
                (!first_valid || first_valid[x]);
    const int ix = seen ? static_cast<int>(px) : 0, iy = seen ? static_cast<int>(py) : 0;
    if (seen && !images.second_valid.empty()) seen = images.second_valid(iy, ix) != 0;
    if (!seen) {
      row.xx[x] = row.xy[x] = row.yy[x] = row.xt[x] = row.yt[x] = row.tt[x] = 0;
      continue;
    }
    float wx[4], dx[4], wy[4], dy[4];
    splineWeights(px - static_cast<float>(ix), wx, dx);
    splineWeights(py - static_cast<float>(iy), wy, dy);
    const v_float32x4 wx0 = cv::v_setall_f32(wx[0]), wx1 = cv::v_setall_f32(wx[1]), wx2 = cv::v_setall_f32(wx[2]),
                      wx3 = cv::v_setall_f32(wx[3]);
    const v_float32x4 dx0 = cv::v_setall_f32(dx[0]), dx1 = cv::v_setall_f32(dx[1]), dx2 = cv::v_setall_f32(dx[2]),
                      dx3 = cv::v_setall_f32(dx[3]);
    v_float32x4 value = cv::v_setzero_f32(), gx = cv::v_setzero_f32(), gy = cv::v_setzero_f32();
    // Coefficient (ix - 1, iy - 1) is the first of the 4 x 4 that a point in cell (ix, iy) needs.
    const float* c = coefficients + static_cast<std::size_t>(iy - 1 + SplineImage::kBorder) * step +
                     static_cast<std::size_t>(ix - 1 + SplineImage::kBorder) * 4;
    for (int j = 0; j < 4; ++j, c += step) {
      const v_float32x4 c0 = cv::v_load(c), c1 = cv::v_load(c + 4), c2 = cv::v_load(c + 8), c3 = cv::v_load(c + 12);
      const v_float32x4 along = (c0 * wx0 + c1 * wx1) + (c2 * wx2 + c3 * wx3);
      const v_float32x4 slope = (c0 * dx0 + c1 * dx1) + (c2 * dx2 + c3 * dx3);
      const v_float32x4 w = cv::v_setall_f32(wy[j]);
      value = value + along * w;
      gx = gx + slope * w;
      gy = gy + along * cv::v_setall_f32(dy[j]);
    }
    const v_float32x4 residual = value - cv::v_load(first + 4 * x);
    const v_float32x4 gxw = gx * weights, gyw = gy * weights;
    const v_float32x4 sums = cv::v_reduce_sum4(gxw * gx, gxw * gy, gyw * gy, gxw * residual);
    row.xx[x] = sums.get0();
    float rest[4];
    cv::v_store(rest, sums);
    row.xy[x] = rest[1];
    row.yy[x] = rest[2];
    row.xt[x] = rest[3];
    row.yt[x] = cv::v_reduce_sum(gyw * residual);
    row.tt[x] = cv::v_reduce_sum(residual * weights * residual);
  }
}

void linearise(const ImagePair& images, const Plane& u, const Plane& v, const cv::Vec4f& channel_weights,
               MotionTensor& tensor, int threads) {
  tensor.create(u.size());
  forRows(u.height(), threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      lineariseRow(
          images, y, u.row(y), v.row(y), channel_weights,
          {tensor.xx.row(y), tensor.xy.row(y), tensor.yy.row(y), tensor.xt.row(y), tensor.yt.row(y), tensor.tt.row(y)});
  });
}

}  // namespace cortshift_flow
