// A planar phantom that is computed in a moment, and whether two results have the same bits.
#pragma once

#include <cstring>
#include <opencv2/core.hpp>

#include "cortshift_flow_phantom/planar_phantom.hpp"

namespace cortshift_flow_test {

inline const cortshift_flow_phantom::PlanarPhantom& small() {
  static const cortshift_flow_phantom::PlanarPhantom phantom = [] {
    cortshift_flow_phantom::PlanarPhantomSettings settings;
    settings.size = {320, 256};
    settings.pixel_size = 0.0003;
    settings.quadrature = 2;
    return cortshift_flow_phantom::makePlanarPhantom(settings);
  }();
  return phantom;
}

inline bool sameBits(const cv::Mat& a, const cv::Mat& b) {
  if (a.size() != b.size() || a.type() != b.type()) return false;
  for (int y = 0; y < a.rows; ++y)
    if (std::memcmp(a.ptr(y), b.ptr(y), static_cast<std::size_t>(a.cols) * a.elemSize()) != 0) return false;
  return true;
}

}  // namespace cortshift_flow_test
