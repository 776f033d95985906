#include "start/fill.hpp"

#include <algorithm>

namespace cortshift_flow {
namespace {

/// Values of four channels, the last of which is the weight that the others are multiplied by.
using Weighted = cv::Mat4f;

Weighted pull(const Weighted& fine) {
  Weighted coarse((fine.rows + 1) / 2, (fine.cols + 1) / 2);
  for (int y = 0; y < coarse.rows; ++y)
    for (int x = 0; x < coarse.cols; ++x) {
      const int x1 = std::min(2 * x + 1, fine.cols - 1), y1 = std::min(2 * y + 1, fine.rows - 1);
      cv::Vec4f sum = fine(2 * y, 2 * x) + fine(2 * y, x1) + fine(y1, 2 * x) + fine(y1, x1);
      if (sum[3] > 1) sum *= 1 / sum[3];  // weight 1 is enough: such a value is not mixed with values from farther away
      coarse(y, x) = sum;
    }
  return coarse;
}

void push(const Weighted& coarse, Weighted& fine) {
  for (int y = 0; y < fine.rows; ++y)
    for (int x = 0; x < fine.cols; ++x) {
      cv::Vec4f& here = fine(y, x);
      if (here[3] >= 1) continue;
      const float cx = std::clamp(0.5f * static_cast<float>(x) - 0.25f, 0.f, static_cast<float>(coarse.cols - 1));
      const float cy = std::clamp(0.5f * static_cast<float>(y) - 0.25f, 0.f, static_cast<float>(coarse.rows - 1));
      const int x0 = static_cast<int>(cx), y0 = static_cast<int>(cy);
      const int x1 = std::min(x0 + 1, coarse.cols - 1), y1 = std::min(y0 + 1, coarse.rows - 1);
      const float fx = cx - static_cast<float>(x0), fy = cy - static_cast<float>(y0);
      const cv::Vec4f around = (1 - fy) * ((1 - fx) * coarse(y0, x0) + fx * coarse(y0, x1)) +
                               fy * ((1 - fx) * coarse(y1, x0) + fx * coarse(y1, x1));
      here += (1 - here[3]) * around;  // `around` has weight 1
    }
}

void pushPull(Weighted& values) {
  std::vector<Weighted> levels = {values};
  while (levels.back().rows > 1 || levels.back().cols > 1) levels.push_back(pull(levels.back()));
  Weighted& top = levels.back();
  if (top(0, 0)[3] > 0) top(0, 0) *= 1 / top(0, 0)[3];
  top(0, 0)[3] = 1;
  for (std::size_t i = levels.size() - 1; i > 0; --i) push(levels[i], levels[i - 1]);
  values = levels[0];
}

}  // namespace

void fillUnknown(FlowPlanes& flow, const cv::Mat1f& weight) {
  Weighted values(weight.size());
  for (int y = 0; y < weight.rows; ++y)
    for (int x = 0; x < weight.cols; ++x) {
      const float w = weight(y, x);
      values(y, x) = cv::Vec4f(w * flow.u.row(y)[x], w * flow.v.row(y)[x], 0, w);
    }
  pushPull(values);
  for (int y = 0; y < weight.rows; ++y)
    for (int x = 0; x < weight.cols; ++x) {
      flow.u.row(y)[x] = values(y, x)[0];
      flow.v.row(y)[x] = values(y, x)[1];
    }
}

void fillUnknown(cv::Mat4f& image, const cv::Mat1b& valid) {
  Weighted values(image.size());
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols; ++x) {
      const cv::Vec4f& colour = image(y, x);
      values(y, x) = valid(y, x) ? cv::Vec4f(colour[0], colour[1], colour[2], 1) : cv::Vec4f(0, 0, 0, 0);
    }
  pushPull(values);
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols; ++x) {
      const cv::Vec4f& value = values(y, x);
      image(y, x) = cv::Vec4f(value[0], value[1], value[2], 0);
    }
}

}  // namespace cortshift_flow
