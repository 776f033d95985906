#include "matching/depth_edges.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

namespace cortshift_stereo {
namespace {

constexpr float kStep = 2;         // [px] of disparity between two surfaces
constexpr int kRim = 2;            // [px] up to this far from an edge, matching can be wrong
constexpr int kReach = 7;          // [px] at this distance, beyond the rim, the two surfaces are looked up
constexpr float kAlike = 10;       // [grey levels]
constexpr int kNeighbourhood = 2;  // [px] that is compared with the right image
constexpr float kUnlike = 20;      // [grey levels] a larger difference counts as this
constexpr float kPlainly = 0.7f;  // below this part of the other disparity's difference the right image decides: a thin
                                  // thing before its background

/// CV_8UC1, 255 within kRim of a step.
cv::Mat rimOfSteps(const cv::Mat& disparity) {
  constexpr float kFar = 1e6f;
  const cv::Mat known = disparity == disparity;
  cv::Mat least = disparity.clone(), greatest = disparity.clone(), rim;
  least.setTo(kFar, ~known);
  greatest.setTo(-kFar, ~known);
  cv::erode(least, least, cv::Mat());
  cv::dilate(greatest, greatest, cv::Mat());
  cv::dilate(greatest - least > kStep, rim, cv::Mat(2 * kRim + 1, 2 * kRim + 1, CV_8UC1, cv::Scalar(1)));
  return rim & known;
}

/// What one pixel sees around it.
class Judge {
 public:
  Judge(const cv::Mat& disparity, const cv::Mat& left, const cv::Mat& right)
      : disparity_(disparity), left_(left), right_(right) {
    for (std::size_t i = 0; i < weights_.size(); ++i) weights_[i] = std::exp(-static_cast<float>(i) / kAlike);
  }

  /// The disparity of a pixel after both tests; NaN where they contradict each other.
  float settle(int y, int x) {
    const float own = disparity_.at<float>(y, x);
    float below = 0, above = 0, all = 0;
    visit(y, x, kReach, [&](int row, int column, float weight) {
      const float d = disparity_.at<float>(row, column);
      all += d == d ? weight : 0;
      below += d < own - kStep ? weight : 0;
      above += d > own + kStep ? weight : 0;
    });
    if (std::max(below, above) < 0.5f * all) return own;
    const float other = median(y, x, 0.5f * all);
    const float unlike_own = unlikeness(y, x, own), unlike_other = unlikeness(y, x, other);
    if (unlike_other < unlike_own) return other;
    return unlike_own < kPlainly * unlike_other ? own : std::numeric_limits<float>::quiet_NaN();
  }

 private:
  template <typename Visitor>
  void visit(int y, int x, int reach, const Visitor& visitor) const {
    const int middle = left_.at<uint8_t>(y, x);
    const int first = std::max(0, x - reach), last = std::min(left_.cols - 1, x + reach);
    for (int row = std::max(0, y - reach); row <= std::min(left_.rows - 1, y + reach); ++row) {
      const uint8_t* grey = left_.ptr<uint8_t>(row);
      for (int column = first; column <= last; ++column)
        visitor(row, column, weights_[static_cast<std::size_t>(std::abs(grey[column] - middle))]);
    }
  }

  float median(int y, int x, float half) {
    seen_.clear();
    visit(y, x, kReach, [&](int row, int column, float weight) {
      const float d = disparity_.at<float>(row, column);
      if (d == d) seen_.emplace_back(d, weight);
    });
    std::sort(seen_.begin(), seen_.end());
    float sum = 0;
    for (const auto& [d, weight] : seen_)
      if ((sum += weight) >= half) return d;
    return seen_.back().first;
  }

  /// Mean difference between the neighbourhood and the right image at a disparity [grey levels].
  float unlikeness(int y, int x, float d) const {
    float sum = 0, weights = 0;
    visit(y, x, kNeighbourhood, [&](int row, int column, float weight) {
      const float partner = std::clamp(static_cast<float>(column) - d, 0.0f, static_cast<float>(right_.cols - 1));
      const int before = std::min(static_cast<int>(partner), right_.cols - 2);
      const float t = partner - static_cast<float>(before);
      const uint8_t* from = right_.ptr<uint8_t>(row) + before;
      const float there = (1 - t) * from[0] + t * from[1];
      sum += weight * std::min(std::abs(left_.at<uint8_t>(row, column) - there), kUnlike);
      weights += weight;
    });
    return sum / weights;
  }

  const cv::Mat &disparity_, &left_, &right_;
  std::array<float, 256> weights_;  // of a neighbour by the difference of its grey level
  std::vector<std::pair<float, float>> seen_;
};

}  // namespace

void settleDepthEdges(cv::Mat& disparity, const cv::Mat& left, const cv::Mat& right) {
  CV_Assert(disparity.type() == CV_32FC1 && left.type() == CV_8UC1 && right.type() == CV_8UC1);
  CV_Assert(left.size() == disparity.size() && right.size() == disparity.size());
  const cv::Mat before = disparity.clone(), rim = rimOfSteps(before);
  cv::parallel_for_(cv::Range(0, disparity.rows), [&](const cv::Range& rows) {
    Judge judge(before, left, right);
    for (int y = rows.start; y < rows.end; ++y)
      for (int x = 0; x < disparity.cols; ++x)
        if (rim.at<uint8_t>(y, x)) disparity.at<float>(y, x) = judge.settle(y, x);
  });
}

}  // namespace cortshift_stereo
