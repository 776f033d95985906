// Static transforms from a file, for recordings that lack them.
#pragma once

#include <geometry_msgs/TransformStamped.h>

#include <stdexcept>
#include <string>
#include <vector>

namespace cortshift_stereo {

class StaticTransformsError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A YAML list of {parent, child, translation: [x, y, z] in metres, rotation: [x, y, z, w]}, each the pose of `child`
/// in `parent`. Stamps are zero.
/// @throws StaticTransformsError naming the file, the entry and what is wrong with it
std::vector<geometry_msgs::TransformStamped> readStaticTransforms(const std::string& path);

/// The same, as text that readStaticTransforms reads to the last bit.
std::string staticTransformsToYaml(const std::vector<geometry_msgs::TransformStamped>& transforms);

}  // namespace cortshift_stereo
