#include "variational/data_term.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "parallel.hpp"

namespace cortshift_flow {

namespace {

// Sixteen floats: four neighbouring coefficients of four channels each. The compiler splits them for processors with
// narrower registers; the operations, and so the bits, are the same.
typedef float Float16 __attribute__((vector_size(64)));
typedef float Float4 __attribute__((vector_size(16)));

/// Polynomials c0 + c1 t + c2 t^2 + c3 t^3 whose values at t are the four spline weights (see splineWeights), each
/// repeated for four channels; and their derivatives.
constexpr Float16 kWeight0 = {1 / 6.f, 1 / 6.f, 1 / 6.f, 1 / 6.f, 4 / 6.f, 4 / 6.f, 4 / 6.f, 4 / 6.f,
                              1 / 6.f, 1 / 6.f, 1 / 6.f, 1 / 6.f, 0,       0,       0,       0};
constexpr Float16 kWeight1 = {-.5f, -.5f, -.5f, -.5f, 0, 0, 0, 0, .5f, .5f, .5f, .5f, 0, 0, 0, 0};
constexpr Float16 kWeight2 = {.5f, .5f, .5f, .5f, -1, -1, -1, -1, .5f, .5f, .5f, .5f, 0, 0, 0, 0};
constexpr Float16 kWeight3 = {-1 / 6.f, -1 / 6.f, -1 / 6.f, -1 / 6.f, .5f,     .5f,     .5f,     .5f,
                              -.5f,     -.5f,     -.5f,     -.5f,     1 / 6.f, 1 / 6.f, 1 / 6.f, 1 / 6.f};

void land(const ImagePair& images, int y, const float* u, const float* v, std::vector<Landing>& landings) {
  const int width = images.second.width, height = images.second.height;
  const uchar* first_valid = images.first_valid.empty() ? nullptr : images.first_valid.ptr(y);
  const std::size_t step = images.second.coefficients.step1();
  const float* coefficients = images.second.coefficients.ptr<float>();
  const auto last_x = static_cast<float>(width - 1), last_y = static_cast<float>(height - 1);
  for (int x = 0; x < width; ++x) {
    Landing& at = landings[static_cast<std::size_t>(x)];
    at.corner = nullptr;
    const float px = static_cast<float>(x) + u[x], py = static_cast<float>(y) + v[x];
    if (!(px >= 0 && py >= 0 && px <= last_x && py <= last_y) || (first_valid && !first_valid[x])) continue;
    const int ix = static_cast<int>(px), iy = static_cast<int>(py);
    if (!images.second_valid.empty() && !images.second_valid(iy, ix)) continue;
    // Coefficient (ix - 1, iy - 1) is the first of the 4 x 4 that a point in cell (ix, iy) needs.
    at = {coefficients + static_cast<std::size_t>(iy - 1 + SplineImage::kBorder) * step +
              static_cast<std::size_t>(ix - 1 + SplineImage::kBorder) * 4,
          px - static_cast<float>(ix), py - static_cast<float>(iy)};
  }
}

/// Residual and gradient of four channels at each pixel; zero where it is not seen.
CORTSHIFT_VECTORISED
void sampleRow(const Landing* landings, std::size_t step, const float* first, float* residual, float* gx, float* gy,
               int width) {
  for (int x = 0; x < width; ++x, first += 4, residual += 4, gx += 4, gy += 4) {
    const Landing& at = landings[x];
    if (!at.corner) {
      for (int c = 0; c < 4; ++c) residual[c] = gx[c] = gy[c] = 0;
      continue;
    }
    const float t = at.fx;
    const Float16 weight = kWeight0 + t * (kWeight1 + t * (kWeight2 + t * kWeight3));
    const Float16 slope = kWeight1 + t * (2 * kWeight2 + t * (3 * kWeight3));
    float wy[4], dy[4];
    splineWeights(at.fy, wy, dy);
    Float16 column{}, down{};  // along y first: what is left are four columns
    for (int j = 0; j < 4; ++j) {
      Float16 c;
      std::memcpy(&c, at.corner + static_cast<std::size_t>(j) * step, sizeof(c));
      column += c * wy[j];
      down += c * dy[j];
    }
    const Float16 value = column * weight, along_x = column * slope, along_y = down * weight;
    for (const auto& [all, out] : {std::pair(&value, residual), std::pair(&along_x, gx), std::pair(&along_y, gy)}) {
      Float4 part[4];
      std::memcpy(part, all, sizeof(part));
      const Float4 total = (part[0] + part[1]) + (part[2] + part[3]);
      std::memcpy(out, &total, sizeof(total));
    }
    for (int c = 0; c < 4; ++c) residual[c] -= first[c];
  }
}

/// Sums the products over the channels.
CORTSHIFT_VECTORISED
void tensorRow(const float* residual, const float* gx, const float* gy, const cv::Vec4f& channel_weights,
               const TensorRow& row, int width) {
  const float w0 = channel_weights[0], w1 = channel_weights[1], w2 = channel_weights[2];
  float* __restrict__ xx = row.xx, * __restrict__ xy = row.xy, * __restrict__ yy = row.yy, * __restrict__ xt = row.xt, * __restrict__ yt = row.yt, * __restrict__ tt = row.tt;
#pragma GCC ivdep
  for (int x = 0; x < width; ++x) {
    const float *r = residual + 4 * x, *a = gx + 4 * x, *b = gy + 4 * x;
    const float a0 = w0 * a[0], a1 = w1 * a[1], a2 = w2 * a[2], b0 = w0 * b[0], b1 = w1 * b[1], b2 = w2 * b[2];
    xx[x] = a0 * a[0] + a1 * a[1] + a2 * a[2];
    xy[x] = a0 * b[0] + a1 * b[1] + a2 * b[2];
    yy[x] = b0 * b[0] + b1 * b[1] + b2 * b[2];
    xt[x] = a0 * r[0] + a1 * r[1] + a2 * r[2];
    yt[x] = b0 * r[0] + b1 * r[1] + b2 * r[2];
    tt[x] = w0 * r[0] * r[0] + w1 * r[1] * r[1] + w2 * r[2] * r[2];
  }
}

}  // namespace

void lineariseRow(const ImagePair& images, int y, const float* u, const float* v, const cv::Vec4f& channel_weights,
                  RowScratch& scratch, const TensorRow& row) {
  const int width = images.second.width;
  scratch.resize(width);
  land(images, y, u, v, scratch.landings);
  sampleRow(scratch.landings.data(), images.second.coefficients.step1(), images.first.ptr<float>(y),
            scratch.residual.data(), scratch.gx.data(), scratch.gy.data(), width);
  tensorRow(scratch.residual.data(), scratch.gx.data(), scratch.gy.data(), channel_weights, row, width);
}

void linearise(const ImagePair& images, const Plane& u, const Plane& v, const cv::Vec4f& channel_weights,
               MotionTensor& tensor, int threads) {
  tensor.create(u.size());
  forRows(u.height(), threads, [&](int begin, int end) {
    RowScratch scratch;
    for (int y = begin; y < end; ++y)
      lineariseRow(
          images, y, u.row(y), v.row(y), channel_weights, scratch,
          {tensor.xx.row(y), tensor.xy.row(y), tensor.yy.row(y), tensor.xt.row(y), tensor.yt.row(y), tensor.tt.row(y)});
  });
}

}  // namespace cortshift_flow
