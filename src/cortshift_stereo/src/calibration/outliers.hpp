// One rule for "this view does not belong to the others", wherever views are compared.
#pragma once

#include <optional>
#include <vector>

namespace cortshift_stereo {

double median(std::vector<double> values);

/// Index of the largest value if it is more than `times` the median and above a floor under which nothing is called an
/// outlier.
std::optional<std::size_t> findOutlier(const std::vector<double>& values, double floor, double times = 3);

}  // namespace cortshift_stereo
