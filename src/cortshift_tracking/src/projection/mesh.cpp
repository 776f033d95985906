#include "cortshift_tracking/projection/mesh.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace cortshift_tracking {

double medianSpacing(const cv::Mat& points) {
  constexpr int kSamples = 20000;  // enough for a median that is good to a percent
  const int step = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(points.total()) / kSamples)));
  std::vector<float> lengths;
  for (int row = 0; row < points.rows; row += step) {
    const auto* line = points.ptr<cv::Vec3f>(row);
    for (int column = 0; column + 1 < points.cols; column += step) {
      const cv::Vec3f edge = line[column + 1] - line[column];
      const float length = std::sqrt(edge.dot(edge));
      if (std::isfinite(length)) lengths.push_back(length);
    }
  }
  if (lengths.empty()) return 0;
  const auto middle = lengths.begin() + static_cast<std::ptrdiff_t>(lengths.size() / 2);
  std::nth_element(lengths.begin(), middle, lengths.end());
  return *middle;
}

}  // namespace cortshift_tracking
