#include "cortshift_stereo/ros/driver/phantom_rig.hpp"

#include <geometry_msgs/TransformStamped.h>

#include "cortshift_stereo/ros/conversions.hpp"
#include "sources/faulty_source.hpp"
#include "sources/phantom/phantom_source.hpp"
#include "sources/phantom/simulated_tracker.hpp"

namespace cortshift_stereo {
namespace {

constexpr double kSettling = 0.5;           // [s] a capture asks for poses at rest for some time before the exposure
constexpr double kDiagnosticsPeriod = 1.0;  // [s]

geometry_msgs::TransformStamped edge(const std::string& parent, const std::string& child, const Eigen::Isometry3d& T,
                                     const ros::Time& stamp) {
  geometry_msgs::TransformStamped message;
  message.header.frame_id = parent;
  message.header.stamp = stamp;
  message.child_frame_id = child;
  message.transform = toTransform(T);
  return message;
}

PhantomMotionSettings motionSettings(const StereoDriverParameters& parameters) {
  PhantomMotionSettings settings;
  settings.move_time = parameters.move_time;
  settings.probe_dwell = parameters.probe_dwell;
  settings.probe_travel = parameters.probe_travel;
  return settings;
}

TrackerSettings trackerSettings(const StereoDriverParameters& parameters) {
  TrackerSettings settings;
  settings.rate = parameters.tracker_rate;
  settings.latency = parameters.tracker_latency;
  settings.jitter = parameters.tracker_jitter;
  settings.jitter_angle = parameters.tracker_jitter_angle;
  settings.dropouts = parameters.tracker_dropouts;
  settings.dropout_length = parameters.tracker_dropout_length;
  settings.seed = parameters.tracker_seed;
  return settings;
}

/// Two samples on each side of an exposure, however the samples fall, and a dropout between them.
double stillMargin(const StereoDriverParameters& parameters) {
  return 2 / parameters.tracker_rate + (parameters.tracker_dropouts > 0 ? parameters.tracker_dropout_length : 0);
}

}  // namespace

PhantomRig::PhantomRig(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                       const StereoDriverParameters& parameters)
    : parameters_(parameters),
      private_node_(private_node),
      source_(std::make_shared<PhantomSource>(cortshift_stereo_phantom::loadPhantomCase(parameters.phantom_case),
                                              parameters.stage, motionSettings(parameters), stillMargin(parameters),
                                              rosNow)),
      tracker_(std::make_unique<SimulatedTracker>(trackerSettings(parameters))),
      updater_(node, private_node, private_node.getNamespace()) {
  sendStaticTransforms();
  if (!parameters_.fault_no_tracker)
    timer_ = node.createTimer(ros::Duration(1 / parameters_.tracker_rate), [this](const ros::TimerEvent&) { track(); });
  updater_.setHardwareID("phantom " + source_->scene().description().name);
  updater_.add("phantom", this, &PhantomRig::diagnose);
  diagnostics_timer_ = node.createWallTimer(ros::WallDuration(kDiagnosticsPeriod),
                                            [this](const ros::WallTimerEvent&) { updater_.force_update(); });
}

PhantomRig::~PhantomRig() = default;

std::shared_ptr<StereoSource> PhantomRig::source() const {
  const ImageFault fault = imageFaultFromName(parameters_.fault_images);
  if (fault == ImageFault::kNone) return source_;
  return std::make_shared<FaultySource>(source_, fault);
}

void PhantomRig::prepare() { source_->prepare(); }

void PhantomRig::offerStages() {
  set_stage_ = private_node_.advertiseService("set_stage", &PhantomRig::setStage, this);
}

std::optional<Eigen::Isometry3d> PhantomRig::T_reference_microscope(Stamp time) const {
  if (parameters_.fault_no_tracker) return std::nullopt;
  return source_->motion().T_reference_microscope(time);
}

void PhantomRig::sendStaticTransforms() {
  const auto& description = source_->scene().description();
  const auto& head = source_->scene().stereoHead();
  const ros::Time now = ros::Time::now();
  static_broadcaster_.sendTransform(
      {edge("pmr", "reference", description.T_pmr_reference, now),
       edge("microscope", "left_optical", description.T_microscope_head * head.T_head_left, now),
       edge("left_optical", "right_optical", head.T_left_right(), now)});
}

void PhantomRig::track() {
  // Poses are functions of time, so a late report is the pose of an earlier time.
  const Stamp taken = rosNow() - fromSeconds(parameters_.tracker_latency);
  const std::lock_guard<std::mutex> lock(status_mutex_);
  seen_ = tracker_->sees(taken);
  if (!seen_) {
    ++unseen_;
    return;
  }
  ++samples_;
  const PhantomMotion motion = source_->motion();
  const ros::Time stamp = toRosTime(taken);
  std::vector<geometry_msgs::TransformStamped> poses{
      edge("reference", "microscope", tracker_->measure(motion.T_reference_microscope(taken)), stamp)};
  if (const auto tip = motion.T_reference_probe_tip(taken))
    poses.push_back(edge("reference", "probe_tip", tracker_->measure(*tip, parameters_.probe_jitter), stamp));
  broadcaster_.sendTransform(poses);
}

bool PhantomRig::setStage(cortshift_msgs::SetPhantomStage::Request& request,
                          cortshift_msgs::SetPhantomStage::Response& response) {
  try {
    const Stamp ready = source_->setStage(request.stage);
    const Stamp reported = ready + fromSeconds(parameters_.tracker_latency + kSettling);
    ros::Time::sleepUntil(toRosTime(reported));
    private_node_.setParam("stage", request.stage);  // where this node goes on, should it be started again
    response.success = true;
    response.message = "the phantom is at stage " + request.stage;
    ROS_INFO_STREAM(response.message);
  } catch (const cortshift_stereo_phantom::PhantomCaseError& error) {
    response.success = false;
    response.message = error.what();
    ROS_WARN_STREAM("set_stage refused: " << error.what());
  }
  return true;
}

void PhantomRig::diagnose(diagnostic_updater::DiagnosticStatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const PhantomMotion motion = source_->motion();
  const Stamp now = rosNow();
  const std::lock_guard<std::mutex> lock(status_mutex_);
  if (parameters_.fault_no_tracker)
    status.summary(DiagnosticStatus::ERROR, "the tracker is off (fault_no_tracker)");
  else if (!seen_)
    status.summary(DiagnosticStatus::WARN, "the tracker does not see the tools");
  else
    status.summary(DiagnosticStatus::OK, motion.isStill(now, now) ? "standing" : "the microscope moves");
  status.add("stage", source_->stageName());
  status.add("tracker samples", samples_);
  status.add("tracker samples dropped", unseen_);
  status.add("probe target", motion.probeTarget(now));
}

}  // namespace cortshift_stereo
