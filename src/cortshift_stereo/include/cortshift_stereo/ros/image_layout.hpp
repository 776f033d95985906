// What an image message says of its bytes, before anybody follows it.
#pragma once

#include <sensor_msgs/Image.h>

namespace cortshift_stereo {

/// cv_bridge multiplies step and height in 32 bits: a message whose product wraps to the size of its data would be read
/// far beyond it.
/// @throws MessageError where rows of the pixels that the encoding names do not fit the data
void requireWhole(const sensor_msgs::Image& image);

}  // namespace cortshift_stereo
