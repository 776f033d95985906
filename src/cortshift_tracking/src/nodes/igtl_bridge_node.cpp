// OpenIGTLink on one side, the graph on the other.
//
// Subscribes  /shift/field, /surface/points, /shift/overlay_before, /shift/overlay_after, /shift/magnitude
// Publishes   /tf (reference -> tools), /tf_static (pmr -> reference), /diagnostics
// Calls       /shift_tracker/capture_stage, /shift_tracker/compute_shift, /shift_tracker/list_stages
// To peers    POLYDATA ShiftField, Surface; IMAGE FieldTexture (in its place in the patient) and the pictures
//             OverlayBeforePict, OverlayAfterPict, MagnitudePict (for a 2D view: they have no place in the patient);
//             STRING ShiftSummary, Stages, StageEvent, CortshiftReply; NDARRAY ShiftSummaryValues
// From peers  TRANSFORM, TDATA, POSITION, STATUS of the configured tools; STRING (device `command_device`) and COMMAND:
//             capture_stage KEY [NOTE], compute_shift FROM TO; GET_STATUS
// Parameters  config/igtl_bridge.yaml names every one with its unit.
#include <cortshift_msgs/CaptureStage.h>
#include <cortshift_msgs/ComputeShift.h>
#include <cortshift_msgs/ListStages.h>
#include <cv_bridge/cv_bridge.h>
#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/ros.h>
#include <sensor_msgs/image_encodings.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_broadcaster.h>

#include <atomic>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>

#include "cortshift_stereo/ros/parameter_reader.hpp"
#include "cortshift_tracking/case/same_registration.hpp"
#include "cortshift_tracking/igtl/compose.hpp"
#include "cortshift_tracking/igtl/endpoint.hpp"
#include "cortshift_tracking/igtl/request.hpp"
#include "cortshift_tracking/igtl/tool_board.hpp"
#include "cortshift_tracking/ros/igtl_conversion.hpp"

