#include "cortshift_stereo/triangulation.hpp"

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
      for (int x = 0; x < disparity.cols; ++x) {
        const double z = depthOfDisparity(model, d[x]);
        if (z > 0)  // not for NaN
          point[x] = R_raw_rectified * cv::Vec3d((x - P(0, 2)) / P(0, 0) * z, (y - P(1, 2)) / P(1, 1) * z, z);
        else
          point[x] = cv::Vec3f::all(std::numeric_limits<float>::quiet_NaN());
      }
    }
  });
  return points;
}

}  // namespace cortshift_stereo
