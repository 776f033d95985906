#include "calibration/convex_hull.hpp"

#include <algorithm>

namespace cortshift_stereo {
namespace {

/// One side of the hull of points sorted along it (monotone chain).
template <typename Iterator>
std::vector<cv::Point2d> chain(Iterator first, Iterator last) {
  std::vector<cv::Point2d> side;
  for (; first != last; ++first) {
    while (side.size() >= 2 && (side.back() - side[side.size() - 2]).cross(*first - side.back()) <= 0) side.pop_back();
    side.push_back(*first);
  }
  return side;
}

double distanceFromSegment(const cv::Point2d& a, const cv::Point2d& b, const cv::Point2d& point) {
  const cv::Point2d along = b - a;
  const double length = along.dot(along);
  const double share = length > 0 ? std::clamp((point - a).dot(along) / length, 0.0, 1.0) : 0.0;
  return cv::norm(point - (a + share * along));
}

}  // namespace

std::vector<cv::Point2d> convexHull(std::vector<cv::Point2d> points) {
  const auto before = [](const cv::Point2d& a, const cv::Point2d& b) { return a.x < b.x || (a.x == b.x && a.y < b.y); };
  std::sort(points.begin(), points.end(), before);
  points.erase(std::unique(points.begin(), points.end()), points.end());
  if (points.size() < 3) return points;
  auto hull = chain(points.begin(), points.end());
  const auto upper = chain(points.rbegin(), points.rend());
  hull.pop_back();
  hull.insert(hull.end(), upper.begin(), upper.end() - 1);
  return hull;
}

bool insideHull(const std::vector<cv::Point2d>& hull, const cv::Point2d& point, double tolerance) {
  bool inside = hull.size() >= 3;
  for (std::size_t i = 0; i < hull.size(); ++i) {
    const cv::Point2d& a = hull[i];
    const cv::Point2d& b = hull[(i + 1) % hull.size()];
    if (distanceFromSegment(a, b, point) <= tolerance) return true;
    inside = inside && (b - a).cross(point - a) >= 0;
  }
  return inside;
}

}  // namespace cortshift_stereo
