#include <ros/ros.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include <cstdio>

#include "cortshift_stereo/ros/static_transforms.hpp"

namespace {

constexpr const char* kUsage =
    R"(Publish the static transforms of a YAML file, for bags that lack /tf_static.

    publish_static_tf [FILE]

Without FILE the private parameter `file` names it, as in launch files, whose arguments are split at blanks. FILE is a list; each entry says the pose of `child` in `parent`:

    - {parent: pmr, child: reference, translation: [x, y, z], rotation: [x, y, z, w]}

translation in metres, rotation a unit quaternion. An entry that is incomplete, not finite or not a rotation is
refused by name. Exit status: 0 done, 1 the file is wrong, 2 bad usage.
)";

}  // namespace

int main(int argc, char** argv) {
  bool launched = false;  // by roslaunch, which gives a name
  for (int i = 1; i < argc; ++i) launched = launched || std::string(argv[i]).rfind("__name:=", 0) == 0;
  std::vector<std::string> arguments;
  ros::removeROSArgs(argc, argv, arguments);
  arguments.erase(arguments.begin());
  if (arguments.size() == 1 && (arguments[0] == "-h" || arguments[0] == "--help")) {
    std::fputs(kUsage, stdout);
    return 0;
  }
  if (arguments.size() > 1 || (arguments.empty() && !launched) || (arguments.size() == 1 && arguments[0][0] == '-')) {
    std::fputs(kUsage, stderr);
    return 2;
  }
  try {
    std::vector<geometry_msgs::TransformStamped> transforms;
    if (!arguments.empty()) transforms = cortshift_stereo::readStaticTransforms(arguments[0]);
    ros::init(argc, argv, "publish_static_tf");
    ros::NodeHandle node("~");
    if (arguments.empty()) transforms = cortshift_stereo::readStaticTransforms(node.param<std::string>("file", ""));
    for (geometry_msgs::TransformStamped& transform : transforms) transform.header.stamp = ros::Time::now();
    tf2_ros::StaticTransformBroadcaster broadcaster;
    broadcaster.sendTransform(transforms);
    ros::spin();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "publish_static_tf: %s\n", error.what());
    return 1;
  }
  return 0;
}
