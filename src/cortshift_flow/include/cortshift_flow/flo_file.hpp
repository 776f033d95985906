// The Middlebury .flo format: "PIEH", int32 width, int32 height, then float32 (u, v) row by row, little endian.
#pragma once

#include <opencv2/core.hpp>
#include <string>

namespace cortshift_flow {

/// @param flow  CV_32FC2 [px]
/// @throws std::runtime_error naming the file when it cannot be written.
void writeFlo(const std::string& path, const cv::Mat& flow);

/// @return CV_32FC2 [px]
/// @throws std::runtime_error naming the file and what is wrong with it.
cv::Mat readFlo(const std::string& path);

}  // namespace cortshift_flow
