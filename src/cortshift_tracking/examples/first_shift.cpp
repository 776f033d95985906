// From your own program: capture a stage now and tell how far the brain has moved since another.
//
//   first_shift FROM TO      FROM: key of an earlier stage; TO: key for the one that is captured now
#include <cortshift_msgs/CaptureStage.h>
#include <cortshift_msgs/ComputeShift.h>
#include <ros/ros.h>

#include <cstdio>
#include <string>

namespace {

/// A refusal says what is wrong and what to do; a call that fails says that nobody answers.
template <typename Service>
bool called(ros::ServiceClient client, Service& service) {
  if (!client.call(service)) {
    std::fprintf(stderr, "%s does not answer\n", client.getService().c_str());
    return false;
  }
  if (!service.response.success) std::fprintf(stderr, "refused: %s\n", service.response.message.c_str());
  return service.response.success;
}

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "first_shift", ros::init_options::AnonymousName);
  const bool help = argc == 2 && std::string(argv[1]) == "--help";
  if (argc != 3) {
    std::fputs("first_shift FROM TO\n", help ? stdout : stderr);
    return help ? 0 : 2;
  }
  ros::NodeHandle node;
  auto capturing = node.serviceClient<cortshift_msgs::CaptureStage>("shift_tracker/capture_stage");
  auto computing = node.serviceClient<cortshift_msgs::ComputeShift>("shift_tracker/compute_shift");
  capturing.waitForExistence(ros::Duration(30));

  cortshift_msgs::CaptureStage capture;
  capture.request.key = argv[2];
  capture.request.note = "first_shift.cpp";
  cortshift_msgs::ComputeShift compute;
  compute.request.from_key = argv[1];
  compute.request.to_key = argv[2];
  if (!called(capturing, capture) || !called(computing, compute)) return 1;

  const cortshift_msgs::ShiftSummary& summary = compute.response.summary;
  std::printf("%.2f mm over %.0f %%\n", 1000 * summary.magnitude_mean,
              100 * summary.overlap);  // messages are in metres
  for (const std::string& warning : summary.warnings) std::printf("warning: %s\n", warning.c_str());
  return 0;
}
