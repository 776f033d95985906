#include "images/prepare.hpp"

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

#include "images/pyramid.hpp"
#include "parallel.hpp"
#include "start/fill.hpp"

namespace cortshift_flow {
namespace {

constexpr int kSmallestSide = 16, kLargestSide = 4096;

std::string sizeText(const cv::Mat& image) { return std::to_string(image.cols) + "x" + std::to_string(image.rows); }

void checkMask(const cv::Mat& mask, const cv::Mat& image, const std::string& name) {
  if (mask.empty()) return;
  if (mask.type() != CV_8UC1) throw std::invalid_argument(name + " is not 8-bit with one channel (CV_8UC1)");
  if (mask.size() != image.size())
    throw std::invalid_argument(name + " is " + sizeText(mask) + " but its image is " + sizeText(image));
  if (cv::countNonZero(mask) == 0) throw std::invalid_argument(name + " excludes every pixel");
}

template <typename Value>
void toFloat(const cv::Mat& image, float scale, cv::Mat4f& out, int threads) {
  const int channels = image.channels();
  forRows(image.rows, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y) {
      const Value* in = image.ptr<Value>(y);
      float* to = out.ptr<float>(y);
      for (int x = 0; x < image.cols; ++x) {
        const Value* colour = in + static_cast<std::ptrdiff_t>(x) * channels;
        for (int c = 0; c < 3; ++c) to[4 * x + c] = scale * static_cast<float>(colour[channels == 3 ? c : 0]);
        to[4 * x + 3] = 0;
      }
    }
  });
}

cv::Mat4f toFloat(const cv::Mat& image, int threads) {
  cv::Mat4f out(image.size());
  if (image.depth() == CV_8U)
    toFloat<uchar>(image, 1 / 255.f, out, threads);
  else if (image.depth() == CV_16U)
    toFloat<ushort>(image, 1 / 65535.f, out, threads);
  else
    toFloat<float>(image, 1.f, out, threads);
  return out;
}

/// 1 where a pixel counts; empty where all do.
cv::Mat1b validity(const cv::Mat& image, const cv::Mat4f& floats, const cv::Mat& mask) {
  cv::Mat1b valid;
  if (!mask.empty()) valid = cv::Mat1b(mask != 0) / 255;
  if (image.depth() != CV_32F) return valid;
  for (int y = 0; y < floats.rows; ++y)
    for (int x = 0; x < floats.cols; ++x) {
      const cv::Vec4f& colour = floats(y, x);
      if (std::isfinite(colour[0]) && std::isfinite(colour[1]) && std::isfinite(colour[2])) continue;
      if (valid.empty()) valid = cv::Mat1b(floats.size(), uchar{1});
      valid(y, x) = 0;
    }
  return valid;
}

cv::Mat1b halveValidity(const cv::Mat1b& fine, cv::Size size) {
  if (fine.empty()) return {};
  cv::Mat1b eroded, coarse(size);
  cv::erode(fine, eroded, cv::Mat::ones(5, 5, CV_8U));  // the pixels that the low-pass reads
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x) coarse(y, x) = eroded(2 * y, 2 * x);
  return coarse;
}

}  // namespace

void checkImages(const cv::Mat& first, const cv::Mat& second, const cv::Mat& mask, const cv::Mat& second_mask) {
  if (first.empty() || second.empty())
    throw std::invalid_argument(std::string("the ") + (first.empty() ? "first" : "second") + " image is empty");
  if (first.dims != 2 || second.dims != 2) throw std::invalid_argument("an image has more than two dimensions");
  if (first.size() != second.size())
    throw std::invalid_argument("the images differ in size: " + sizeText(first) + " and " + sizeText(second));
  if (first.type() != second.type()) throw std::invalid_argument("the images differ in type");
  if (first.depth() != CV_8U && first.depth() != CV_16U && first.depth() != CV_32F)
    throw std::invalid_argument("the images' depth is not 8-bit, 16-bit or float (CV_8U, CV_16U, CV_32F)");
  if (first.channels() != 1 && first.channels() != 3)
    throw std::invalid_argument("the images have " + std::to_string(first.channels()) +
                                " channels; 1 or 3 are allowed");
  if (std::min(first.cols, first.rows) < kSmallestSide || std::max(first.cols, first.rows) > kLargestSide)
    throw std::invalid_argument("the images are " + sizeText(first) + "; " + std::to_string(kSmallestSide) + " to " +
                                std::to_string(kLargestSide) + " pixels a side are allowed");
  checkMask(mask, first, "the first image's mask");
  checkMask(second_mask, second, "the second image's mask");
}

Level prepareImages(const cv::Mat& first, const cv::Mat& second, const cv::Mat& mask, const cv::Mat& second_mask,
                    int threads) {
  Level level;
  level.first = toFloat(first, threads);
  level.second = toFloat(second, threads);
  level.first_valid = validity(first, level.first, mask);
  level.second_valid = validity(second, level.second, second_mask);
  if (!level.first_valid.empty() && cv::countNonZero(level.first_valid) == 0)
    throw std::invalid_argument("the first image has no pixel that is finite and not masked");
  if (!level.second_valid.empty() && cv::countNonZero(level.second_valid) == 0)
    throw std::invalid_argument("the second image has no pixel that is finite and not masked");
  if (!level.first_valid.empty()) fillUnknown(level.first, level.first_valid);
  if (!level.second_valid.empty()) fillUnknown(level.second, level.second_valid);
  return level;
}

Level halve(const Level& level, int threads) {
  Level coarse;
  coarse.first = halve(level.first, threads);
  coarse.second = halve(level.second, threads);
  coarse.first_valid = halveValidity(level.first_valid, coarse.first.size());
  coarse.second_valid = halveValidity(level.second_valid, coarse.second.size());
  return coarse;
}

cv::Mat1b interpolable(const cv::Mat1b& valid) {
  if (valid.empty()) return {};
  // Cell (x, y) needs pixels x - 1...x + 2; their spline coefficients also depend on pixels farther away. Two more
  // pixels are excluded, so that less than 1/50 of what was filled in reaches the cell (and the filling is smooth).
  cv::Mat1b result;
  cv::erode(valid, result, cv::Mat::ones(6, 6, CV_8U), cv::Point(2, 2));
  return result;
}

Level interpolableLevel(const Level& level) {
  return {level.first, level.second, level.first_valid, interpolable(level.second_valid)};
}

Level swapped(const Level& level) { return {level.second, level.first, level.second_valid, level.first_valid}; }

}  // namespace cortshift_flow
