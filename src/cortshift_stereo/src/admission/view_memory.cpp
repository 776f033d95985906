#include "cortshift_stereo/admission/view_memory.hpp"

#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>

namespace cortshift_stereo {
namespace {

constexpr int64_t kKept = 60000000000;  // [ns]
constexpr std::size_t kMost = 64;
constexpr double kTexture =
    1.5;  // [grey levels] standard deviation of detail; noise of a camera leaves 0.5 at half size
constexpr double kAgrees = 0.6;  // correlation; of two images of one view with such noise at least 0.9

constexpr double kMoved = 0.001;  // [m] more than any tracker trembles

std::string secondsText(int64_t ns) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f s", 1e-9 * static_cast<double>(ns));
  return text;
}

/// Half size, without what changes with the light.
cv::Mat detailOf(const cv::Mat& image) {
  cv::Mat grey, half, smooth;
  cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  cv::resize(grey, half, {}, 0.5, 0.5, cv::INTER_AREA);
  half.convertTo(half, CV_32F);
  cv::GaussianBlur(half, smooth, {}, 4);
  return half - smooth;
}

bool detailMoved(const cv::Mat& a, const cv::Mat& b) {
  if (a.size() != b.size()) return false;
  const cv::Size corner(a.cols / 4, a.rows / 4);
  int textured = 0, agreeing = 0;
  for (const int x : {0, a.cols - corner.width})
    for (const int y : {0, a.rows - corner.height}) {
      const cv::Rect place({x, y}, corner);
      const double energy_a = a(place).dot(a(place)), energy_b = b(place).dot(b(place));
      if (std::sqrt(std::min(energy_a, energy_b) / corner.area()) < kTexture) continue;
      ++textured;
      agreeing += a(place).dot(b(place)) > kAgrees * std::sqrt(energy_a * energy_b);
    }
  return textured >= 2 && agreeing == 0;
}

}  // namespace

bool surroundingsMoved(const cv::Mat& a, const cv::Mat& b) { return detailMoved(detailOf(a), detailOf(b)); }

Findings ViewMemory::add(int64_t stamp_ns, const Eigen::Isometry3d& T_pmr_left, const cv::Mat& image,
                         const std::shared_ptr<const void>& optics) {
  Findings found;
  if (!views_.empty() && stamp_ns < views_.back().stamp_ns) views_.clear();  // a recording that runs again
  while (!views_.empty() && (stamp_ns - views_.front().stamp_ns > kKept || views_.size() == kMost)) views_.pop_front();
  const View view{stamp_ns, T_pmr_left, detailOf(image), optics};
  for (const View& earlier : views_) {
    if (earlier.optics != optics || earlier.detail.size() != view.detail.size()) continue;
    const std::string ago = secondsText(stamp_ns - earlier.stamp_ns);
    const double moved = (earlier.T_pmr_left.translation() - T_pmr_left.translation()).norm();
    if (moved > kMoved && cv::norm(earlier.detail, view.detail, cv::NORM_INF) == 0) {
      found.refuse(CheckId::kImageRepeated, "The left image",
                   "is bit by bit the one of " + ago + " before, though the camera has moved since",
                   "the camera or its driver repeats itself; start it again");
      return found;
    }
    if (earlier.T_pmr_left.matrix() != T_pmr_left.matrix() || !detailMoved(earlier.detail, view.detail)) continue;
    found.refuse(CheckId::kPoseStuck, "The pose of the camera",
                 "is bit by bit the one of " + ago + " before, but the surroundings in the image have moved since",
                 "the tracker repeats itself; check that it sees the microscope, and the connection to it");
    return found;
  }
  views_.push_back(view);
  return found;
}

}  // namespace cortshift_stereo
