#include "cortshift_tracking/ros/bridge/bridge.hpp"

#include <tf2_eigen/tf2_eigen.h>

#include "cortshift_stereo/ros/static_transforms.hpp"
#include "cortshift_tracking/case/durable_file.hpp"
#include "cortshift_tracking/case/same_registration.hpp"
#include "cortshift_tracking/igtl/compose.hpp"
#include "cortshift_tracking/ros/bridge/igtl_conversion.hpp"
#include "cortshift_tracking/ros/run_folder.hpp"

namespace cortshift_tracking::igt {
namespace {

/// Of the last patient registration: a peer may have sent it once only. Another launch is of another patient, on the
/// same master too.
std::filesystem::path registrationFile(const std::string& launch) { return runPath("registration-" + launch); }

std::int64_t now() { return static_cast<std::int64_t>(ros::Time::now().toNSec()); }

}  // namespace

Bridge::Bridge(ros::NodeHandle& node, const BridgeParameters& parameters)
    : parameters_(parameters),
      space_(axesFromText(parameters.pmr_axes), axesFromText(parameters.link_axes)),
      board_(parameters.board, space_),
      worker_(node, endpoint_, parameters.stage_poll_period),
      sender_(node, parameters_, space_, endpoint_),
      endpoint_(parameters.endpoint, handlers()) {
  updater_.setHardwareID("OpenIGTLink");
  updater_.add("connections", this, &Bridge::diagnoseConnections);
  updater_.add("tools", this, &Bridge::diagnoseTools);
  timer_ = node.createTimer(ros::Duration(0.5), [this](const ros::TimerEvent&) { updater_.update(); });
  restoreRegistration();
  endpoint_.start();
  worker_.start();
  if (parameters_.endpoint.listen)
    ROS_INFO_STREAM("OpenIGTLink: listening on " << parameters_.endpoint.listen_address << ":" << endpoint_.port());
}

Bridge::~Bridge() { worker_.stop(); }

EndpointHandlers Bridge::handlers() {
  EndpointHandlers handlers;
  handlers.on_open = [this](PeerId peer, const std::string& address) {
    // Throttled like the end of a connection: no peer shall fill the disk with our log.
    ROS_INFO_STREAM_THROTTLE(1, "OpenIGTLink: connected to " << address);
    if (parameters_.request_tracking_ms > 0)
      endpoint_.send(peer, toPacket(composeStartTracking({"cortshift", now()}, parameters_.request_tracking_ms)));
  };
  handlers.on_message = [this](PeerId peer, const Message& message) { onMessage(peer, message); };
  handlers.on_close = [this](PeerId peer, const std::string& address, const std::string& reason) {
    ROS_WARN_STREAM_THROTTLE(1, "OpenIGTLink: connection to " << address << " ended: " << reason);
    const std::lock_guard<std::mutex> lock(board_mutex_);
    board_.peerLeft(peer);
  };
  handlers.on_failure = [](const std::string& what) { ROS_ERROR_STREAM_THROTTLE(5, "OpenIGTLink: " << what); };
  return handlers;
}

void Bridge::onMessage(PeerId peer, const Message& message) {
  if (message.type == "STRING") {
    const std::string text = decodeString(message);
    if (message.device == parameters_.command_device) worker_.request(peer, text, std::nullopt);
  } else if (message.type == "COMMAND") {
    const Command command = decodeCommand(message);
    worker_.request(peer, joinRequest(command.name, command.text), command);
  } else if (message.type == "GET_STATUS") {
    endpoint_.send(peer, toPacket(composeStatus({"cortshift", now()}, 1, "ready")));
  } else {
    std::vector<TrackedPose> poses;
    {
      const std::lock_guard<std::mutex> lock(board_mutex_);
      poses = board_.receive(peer, message, now());
    }
    for (const TrackedPose& pose : poses) publishPose(pose);
  }
}

void Bridge::publishPose(const TrackedPose& pose) {
  if (pose.parent != "pmr") {
    transforms_.sendTransform(transformFromPose(pose));
    return;
  }
  // A navigation system repeats its registration all the time; only another one is news.
  if (registration_) {
    if (sameRegistration(*registration_, pose.T_parent_child)) return;
    const Eigen::Isometry3d change = registration_->inverse() * pose.T_parent_child;
    ROS_WARN_STREAM("the patient registration changed by " << 1000 * change.translation().norm() << " mm and "
                                                           << Eigen::AngleAxisd(change.linear()).angle() * 180 / M_PI
                                                           << " deg");
  }
  registration_ = pose.T_parent_child;
  const geometry_msgs::TransformStamped message = transformFromPose(pose);
  keepRegistration(message);
  static_transforms_.sendTransform(message);
}

void Bridge::keepRegistration(const geometry_msgs::TransformStamped& registration) const {
  if (parameters_.launch.empty()) return;
  try {
    const std::filesystem::path path = registrationFile(parameters_.launch);
    std::filesystem::create_directories(path.parent_path());
    const std::string text = cortshift_stereo::staticTransformsToYaml({registration});
    replaceDurably(path, text.data(), text.size());
  } catch (const std::exception& error) {  // it holds all the same, as long as this node lives
    ROS_ERROR_STREAM("the patient registration is not kept should this node be started again: " << error.what());
  }
}

/// What this node had published before it died. A peer that says otherwise is heard as ever.
void Bridge::restoreRegistration() {
  if (parameters_.launch.empty()) return;
  try {
    const std::filesystem::path path = registrationFile(parameters_.launch);
    if (!std::filesystem::exists(path)) return;
    geometry_msgs::TransformStamped registration = cortshift_stereo::readStaticTransforms(path.string()).front();
    registration.header.stamp = ros::Time::now();
    registration_ = tf2::transformToEigen(registration);
    static_transforms_.sendTransform(registration);
    ROS_WARN("this node has been started again: the last patient registration holds until a peer sends another");
  } catch (const std::exception& error) {
    ROS_ERROR_STREAM("the last patient registration is not known: " << error.what());
  }
}

void Bridge::diagnoseConnections(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const EndpointState state = endpoint_.state();
  status.summaryf(diagnostic_msgs::DiagnosticStatus::OK, "%d connected", state.peers);
  for (const std::string& server : state.unreachable)
    status.mergeSummary(diagnostic_msgs::DiagnosticStatus::WARN, "no connection to " + server);
  if (state.failures > failures_told_) status.mergeSummary(diagnostic_msgs::DiagnosticStatus::WARN, state.last_failure);
  failures_told_ = state.failures;
  status.add("connected", state.peers);
  status.add("listening port", endpoint_.port());
  status.add("messages received", state.received);
  status.add("peers refused", state.refused);
  status.add("connections closed for malformed messages", state.malformed);
  status.add("failures of the bridge", state.failures);
}

void Bridge::diagnoseTools(diagnostic_updater::DiagnosticStatusWrapper& status) {
  std::vector<ToolReport> reports;
  {
    const std::lock_guard<std::mutex> lock(board_mutex_);
    reports = board_.report(now());
  }
  status.summary(diagnostic_msgs::DiagnosticStatus::OK, "all tools OK");
  for (const ToolReport& tool : reports) {
    if (tool.status != ToolStatus::kOk)
      status.mergeSummary(diagnostic_msgs::DiagnosticStatus::WARN,
                          tool.device + " " + toString(tool.status) + ": " + tool.reason);
    status.add(tool.device, toString(tool.status));
    status.add(tool.device + " accepted", tool.accepted);
    status.add(tool.device + " rejected", tool.rejected);
    status.add(tool.device + " repeated", tool.repeated);
    status.add(tool.device + " age [s]", tool.age);
    status.add(tool.device + " clock offset [s]", tool.clock_offset);
  }
}

}  // namespace cortshift_tracking::igt
