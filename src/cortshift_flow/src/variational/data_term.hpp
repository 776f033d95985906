// The data term of Ji et al. 2014, Eq. (3), linearised about the present flow.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "images/plane.hpp"
#include "images/spline.hpp"

namespace cortshift_flow {

/// Motion tensor per pixel, summed over the channels: with r_c the residual I2_c(x + w0) - I1_c(x) and g_c the
/// gradient of I2_c there, xx = sum g_x^2, xy = sum g_x g_y, yy = sum g_y^2, xt = sum g_x r, yt = sum g_y r and
/// tt = sum r^2. The squared norm in Eq. (3) at w0 + dw is then tt + 2 dw.(xt, yt) + dw' [xx xy; xy yy] dw.
/// All zero where the second image is not seen.
struct MotionTensor {
  Plane xx, xy, yy, xt, yt, tt;
  void create(cv::Size size) {
    for (Plane* plane : {&xx, &xy, &yy, &xt, &yt, &tt})
      if (plane->size() != size) plane->create(size.height, size.width);
  }
};

/// What the data term compares. Excluded pixels are 0 in the validity masks (CV_8UC1; empty: all valid); the
/// second's mask excludes every point whose interpolation would touch an excluded pixel.
struct ImagePair {
  cv::Mat4f first;
  SplineImage second;
  cv::Mat1b first_valid, second_valid;
};

/// One row of a motion tensor.
struct TensorRow {
  float *xx, *xy, *yy, *xt, *yt, *tt;
};

/// Where a pixel of the first image is seen in the second.
struct Landing {
  const float* corner;  ///< coefficient at the upper left of the 4 x 4 that the point needs; null: not seen
  float fx, fy;         ///< position within the cell
};

/// What one thread needs to linearise a row.
struct RowScratch {
  std::vector<Landing> landings;
  std::vector<float> residual, gx, gy;  // four channels
  void resize(int width) {
    landings.resize(static_cast<std::size_t>(width));
    for (auto* row : {&residual, &gx, &gy}) row->resize(4 * static_cast<std::size_t>(width));
  }
};

/// Row y about the flow (u, v) of that row. Each channel's square is multiplied by its weight.
void lineariseRow(const ImagePair& images, int y, const float* u, const float* v, const cv::Vec4f& channel_weights,
                  RowScratch& scratch, const TensorRow& out);

void linearise(const ImagePair& images, const Plane& u, const Plane& v, const cv::Vec4f& channel_weights,
               MotionTensor& tensor, int threads);

}  // namespace cortshift_flow