namespace cortshift_tracking::igt {
namespace {

struct BridgeParameters {
  EndpointSettings endpoint;
  ToolBoardSettings board;
  std::string pmr_axes = "ras";
  std::string link_axes = "ras";
  double field_spacing = 0.0005;
  double surface_period = 1;
  int surface_step = 4;
  std::string vtk_folder;
  std::string command_device = "cortshift";
  double stage_poll_period = 1;
  int request_tracking_ms = 0;
};

ToolSettings toolFromYaml(XmlRpc::XmlRpcValue& entry) {
  const auto fail = [](const std::string& what) {
    throw cortshift_stereo::ParameterError(
        "tools: each entry is {device: TEXT, parent: TEXT, child: TEXT, latency: S}; " + what);
  };
  if (entry.getType() != XmlRpc::XmlRpcValue::TypeStruct) fail("this one is no such list of keys");
  ToolSettings tool;
  for (auto& [key, value] : entry) {
    if (key == "latency") {
      if (value.getType() != XmlRpc::XmlRpcValue::TypeDouble) fail("latency must be a number with a point, in seconds");
      tool.latency = static_cast<double>(value);
    } else if (key == "device" || key == "parent" || key == "child") {
      if (value.getType() != XmlRpc::XmlRpcValue::TypeString) fail(key + " must be a text");
      (key == "device" ? tool.device : key == "parent" ? tool.parent : tool.child) = static_cast<std::string>(value);
    } else {
      fail("key '" + key + "' is unknown");
    }
  }
  return tool;
}

BridgeParameters readParameters(const ros::NodeHandle& node) {
  BridgeParameters p;
  cortshift_stereo::ParameterReader reader(node);
  reader.flag("listen", p.endpoint.listen);
  reader.choice("listen_address", p.endpoint.listen_address);
  reader.number("listen_port", p.endpoint.listen_port, 0, 65535);
  reader.texts("allowed_peers", p.endpoint.allowed_peers);
  reader.texts("servers", p.endpoint.servers);
  reader.number("max_clients", p.endpoint.max_clients, 1, 100);
  reader.number("max_message_bytes", p.endpoint.max_message_bytes, 1024, 256 << 20);
  reader.number("message_timeout", p.endpoint.message_timeout, 0.1, 60.0);
  reader.number("send_timeout", p.endpoint.send_timeout, 0.1, 600.0);
  reader.number("reconnect_min", p.endpoint.reconnect_min, 0.05, 60.0);
  reader.number("reconnect_max", p.endpoint.reconnect_max, 0.05, 600.0);
  reader.choice("pmr_axes", p.pmr_axes, {"ras", "lps"});
  reader.choice("link_axes", p.link_axes, {"ras", "lps"});
  reader.number("stale_after", p.board.stale_after, 0.01, 10.0);
  reader.number("max_clock_offset", p.board.max_clock_offset, 0.001, 3600.0);
  reader.number("same_time", p.board.same_time, 0.0, 0.1);
  reader.number("field_spacing", p.field_spacing, 0.00005, 0.01);
  reader.number("surface_period", p.surface_period, 0.05, 3600.0);
  reader.number("surface_step", p.surface_step, 1, 100);
  reader.choice("vtk_folder", p.vtk_folder);
  reader.choice("command_device", p.command_device);
  reader.number("stage_poll_period", p.stage_poll_period, 0.1, 60.0);
  reader.number("request_tracking_ms", p.request_tracking_ms, 0, 1000);
  XmlRpc::XmlRpcValue tools;
  reader.structure("tools", tools);
  reader.finish();
  if (tools.valid()) {
    if (tools.getType() != XmlRpc::XmlRpcValue::TypeArray)
      throw cortshift_stereo::ParameterError("tools must be a list");
    for (int i = 0; i < tools.size(); ++i) p.board.tools.push_back(toolFromYaml(tools[i]));
  }
  p.endpoint.validate();
  p.board.validate();
  return p;
}

std::int64_t now() { return static_cast<std::int64_t>(ros::Time::now().toNSec()); }
std::int64_t nanoseconds(const ros::Time& time) { return static_cast<std::int64_t>(time.toNSec()); }
Packet packet(Bytes bytes) { return std::make_shared<const Bytes>(std::move(bytes)); }

/// A request waiting for the shift tracker, and the one who asked.
struct Job {
  PeerId peer = 0;
  Request request;
  std::optional<Command> command;  // it came as COMMAND
};

class Bridge {
 public:
  Bridge(ros::NodeHandle& node, const BridgeParameters& parameters)
      : parameters_(parameters),
        space_(axesFromText(parameters.pmr_axes), axesFromText(parameters.link_axes)),
        board_(parameters.board, space_),
        capture_(node.serviceClient<cortshift_msgs::CaptureStage>("/shift_tracker/capture_stage")),
        compute_(node.serviceClient<cortshift_msgs::ComputeShift>("/shift_tracker/compute_shift")),
        list_(node.serviceClient<cortshift_msgs::ListStages>("/shift_tracker/list_stages")),
        endpoint_(parameters.endpoint, handlers()) {
    subscribers_ = {
        node.subscribe("/shift/field", 4, &Bridge::onField, this),
        node.subscribe("/surface/points", 1, &Bridge::onSurface, this),
        subscribePicture(node, "/shift/overlay_before", "OverlayBeforePict"),
        subscribePicture(node, "/shift/overlay_after", "OverlayAfterPict"),
        subscribePicture(node, "/shift/magnitude", "MagnitudePict"),
    };
    updater_.setHardwareID("OpenIGTLink");
    updater_.add("connections", this, &Bridge::diagnoseConnections);
    updater_.add("tools", this, &Bridge::diagnoseTools);
    timer_ = node.createTimer(ros::Duration(0.5), [this](const ros::TimerEvent&) { updater_.update(); });
    endpoint_.start();
    worker_ = std::thread([this] { work(); });
    if (parameters_.endpoint.listen)
      ROS_INFO_STREAM("OpenIGTLink: listening on " << parameters_.endpoint.listen_address << ":" << endpoint_.port());
  }

