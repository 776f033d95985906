#include "surround/coverings.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "cortshift_tracking/surround/outline.hpp"

namespace cortshift_tracking {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

constexpr double kWindow = 0.0014;  // [m] side of the window over which a colour is a mean: noise has any
constexpr double kReach = 0.001;    // [m] of a thing's edge; what is narrower than twice this is the glint of a vessel
// Chosen on config/phantom/fit, where cotton on a brain with a colour is told and nothing else is (script/benchmark
// surround --set config/phantom/fit --only limits).
constexpr float kOwnColour = 0.2F;  // of logarithms, between brain and bone: less is the camera's balance
constexpr float kNearer = 0.5F;     // of the distance to the other colour, at most, to be plainly of the one
constexpr double kAround = 0.67;    // of the ring around a thing, as far as it lies in the opening

/// log R/G and log RB/G^2: what blood changes, see tissue.hpp. CV_32FC2, of what is seen around.
cv::Mat hueOf(const Cells& cells) {
  const int window = 2 * static_cast<int>(kWindow / cells.side / 2) + 1;
  cv::Mat share, shares, colour = cells.colour.clone(), hue;
  cells.seen.convertTo(share, CV_32F, 1.0 / 255);
  colour.setTo(0, cells.seen == 0);
  cv::blur(share, share, {window, window});
  cv::blur(colour, colour, {window, window});
  cv::merge(std::vector<cv::Mat>(3, cv::max(share, 0.01F)), shares);
  cv::divide(colour, shares, colour);
  cv::transform(logarithmOf(colour), hue, cv::Matx<float, 2, 3>(0, -1, 1, 1, -2, 1));
  return hue;
}

cv::Vec2f medianOf(const cv::Mat& hue, const cv::Mat& mask) {
  std::vector<float> values[2];
  for (int row = 0; row < hue.rows; ++row)
    for (int column = 0; column < hue.cols; ++column)
      if (mask.at<uchar>(row, column) != 0)
        for (int i = 0; i < 2; ++i) values[i].push_back(hue.at<cv::Vec2f>(row, column)[i]);
  cv::Vec2f median(kNan, kNan);
  for (int i = 0; i < 2; ++i) {
    if (values[i].empty()) return median;
    const auto middle = values[i].begin() + static_cast<std::ptrdiff_t>(values[i].size() / 2);
    std::nth_element(values[i].begin(), middle, values[i].end());
    median[i] = *middle;
  }
  return median;
}

/// The pieces of a mask that are neither narrow nor small and have an edge: 1 to 2 mm outside it the brain has its own
/// colour again. The paleness of tissue fades.
/// @param opening CV_8UC1: no more is looked at
/// @param brain CV_8UC1 where it has its own colour
cv::Mat thingsIn(const cv::Mat& mask, const cv::Mat& opening, const cv::Mat& brain, double side) {
  const auto disc = [side](double radius) {
    const int width = 2 * static_cast<int>(std::lround(radius / side)) + 1;
    return cv::getStructuringElement(cv::MORPH_ELLIPSE, {width, width});
  };
  cv::Mat open, labels, statistics, centres, out = cv::Mat::zeros(mask.size(), CV_8UC1);
  cv::morphologyEx(mask, open, cv::MORPH_OPEN, disc(kReach));
  const int count = cv::connectedComponentsWithStats(open, labels, statistics, centres, 8, CV_32S);
  for (int i = 1; i < count; ++i) {
    if (statistics.at<int>(i, cv::CC_STAT_AREA) * side * side <= kSmallHole) continue;
    const cv::Mat piece = labels == i;
    cv::Mat near, far;
    cv::dilate(piece, near, disc(kReach));
    cv::dilate(piece, far, disc(2 * kReach));
    const cv::Mat ring = far & ~near & opening;
    if (cv::countNonZero(ring & brain) > kAround * cv::countNonZero(ring)) out |= near & mask;
  }
  return out;
}

}  // namespace

cv::Mat standingOut(const Cells& cells, const Parts& parts) {
  cv::Mat out = cv::Mat::zeros(cells.seen.size(), CV_8UC1), part;
  for (int other = 1; other < parts.areas.rows; ++other) {
    if (other == parts.largest || parts.areas.at<int>(other) * cells.side * cells.side <= kSmallHole) continue;
    // With its edge, which hangs together with nothing.
    cv::dilate(parts.labels == other, part, cv::getStructuringElement(cv::MORPH_RECT, {5, 5}));
    out |= part;
  }
  return out;
}

cv::Mat bloodlessIn(const Cells& cells, const cv::Mat& opening, const cv::Mat& bone) {
  const cv::Mat hue = hueOf(cells);
  const cv::Vec2f of_brain = medianOf(hue, opening & cells.seen), of_bone = medianOf(hue, bone);
  cv::Mat pale = cv::Mat::zeros(opening.size(), CV_8UC1), brain = pale.clone();
  if (!(cv::norm(of_brain - of_bone) > kOwnColour)) return pale;  // for NaN too
  for (int row = 0; row < pale.rows; ++row)
    for (int column = 0; column < pale.cols; ++column) {
      const cv::Vec2f& here = hue.at<cv::Vec2f>(row, column);
      const double to_bone = cv::norm(here - of_bone), to_brain = cv::norm(here - of_brain);
      if (to_bone < kNearer * to_brain) pale.at<uchar>(row, column) = 255;
      if (to_brain < kNearer * to_bone) brain.at<uchar>(row, column) = 255;
    }
  brain &= cells.seen;
  pale |= cells.seen == 0;  // as cotton that is too bright
  return thingsIn(pale & opening, opening, brain, cells.side);
}

}  // namespace cortshift_tracking
