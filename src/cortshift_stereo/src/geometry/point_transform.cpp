#include "cortshift_stereo/geometry/point_transform.hpp"

namespace cortshift_stereo {

cv::Mat transformPoints(const Eigen::Isometry3d& T_a_b, const cv::Mat& points_b) {
  CV_Assert(points_b.type() == CV_32FC3);
  cv::Mat points_a(points_b.size(), CV_32FC3);
  cv::parallel_for_(cv::Range(0, points_b.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      const auto* from = points_b.ptr<cv::Vec3f>(y);
      auto* to = points_a.ptr<cv::Vec3f>(y);
      for (int x = 0; x < points_b.cols; ++x) {
        const Eigen::Vector3f p = (T_a_b * Eigen::Vector3d(from[x][0], from[x][1], from[x][2])).cast<float>();
        to[x] = cv::Vec3f(p.x(), p.y(), p.z());
      }
    }
  });
  return points_a;
}

}  // namespace cortshift_stereo
