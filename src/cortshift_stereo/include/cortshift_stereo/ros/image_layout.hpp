// What an image message says of its bytes, before anybody follows it.
#pragma once

#include <sensor_msgs/Image.h>

#include <opencv2/core.hpp>
#include <string>

namespace cortshift_stereo {

/// cv_bridge multiplies step and height in 32 bits: a message whose product wraps to the size of its data would be read
/// far beyond it.
/// @throws MessageError where rows of the pixels that the encoding names do not fit the data
void requireWhole(const sensor_msgs::Image& image);

/// Whether its values have 16 bits and their bytes are in the other order than this machine's, which cv_bridge cannot
/// read.
bool isSwapped(const sensor_msgs::Image& image);

/// The same picture in this machine's order of bytes. @throws MessageError where rows do not fit the data
sensor_msgs::Image withBytesSwapped(const sensor_msgs::Image& image);

/// How smooth an image of 16 bits is: the mean difference of neighbours (of one colour), over that of pixels half an
/// image apart. About 1: noise; far below: a picture. The scale of the values does not matter.
struct Roughness {
  double as_is = 0;    ///< of the values
  double swapped = 0;  ///< of the values with their two bytes exchanged
};

/// Both 0 for an image of one value, or of other than 16 bits. @param encoding of sensor_msgs, for Bayer patterns
Roughness roughnessOf(const cv::Mat& image, const std::string& encoding);

/// Values whose bytes are in the other order than they are read in look like noise, and are a picture when exchanged.
/// @param name  of the image, for the message. @throws MessageError
void requireByteOrder(const cv::Mat& image, const std::string& encoding, const std::string& name);

}  // namespace cortshift_stereo
