#include "calibration/outliers.hpp"

#include <algorithm>

namespace cortshift_stereo {

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return values.empty() ? 0.0 : *middle;
}

std::optional<std::size_t> findOutlier(const std::vector<double>& values, double floor, double times) {
  if (values.empty()) return std::nullopt;
  const auto worst = std::max_element(values.begin(), values.end());
  if (!(*worst > std::max(floor, times * median(values)))) return std::nullopt;
  return static_cast<std::size_t>(worst - values.begin());
}

}  // namespace cortshift_stereo
