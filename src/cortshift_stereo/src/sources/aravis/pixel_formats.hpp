// Pixels as GenICam cameras send them.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace cortshift_stereo {

/// Names by GenICam's Pixel Format Naming Convention that toBgr understands.
const std::vector<std::string>& knownPixelFormats();

/// Bytes of one image without padding.
/// @throws std::invalid_argument for an unknown format
std::size_t bytesOfImage(const std::string& format, cv::Size size);

/// CV_8UC3 blue green red. Of formats with more than 8 bits the upper 8 remain.
/// @param data  bytesOfImage(format, size) bytes, little-endian
/// @throws std::invalid_argument for an unknown format
cv::Mat toBgr(const std::string& format, cv::Size size, const void* data);

}  // namespace cortshift_stereo