  ~Bridge() {
    {
      const std::lock_guard<std::mutex> lock(jobs_mutex_);
      stop_ = true;
    }
    jobs_changed_.notify_all();
    worker_.join();
  }

 private:
  EndpointHandlers handlers() {
    EndpointHandlers handlers;
    handlers.on_open = [this](PeerId peer, const std::string& address) {
      // Throttled like the end of a connection: no peer shall fill the disk with our log.
      ROS_INFO_STREAM_THROTTLE(1, "OpenIGTLink: connected to " << address);
      if (parameters_.request_tracking_ms > 0)
        endpoint_.send(peer, packet(composeStartTracking({"cortshift", now()}, parameters_.request_tracking_ms)));
    };
    handlers.on_message = [this](PeerId peer, const Message& message) { onMessage(peer, message); };
    handlers.on_close = [this](PeerId peer, const std::string& address, const std::string& reason) {
      ROS_WARN_STREAM_THROTTLE(1, "OpenIGTLink: connection to " << address << " ended: " << reason);
      const std::lock_guard<std::mutex> lock(board_mutex_);
      board_.peerLeft(peer);
    };
    return handlers;
  }

  void onMessage(PeerId peer, const Message& message) {
    if (message.type == "STRING") {
      const std::string text = decodeString(message);
      if (message.device == parameters_.command_device) request(peer, text, std::nullopt);
    } else if (message.type == "COMMAND") {
      const Command command = decodeCommand(message);
      request(peer, joinRequest(command.name, command.text), command);
    } else if (message.type == "GET_STATUS") {
      endpoint_.send(peer, packet(composeStatus({"cortshift", now()}, 1, "ready")));
    } else {
      std::vector<TrackedPose> poses;
      {
        const std::lock_guard<std::mutex> lock(board_mutex_);
        poses = board_.receive(peer, message, now());
      }
      for (const TrackedPose& pose : poses) publishPose(pose);
    }
  }

  void publishPose(const TrackedPose& pose) {
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
    static_transforms_.sendTransform(transformFromPose(pose));
  }

  void request(PeerId peer, const std::string& text, const std::optional<Command>& command) {
    Job job{peer, {}, command};
    try {
      job.request = parseRequest(text);
    } catch (const std::invalid_argument& error) {
      return answer(job, false, error.what());
    }
    constexpr std::size_t kMaxJobs = 4;
    {
      const std::lock_guard<std::mutex> lock(jobs_mutex_);
      if (jobs_.size() < kMaxJobs) {
        jobs_.push_back(job);
        jobs_changed_.notify_all();
        return;
      }
    }
    answer(job, false, "busy: other requests are waiting; ask again later");
  }

  void answer(const Job& job, bool success, const std::string& text) {
    const Label label{"CortshiftReply", now()};
    if (job.command)
      endpoint_.send(job.peer, packet(composeCommandReply(label, *job.command, success, text)));
    else
      endpoint_.send(job.peer, packet(composeString(label, (success ? "OK " : "REFUSED ") + text)));
  }

  /// Own thread: services take their time, and neither the network nor the topics wait for them.
  void work() {
    auto next_poll = std::chrono::steady_clock::now();
    const auto period = std::chrono::duration_cast<std::chrono::steady_clock::duration>(
        std::chrono::duration<double>(parameters_.stage_poll_period));
    for (;;) {
      std::optional<Job> job;
      {
        std::unique_lock<std::mutex> lock(jobs_mutex_);
        jobs_changed_.wait_until(lock, next_poll, [this] { return stop_ || !jobs_.empty(); });
        if (stop_) return;
        if (!jobs_.empty()) {
          job = jobs_.front();
          jobs_.pop_front();
        }
      }
      if (job) serve(*job);
      pollStages();
      next_poll = std::chrono::steady_clock::now() + period;
    }
  }

