#include "cortshift_stereo/matching/matching.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "matching/depth_edges.hpp"

namespace cortshift_stereo {
namespace {

constexpr int kStep = 16;  // OpenCV's matcher takes a number of disparities that is a multiple of this

int roundUp(int length) { return (length + kStep - 1) / kStep * kStep; }

/// Both images at a fraction of their size, each in a thread of its own.
std::pair<cv::Mat, cv::Mat> reduced(const cv::Mat& left, const cv::Mat& right, double scale) {
  std::pair<cv::Mat, cv::Mat> out;
  cv::parallel_for_(cv::Range(0, 2), [&](const cv::Range& sides) {
    for (int side = sides.start; side < sides.end; ++side)
      cv::resize(side == 0 ? left : right, side == 0 ? out.first : out.second, {}, scale, scale, cv::INTER_AREA);
  });
  return out;
}

/// Share of the matched pixels with a step of disparity beside them.
double shareOfEdges(const cv::Mat& disparity) {
  constexpr float kEdge = 1.5f;  // [px] no tissue is so steep
  int edges = 0, matched = 0;
  for (int y = 0; y + 1 < disparity.rows; ++y) {
    const float *row = disparity.ptr<float>(y), *below = disparity.ptr<float>(y + 1);
    for (int x = 0; x + 1 < disparity.cols; ++x) {
      matched += !std::isnan(row[x]);
      edges += std::abs(row[x + 1] - row[x]) > kEdge || std::abs(below[x] - row[x]) > kEdge;  // not for NaN
    }
  }
  return static_cast<double>(edges) / std::max(1, matched);
}

}  // namespace

cv::Mat matchSemiGlobal(const cv::Mat& left, const cv::Mat& right, const SearchRange& range) {
  CV_Assert(left.type() == CV_8UC1 && right.type() == CV_8UC1 && left.size() == right.size());
  CV_Assert(range.size() > 0 && range.size() % kStep == 0);
  const cv::Size size = left.size();
  // OpenCV leaves out the columns left of the highest disparity, seen or not. Shifting the right image by the lowest
  // disparity and adding a rim as wide as the range keeps every column, and makes negative ranges ordinary ones.
  const int rim = range.size();
  const cv::Size canvas(size.width + rim, size.height);
  cv::Mat left_canvas, right_canvas(canvas, CV_8UC1);
  cv::copyMakeBorder(left, left_canvas, 0, 0, rim, 0, cv::BORDER_REPLICATE);
  for (int y = 0; y < size.height; ++y) {
    const uint8_t* from = right.ptr<uint8_t>(y);
    uint8_t* to = right_canvas.ptr<uint8_t>(y);
    for (int x = 0; x < canvas.width; ++x) to[x] = from[std::clamp(x - rim - range.start, 0, size.width - 1)];
  }
  constexpr int kBlock = 5, kPenaltySmall = 8 * kBlock * kBlock, kPenaltyLarge = 32 * kBlock * kBlock;
  constexpr int kPreFilterCap = 31, kUniqueness = 5;
  const auto matcher = cv::StereoSGBM::create(0, range.size(), kBlock, kPenaltySmall, kPenaltyLarge, 1, kPreFilterCap,
                                              kUniqueness, 0, 0, cv::StereoSGBM::MODE_SGBM_3WAY);
  cv::Mat fixed;
  matcher->compute(left_canvas, right_canvas, fixed);
  constexpr int kInvalid = -cv::StereoMatcher::DISP_SCALE;
  const int speckle = std::max(20, static_cast<int>(size.area() / 4000));
  cv::filterSpeckles(fixed, kInvalid, speckle, cv::StereoMatcher::DISP_SCALE);

  cv::Mat disparity(size, CV_32FC1);
  for (int y = 0; y < size.height; ++y) {
    const int16_t* from = fixed.ptr<int16_t>(y) + rim;
    float* to = disparity.ptr<float>(y);
    for (int x = 0; x < size.width; ++x) {
      const float d = static_cast<float>(from[x]) / cv::StereoMatcher::DISP_SCALE + static_cast<float>(range.start);
      const float partner = static_cast<float>(x) - d;
      const bool seen = from[x] >= 0 && partner >= 0 && partner <= static_cast<float>(size.width - 1);
      to[x] = seen ? d : std::numeric_limits<float>::quiet_NaN();
    }
  }
  return disparity;
}

cv::Mat matchByStructure(const cv::Mat& left, const cv::Mat& right, const SearchRange& range) {
  constexpr double kManyEdges = 0.005;  // a cortex with sulci has 0.001, indoor scenes 0.02
  constexpr int kSmallestWidth = 640;   // below, full resolution is cheap
  if (left.cols >= kSmallestWidth) {
    const auto [left_half, right_half] = reduced(left, right, 0.5);
    cv::Mat disparity;
    const int start = static_cast<int>(std::floor(range.start / 2.0));
    const cv::Mat half = matchSemiGlobal(left_half, right_half, {start, start + roundUp((range.size() + 1) / 2)});
    if (shareOfEdges(half) < kManyEdges) {
      cv::resize(2 * half, disparity, left.size(), 0, 0, cv::INTER_NEAREST);
      return disparity;
    }
  }
  cv::Mat disparity = matchSemiGlobal(left, right, range);
  settleDepthEdges(disparity, left, right);
  return disparity;
}

void dropIslands(cv::Mat& disparity) {
  constexpr double kShare = 1e-3, kStepOfFixed = 16, kNeighbours = 0.75;  // [px] apart at most
  constexpr int kNone = std::numeric_limits<int16_t>::min();
  cv::Mat fixed;
  const cv::Mat known = disparity == disparity;
  disparity.convertTo(fixed, CV_16S, kStepOfFixed);
  fixed.setTo(kNone, ~known);
  cv::filterSpeckles(fixed, kNone, cvRound(kShare * static_cast<double>(disparity.total())),
                     kStepOfFixed * kNeighbours);
  disparity.setTo(std::numeric_limits<float>::quiet_NaN(), fixed == kNone);
}

SearchRange possibleRange(const StereoModel& model, double near, double far) {
  CV_Assert(near > 0 && far > near);
  const double f_times_b = model.left.P(0, 0) * model.baseline();
  const double offset = model.left.P(0, 2) - model.right.P(0, 2);
  const int width = model.left.size.width;
  // At a disparity larger than the image is wide, the two views have nothing in common.
  const int low = std::clamp(static_cast<int>(std::floor(f_times_b / far + offset)), -width, width - 1);
  const int high = std::clamp(static_cast<int>(std::ceil(f_times_b / near + offset)), low + 1, width);
  return {low, high};
}

SearchRange usedRange(const cv::Mat& left, const cv::Mat& right, const StereoModel& model, const SearchRange& possible,
                      double relief) {
  const auto margin = [&](double disparity) {  // [px] of `relief` at the depth of `disparity`
    const double z = depthOfDisparity(model, disparity);
    return model.left.P(0, 0) * model.baseline() * relief / (z * z);
  };
  constexpr double kMinimumMatched = 0.1;  // share of the reduced image
  constexpr double kLowQuantile = 0.003, kHighQuantile = 0.997;
  for (const int reduced_width : {160, 320}) {
    const double scale = std::min(1.0, static_cast<double>(reduced_width) / left.cols);
    const auto [left_small, right_small] = reduced(left, right, scale);
    const int low = static_cast<int>(std::floor(possible.start * scale));
    const SearchRange range(low, low + roundUp(static_cast<int>(std::ceil(possible.end * scale)) - low + 1));
    const cv::Mat disparity = matchSemiGlobal(left_small, right_small, range);
    std::vector<float> found;
    for (const float d : cv::Mat_<float>(disparity))
      if (std::isfinite(d)) found.push_back(d / static_cast<float>(scale));
    if (static_cast<double>(found.size()) < kMinimumMatched * static_cast<double>(disparity.total())) continue;
    std::sort(found.begin(), found.end());
    const auto quantile = [&](double share) {
      return found[static_cast<std::size_t>(share * static_cast<double>(found.size() - 1))];
    };
    const double quantum = 1 / scale, lowest = quantile(kLowQuantile), highest = quantile(kHighQuantile);
    const int start = static_cast<int>(std::floor(lowest - margin(lowest) - quantum));
    const int end = static_cast<int>(std::ceil(highest + margin(highest) + quantum)) + 1;
    const int length = roundUp(end - start);
    const int first = start - (length - (end - start)) / 2;
    return {first, first + length};
  }
  return {};
}

}  // namespace cortshift_stereo
