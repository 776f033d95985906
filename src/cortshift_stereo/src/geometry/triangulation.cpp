#include "cortshift_stereo/geometry/triangulation.hpp"

#include <limits>

namespace cortshift_stereo {

cv::Mat triangulate(const cv::Mat& disparity, const StereoModel& model) {
  CV_Assert(disparity.type() == CV_32FC1 && disparity.size() == model.left.size);
  const cv::Matx34d& P = model.left.P;
  const cv::Matx33d R_raw_rectified = model.left.R.t();
  cv::Mat points(disparity.size(), CV_32FC3);
  cv::parallel_for_(cv::Range(0, disparity.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      const float* d = disparity.ptr<float>(y);
      auto* point = points.ptr<cv::Vec3f>(y);
      // Along a row the point of depth 1 moves by the same step from pixel to pixel.
      const cv::Vec3d first = R_raw_rectified * cv::Vec3d(-P(0, 2) / P(0, 0), (y - P(1, 2)) / P(1, 1), 1);
      const cv::Vec3d along = R_raw_rectified * cv::Vec3d(1 / P(0, 0), 0, 0);
      for (int x = 0; x < disparity.cols; ++x) {
        const double depth = depthOfDisparity(model, d[x]);
        const double z = depth > 0 ? depth : std::numeric_limits<double>::quiet_NaN();  // for NaN too
        for (int i = 0; i < 3; ++i) point[x][i] = static_cast<float>(z * (first[i] + x * along[i]));
      }
    }
  });
  return points;
}

}  // namespace cortshift_stereo
