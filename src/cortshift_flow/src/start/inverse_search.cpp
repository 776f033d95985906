#include "start/inverse_search.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

namespace cortshift_flow {
namespace {

constexpr int kSmallestSide = 32;  // of an image that DIS has patches for [px]

cv::Mat1b greyBytes(const cv::Mat4f& image) {
  cv::Mat grey;
  cv::transform(image, grey, cv::Matx14f(0.114f, 0.587f, 0.299f, 0));
  grey.convertTo(grey, CV_8U, 255);
  return grey;
}

void search(const cv::Mat1b& from, const cv::Mat1b& to, FlowPlanes& flow) {
  const auto dis = cv::DISOpticalFlow::create(cv::DISOpticalFlow::PRESET_MEDIUM);
  dis->setVariationalRefinementIterations(0);  // Eq. (5) follows anyway
  dis->setPatchStride(4);
  cv::Mat2f dense;
  dis->calc(from, to, dense);
  for (int y = 0; y < flow.u.height(); ++y)
    for (int x = 0; x < flow.u.width(); ++x) {
      const cv::Vec2f& w = dense(std::min(2 * y, dense.rows - 1), std::min(2 * x, dense.cols - 1));
      flow.u.row(y)[x] = 0.5f * w[0];
      flow.v.row(y)[x] = 0.5f * w[1];
    }
}

}  // namespace

InverseSearch inverseSearch(const Level& fine, cv::Size size) {
  InverseSearch result{{Plane(size), Plane(size)}, {Plane(size), Plane(size)}};
  if (std::min(fine.first.cols, fine.first.rows) < kSmallestSide) return result;
  const cv::Mat1b first = greyBytes(fine.first), second = greyBytes(fine.second);
  search(first, second, result.forward);
  search(second, first, result.backward);
  return result;
}

}  // namespace cortshift_flow