  void serve(const Job& job) {
    if (job.request.kind == Request::Kind::kCaptureStage) {
      cortshift_msgs::CaptureStage call;
      call.request.key = job.request.key;
      call.request.note = job.request.note;
      const bool called = capture_.call(call);
      report(job, "capture_stage " + job.request.key, called, call.response.success, call.response.message);
    } else {
      cortshift_msgs::ComputeShift call;
      call.request.from_key = job.request.from_key;
      call.request.to_key = job.request.to_key;
      const bool called = compute_.call(call);
      report(job, "compute_shift " + job.request.from_key + " " + job.request.to_key, called, call.response.success,
             call.response.message);
    }
  }

  void report(const Job& job, const std::string& what, bool called, bool success, const std::string& message) {
    answer(job, called && success, what + ": " + (called ? message : "shift_tracker does not answer; is it running?"));
  }

  /// The contract has no topic of stages, so the list is asked for.
  void pollStages() {
    cortshift_msgs::ListStages call;
    if (!list_.exists() || !list_.call(call)) return;
    std::map<std::string, std::string> stages;
    std::string all;
    for (const cortshift_msgs::StageInfo& stage : call.response.stages) {
      stages[stage.key] = stageText(stage);
      all += stages[stage.key] + "\n";
    }
    if (stages_ == stages) return;
    endpoint_.publish("Stages", packet(composeString({"Stages", now()}, all)), true);
    if (stages_) {
      for (const auto& [key, text] : stages)
        if (stages_->count(key) == 0) publishEvent("captured " + text);
      for (const auto& [key, text] : *stages_)
        if (stages.count(key) == 0) publishEvent("deleted " + key);
    }
    stages_ = stages;
  }

  void publishEvent(const std::string& text) {
    endpoint_.publish("event" + std::to_string(++events_), packet(composeString({"StageEvent", now()}, text)), false);
  }

  void onField(const cortshift_msgs::DisplacementField::ConstPtr& field) {
    try {
      const PointGrid grid = gridFromCloud(field->points);
      const std::int64_t stamp = nanoseconds(field->header.stamp);
      const int step = std::max(1, static_cast<int>(std::lround(parameters_.field_spacing / field->resolution)));
      const Eigen::Matrix4d matrix_mm = textureMatrix(*field, space_);
      publish("ShiftField", composePolyData({"ShiftField", stamp}, makeMesh(grid, step, space_)));
      const std::vector<std::uint8_t> pixels = textureOfGrid(grid);
      publish("FieldTexture", composeImage({"FieldTexture", stamp}, {grid.rows, grid.columns, 3, pixels.data()},
                                           matrix_mm, space_.linkAxes()));
      publish("ShiftSummary", composeString({"ShiftSummary", stamp}, summaryText(field->summary)));
      publish("ShiftSummaryValues", composeArray({"ShiftSummaryValues", stamp}, summaryValues(field->summary)));
      if (!parameters_.vtk_folder.empty()) writeField(*field, grid);
    } catch (const std::exception& error) {
      ROS_ERROR_STREAM("the field " << field->from_key << " -> " << field->to_key << " is not sent: " << error.what());
    }
  }

  void writeField(const cortshift_msgs::DisplacementField& field, const PointGrid& grid) {
    if (!isKey(field.from_key) || !isKey(field.to_key)) throw std::invalid_argument("its keys cannot name a file");
    writeVtk(parameters_.vtk_folder + "/" + field.from_key + "__" + field.to_key + ".vtk",
             "displacement " + field.from_key + " to " + field.to_key, makeMesh(grid, 1, space_), space_.linkAxes());
  }

