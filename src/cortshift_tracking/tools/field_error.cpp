// Error of a recorded displacement field of the phantom against the truth.
#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <cstdio>
#include <cstring>
#include <exception>
#include <string>

#include "cortshift_tracking/ros/field_message.hpp"
#include "cortshift_tracking_phantom/field_truth.hpp"

namespace {

constexpr const char* kUsage =
    "usage: field_error --case CASE.yaml --from STAGE --to STAGE FIELD.bag\n"
    "Compares the DisplacementField on /shift/field of a bag with the truth of a phantom case whose stages those are.\n"
    "Prints, one `name: value` a line, median, 95th percentile and maximum of the 3D error inside the craniotomy [mm]\n"
    "and the covered part (0-1) of the brain that both cameras see at both stages.\n"
    "Exit status: 0 done, 1 failed, 2 bad usage.\n";

struct Arguments {
  std::string case_path, from, to, bag;
};

bool parse(int argc, char** argv, Arguments& out) {
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    std::string* value = name == "--case"   ? &out.case_path
                         : name == "--from" ? &out.from
                         : name == "--to"   ? &out.to
                                            : nullptr;
    if (value != nullptr) {
      if (++i == argc) return false;
      *value = argv[i];
    } else if (out.bag.empty() && name.compare(0, 1, "-") != 0) {
      out.bag = name;
    } else {
      return false;
    }
  }
  return !out.case_path.empty() && !out.from.empty() && !out.to.empty() && !out.bag.empty();
}

cortshift_tracking::DisplacementField readField(const std::string& path) {
  rosbag::Bag bag(path, rosbag::bagmode::Read);
  rosbag::View view(bag, rosbag::TopicQuery("/shift/field"));
  cortshift_msgs::DisplacementFieldConstPtr last;
  for (const rosbag::MessageInstance& instance : view) last = instance.instantiate<cortshift_msgs::DisplacementField>();
  if (!last) throw std::runtime_error(path + " holds no cortshift_msgs/DisplacementField on /shift/field");
  return cortshift_tracking::fieldFromMessage(*last);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && (std::strcmp(argv[1], "--help") == 0 || std::strcmp(argv[1], "-h") == 0)) {
    std::fputs(kUsage, stdout);
    return 0;
  }
  Arguments arguments;
  if (!parse(argc, argv, arguments)) {
    std::fputs(kUsage, stderr);
    return 2;
  }
  try {
    using namespace cortshift_stereo_phantom;
    const PhantomScene scene(loadPhantomCase(arguments.case_path));
    const auto error = cortshift_tracking_phantom::compareWithTruth(
        readField(arguments.bag), scene, scene.stageIndex(arguments.from), scene.stageIndex(arguments.to));
    std::fputs(toText(error).c_str(), stdout);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "field_error: %s\n", error.what());
    return 1;
  }
  return 0;
}
