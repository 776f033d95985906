#include "cortshift_stereo/rectifier.hpp"

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "cubic.hpp"

namespace cortshift_stereo {
namespace {

constexpr int kSaturated = 250;  // [grey levels] in the brightest channel: tissue there has no texture left

/// Luminance at the positions of `map`, without the 1/32 px grid that cv::remap rounds positions to.
cv::Mat sample(const cv::Mat& image, const cv::Mat& map, const cv::Mat& inside) {
  cv::Mat out(map.size(), CV_32FC1);
  cv::parallel_for_(cv::Range(0, out.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      const auto* at = map.ptr<cv::Vec2f>(y);
      const uint8_t* in = inside.ptr<uint8_t>(y);
      float* to = out.ptr<float>(y);
      for (int x = 0; x < out.cols; ++x) {
        if (!in[x]) {
          to[x] = 0;
          continue;
        }
        const int column = static_cast<int>(at[x][0]), row = static_cast<int>(at[x][1]);
        const CubicWeights horizontal(at[x][0] - static_cast<float>(column));
        const CubicWeights vertical(at[x][1] - static_cast<float>(row));
        float sum = 0;
        for (int k = 0; k < 4; ++k) sum += vertical[k] * horizontal.apply(image.ptr<float>(row - 1 + k) + column - 1);
        to[x] = sum;
      }
    }
  });
  return out;
}

}  // namespace

Rectifier::Rectifier(const StereoModel& model, const PixelWarp& left_warp, const PixelWarp& right_warp)
    : model_(model) {
  model_.validate();
  left_ = makeSide(model_.left, left_warp);
  right_ = makeSide(model_.right, right_warp);
}

Rectifier::Side Rectifier::makeSide(const CameraModel& camera, const PixelWarp& warp) {
  const cv::Size size = camera.size;
  Side side;
  cv::Mat map_x, map_y;
  cv::initUndistortRectifyMap(camera.K, camera.D, camera.R, camera.P.get_minor<3, 3>(0, 0), size, CV_32FC1, map_x,
                              map_y);
  cv::merge(std::vector<cv::Mat>{map_x, map_y}, side.map);
  side.inside.create(size, CV_8UC1);
  for (int y = 0; y < size.height; ++y) {
    auto* at = side.map.ptr<cv::Vec2f>(y);
    uint8_t* in = side.inside.ptr<uint8_t>(y);
    for (int x = 0; x < size.width; ++x) {
      if (warp) {
        const cv::Point2d warped = warp({at[x][0], at[x][1]});
        at[x] = cv::Vec2f(static_cast<float>(warped.x), static_cast<float>(warped.y));
      }
      const bool whole_kernel = at[x][0] >= 1 && at[x][1] >= 1 && at[x][0] < static_cast<float>(size.width - 2) &&
                                at[x][1] < static_cast<float>(size.height - 2);
      in[x] = whole_kernel ? 255 : 0;
    }
  }
  cv::convertMaps(side.map, cv::noArray(), side.map_near, side.map_share, CV_16SC2);
  return side;
}

cv::Mat Rectifier::usable(const cv::Mat& raw, const Side& side) {
  std::vector<cv::Mat> channels;
  cv::split(raw, channels);
  cv::Mat mask = cv::max(cv::max(channels[0], channels[1]), channels[2]) < kSaturated;
  // The rim of a highlight is blurred and clipped in part; the interpolation kernel reaches over it.
  cv::erode(mask, mask, cv::Mat::ones(5, 5, CV_8U));
  cv::Mat rectified;
  cv::remap(mask, rectified, side.map_near, side.map_share, cv::INTER_NEAREST);
  return rectified & side.inside;
}

RectifiedPair Rectifier::rectify(const cv::Mat& left, const cv::Mat& right) const {
  for (const cv::Mat* image : {&left, &right})
    if (image->type() != CV_8UC3 || image->size() != model_.left.size)
      throw std::invalid_argument("rectify: both images must be 8-bit colour and of the calibrated size " +
                                  std::to_string(model_.left.size.width) + "x" +
                                  std::to_string(model_.left.size.height));
  const auto luminance = [](const cv::Mat& raw, const Side& side) {
    cv::Mat grey, grey_float;
    cv::cvtColor(raw, grey, cv::COLOR_BGR2GRAY);
    grey.convertTo(grey_float, CV_32F);
    return sample(grey_float, side.map, side.inside);
  };
  RectifiedPair out;
  out.left = luminance(left, left_);
  out.right = luminance(right, right_);
  cv::remap(left, out.left_colour, left_.map_near, left_.map_share, cv::INTER_CUBIC);
  out.left_usable = usable(left, left_);
  out.right_usable = usable(right, right_);
  return out;
}

}  // namespace cortshift_stereo