  void onSurface(const sensor_msgs::PointCloud2::ConstPtr& cloud) {
    const ros::WallTime time = ros::WallTime::now();
    if ((time - last_surface_).toSec() < parameters_.surface_period) return;
    last_surface_ = time;
    try {
      const LinkMesh mesh = makeMesh(gridFromCloud(*cloud), parameters_.surface_step, space_);
      publish("Surface", composePolyData({"Surface", nanoseconds(cloud->header.stamp)}, mesh));
    } catch (const std::exception& error) {
      ROS_ERROR_STREAM_THROTTLE(5, "the surface is not sent: " << error.what());
    }
  }

  ros::Subscriber subscribePicture(ros::NodeHandle& node, const std::string& topic, const std::string& device) {
    return node.subscribe<sensor_msgs::Image>(
        topic, 2, [this, device](const sensor_msgs::Image::ConstPtr& image) { onPicture(device, image); });
  }

  void onPicture(const std::string& device, const sensor_msgs::Image::ConstPtr& image) {
    try {
      const bool grey = sensor_msgs::image_encodings::isMono(image->encoding);
      const cv::Mat pixels = cv_bridge::toCvShare(image, grey ? "mono8" : "rgb8")->image;
      const cv::Mat whole = pixels.isContinuous() ? pixels : pixels.clone();
      publish(device, composeImage({device, nanoseconds(image->header.stamp)},
                                   {whole.rows, whole.cols, grey ? 1 : 3, whole.data}, Eigen::Matrix4d::Identity(),
                                   space_.linkAxes()));
    } catch (const std::exception& error) {
      ROS_ERROR_STREAM(device << " is not sent: " << error.what());
    }
  }

  void publish(const std::string& topic, Bytes bytes) { endpoint_.publish(topic, packet(std::move(bytes)), true); }

  void diagnoseConnections(diagnostic_updater::DiagnosticStatusWrapper& status) {
    const EndpointState state = endpoint_.state();
    status.summaryf(diagnostic_msgs::DiagnosticStatus::OK, "%d connected", state.peers);
    for (const std::string& server : state.unreachable)
      status.mergeSummary(diagnostic_msgs::DiagnosticStatus::WARN, "no connection to " + server);
    status.add("connected", state.peers);
    status.add("listening port", endpoint_.port());
    status.add("messages received", state.received);
    status.add("peers refused", state.refused);
    status.add("connections closed for malformed messages", state.malformed);
  }

  void diagnoseTools(diagnostic_updater::DiagnosticStatusWrapper& status) {
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

  BridgeParameters parameters_;
  LinkSpace space_;
  std::mutex board_mutex_;
  ToolBoard board_;
  std::optional<Eigen::Isometry3d> registration_;  // the endpoint's thread alone
  tf2_ros::TransformBroadcaster transforms_;
  tf2_ros::StaticTransformBroadcaster static_transforms_;
  ros::ServiceClient capture_, compute_, list_;
  std::optional<std::map<std::string, std::string>> stages_;  // the worker alone
  std::uint64_t events_ = 0;                                  // likewise
  std::mutex jobs_mutex_;
  std::condition_variable jobs_changed_;
  std::deque<Job> jobs_;
  bool stop_ = false;
  std::vector<ros::Subscriber> subscribers_;
  ros::WallTime last_surface_;
  diagnostic_updater::Updater updater_;
  ros::Timer timer_;
  std::thread worker_;
  Endpoint endpoint_;  // last: its thread uses all of the above
};

}  // namespace
}  // namespace cortshift_tracking::igt

int main(int argc, char** argv) {
  ros::init(argc, argv, "igtl_bridge");
  ros::NodeHandle node;  // outside: without a handle nothing is logged any more
  try {
    cortshift_tracking::igt::Bridge bridge(node, cortshift_tracking::igt::readParameters(ros::NodeHandle("~")));
    ros::spin();
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM("igtl_bridge cannot start: " << error.what());
    return 1;
  }
  return 0;
}
