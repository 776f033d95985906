#include "surround/cells.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace cortshift_tracking {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

constexpr double kSteepest = 2.5;  // 68 degrees: steeper is a step of depth, and what lies beyond another thing

}  // namespace

Cells cellsOf(const Projection& projection, double side) {
  Cells cells;
  cells.step = std::max(1, static_cast<int>(std::lround(side / projection.resolution)));
  cells.side = cells.step * projection.resolution;
  const cv::Size size(projection.mask.cols / cells.step, projection.mask.rows / cells.step);
  if (size.empty()) return cells;
  const cv::Rect whole(0, 0, size.width * cells.step, size.height * cells.step);
  const auto meanOf = [&](const cv::Mat& picture) {
    cv::Mat mean;
    cv::resize(picture(whole), mean, size, 0, 0, cv::INTER_AREA);
    return mean;
  };
  cv::Mat share, divisor, height = projection.height.clone();
  projection.mask.convertTo(share, CV_32F, 1.0 / 255);
  share = meanOf(share);
  cells.seen = share > 0.5;
  share = cv::max(share, 0.01F);
  cv::merge(std::vector<cv::Mat>(3, share), divisor);
  cv::divide(meanOf(projection.colour), divisor, cells.colour);  // 0 outside the mask
  height.setTo(0, projection.mask == 0);
  cv::divide(meanOf(height), share, cells.height);
  cells.height.setTo(kNan, cells.seen == 0);
  return cells;
}

Parts partsOf(const Cells& cells) {
  cv::Mat smooth = cells.seen.clone();
  const auto limit = static_cast<float>(kSteepest * cells.side);
  const auto compare = [&](int row, int column, int other_row, int other_column) {
    if (std::abs(cells.height.at<float>(row, column) - cells.height.at<float>(other_row, other_column)) > limit)
      smooth.at<uchar>(row, column) = smooth.at<uchar>(other_row, other_column) = 0;
  };
  for (int row = 0; row < smooth.rows; ++row)
    for (int column = 0; column < smooth.cols; ++column) {
      if (column > 0) compare(row, column, row, column - 1);
      if (row > 0) compare(row, column, row - 1, column);
    }
  Parts parts;
  cv::Mat statistics, centres;
  const int count = cv::connectedComponentsWithStats(smooth, parts.labels, statistics, centres, 4, CV_32S);
  parts.areas = statistics.col(cv::CC_STAT_AREA).clone();
  for (int part = 1; part < count; ++part)
    if (parts.largest == 0 || parts.areas.at<int>(part) > parts.areas.at<int>(parts.largest)) parts.largest = part;
  return parts;
}

cv::Mat logarithmOf(const cv::Mat& colour) {
  cv::Mat logarithm;
  cv::log(colour + cv::Scalar::all(4.0 / 255), logarithm);
  return logarithm;
}

}  // namespace cortshift_tracking
