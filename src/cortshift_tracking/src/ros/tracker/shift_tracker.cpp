#include "cortshift_tracking/ros/tracker/shift_tracker.hpp"

#include <cortshift_msgs/AveragePairs.h>
#include <cortshift_msgs/TriggerCapture.h>
#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/Image.h>

#include <boost/make_shared.hpp>
#include <chrono>
#include <cstdlib>
#include <functional>
#include <future>
#include <thread>

#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_tracking/case/stage_key.hpp"
#include "cortshift_tracking/case/stage_record.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/field/pictures.hpp"
#include "cortshift_tracking/ros/field_message.hpp"
#include "cortshift_tracking/ros/markers.hpp"
#include "cortshift_tracking/ros/mr_shift.hpp"
#include "cortshift_tracking/ros/tracker/health.hpp"

namespace cortshift_tracking {
namespace {

const char* const kTrigger = "/stereo_driver/trigger";
const char* const kAverage = "/surface_reconstruction/average_pairs";
const char* const kReconstructionStatus = "surface_reconstruction: surface";
const ros::WallDuration kPoseWait(0.5);  // for tracker samples that are still under way

std::string seconds(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f s", value);
  return text;
}

std::string caseFolder(const ShiftTrackerParameters& parameters) {
  if (!parameters.case_folder.empty()) return parameters.case_folder;
  // A restarted node finds its case again; another master starts another.
  std::string run;
  if (!ros::param::get("/run_id", run) || run.empty())
    throw TrackingError("case_folder is empty and the master has no /run_id; set case_folder");
  const char* ros_home = std::getenv("ROS_HOME");
  const char* home = std::getenv("HOME");
  if (ros_home == nullptr && home == nullptr)
    throw TrackingError("case_folder is empty and HOME not set; set case_folder");
  return (ros_home != nullptr ? std::string(ros_home) : std::string(home) + "/.ros") + "/cortshift/case-" + run;
}

SurfaceInbox::Deadline deadlineAfter(double seconds) {
  return std::chrono::steady_clock::now() +
         std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(seconds));
}

/// Fires the driver. A driver that hangs, or one behind a cable that is out, is left behind when the deadline passes.
/// @return stamp of the pair; nothing where there is no driver
std::optional<ros::Time> fireTrigger(ros::ServiceClient trigger, SurfaceInbox::Deadline deadline) {
  struct Call {
    cortshift_msgs::TriggerCapture service;
    bool exists = false;
    std::promise<bool> answered;
  };
  const auto call = std::make_shared<Call>();
  std::future<bool> answered = call->answered.get_future();
  std::thread([call, trigger]() mutable {
    call->exists = trigger.exists();
    call->answered.set_value(call->exists && trigger.call(call->service));
  }).detach();
  if (answered.wait_until(deadline) != std::future_status::ready)
    throw TrackingError(std::string("the driver did not answer ") + kTrigger +
                        "; check the cameras, and the network where the driver runs on another machine");
  const bool done = answered.get();
  if (!call->exists) return std::nullopt;
  if (!done) throw TrackingError(std::string("the call of ") + kTrigger + " failed; check the driver");
  if (!call->service.response.success)
    throw TrackingError("the driver took no pair: " + call->service.response.message);
  return call->service.response.stamp;
}

}  // namespace

struct ShiftTracker::Status {
  unsigned long surfaces = 0, malformed = 0, tracked = 0;
  std::string last_malformed;                           // reason
  std::string reconstruction, drop_reason, drop_stamp;  // what the reconstruction says
  std::string last_shift, last_refusal;
};

ShiftTracker::ShiftTracker(const ShiftTrackerParameters& parameters, const ros::NodeHandle& private_node)
    : parameters_(parameters),
      store_(caseFolder(parameters)),
      poses_(parameters.max_pose_gap),
      pose_watch_(poses_, parameters.max_speed),
      gravity_pmr_(parameters.gravity_pmr),
      status_(std::make_unique<Status>()),
      service_node_(private_node) {
  ROS_INFO_STREAM("case folder " << store_.folder() << ", " << store_.list().size()
                                 << " stages; to go on with this case later set case_folder to it");
  if (!parameters_.exclusions.empty()) regions_ = readRegions(parameters_.exclusions);
  data_node_.setCallbackQueue(&data_queue_);
  service_node_.setCallbackQueue(&service_queue_);
  pairs_ = std::make_unique<PairHistory>(data_node_);
  surfaces_ = data_node_.subscribe("/surface/points", 2, &ShiftTracker::onSurface, this);
  fixed_ = data_node_.subscribe<tf2_msgs::TFMessage>(
      "/tf_static", 100, [this](const tf2_msgs::TFMessageConstPtr& message) { registration_.add(*message); });
  diagnostics_in_ = data_node_.subscribe("/diagnostics", 20, &ShiftTracker::onDiagnostics, this);

  field_ = data_node_.advertise<cortshift_msgs::DisplacementField>("/shift/field", 1, true);
  points_ = data_node_.advertise<sensor_msgs::PointCloud2>("/shift/points", 1, true);
  markers_ = data_node_.advertise<visualization_msgs::MarkerArray>("/shift/markers", 1, true);
  overlay_before_ = data_node_.advertise<sensor_msgs::Image>("/shift/overlay_before", 1, true);
  overlay_after_ = data_node_.advertise<sensor_msgs::Image>("/shift/overlay_after", 1, true);
  magnitude_ = data_node_.advertise<sensor_msgs::Image>("/shift/magnitude", 1, true);
  gravity_ = data_node_.advertise<sensor_msgs::Image>("/shift/gravity", 1, true);
  normal_ = data_node_.advertise<sensor_msgs::Image>("/shift/normal", 1, true);
  lateral_ = data_node_.advertise<sensor_msgs::Image>("/shift/lateral", 1, true);
  if (parameters_.shift.with_own_points)
    own_points_ = data_node_.advertise<sensor_msgs::PointCloud2>("/shift/own_points", 1, true);
  diagnostics_ = data_node_.advertise<diagnostic_msgs::DiagnosticArray>("/diagnostics", 10);
  trigger_ = service_node_.serviceClient<cortshift_msgs::TriggerCapture>(kTrigger);
  average_ = service_node_.serviceClient<cortshift_msgs::AveragePairs>(kAverage);
  timer_ = data_node_.createWallTimer(ros::WallDuration(1.0), &ShiftTracker::onTimer, this);

  // Services last: a request finds everything in place. Data flow on threads of their own while a request waits.
  data_spinner_ = std::make_unique<ros::AsyncSpinner>(2, &data_queue_);
  data_spinner_->start();
  capture_ = service_node_.advertiseService("capture_stage", &ShiftTracker::onCapture, this);
  capture_mean_ = service_node_.advertiseService("capture_mean_stage", &ShiftTracker::onCaptureMean, this);
  list_ = service_node_.advertiseService("list_stages", &ShiftTracker::onList, this);
  delete_ = service_node_.advertiseService("delete_stage", &ShiftTracker::onDelete, this);
  compute_ = service_node_.advertiseService("compute_shift", &ShiftTracker::onCompute, this);
  compute_across_epochs_ =
      service_node_.advertiseService("compute_shift_across_epochs", &ShiftTracker::onComputeAcrossEpochs, this);
  set_gravity_ = service_node_.advertiseService("set_gravity", &ShiftTracker::onGravity, this);
  exclude_ = service_node_.advertiseService("exclude_regions", &ShiftTracker::onExclude, this);
  track_ = service_node_.advertiseService("track", &ShiftTracker::onTrack, this);
  service_spinner_ = std::make_unique<ros::AsyncSpinner>(3, &service_queue_);
  service_spinner_->start();
}

ShiftTracker::~ShiftTracker() {
  service_spinner_->stop();
  stopTracking();
  data_spinner_->stop();
}

bool ShiftTracker::onCapture(cortshift_msgs::CaptureStage::Request& request,
                             cortshift_msgs::CaptureStage::Response& response) {
  capture(request.key, request.note, 1, response);
  return true;
}

bool ShiftTracker::onCaptureMean(cortshift_msgs::CaptureMeanStage::Request& request,
                                 cortshift_msgs::CaptureMeanStage::Response& response) {
  capture(request.key, request.note, request.pairs, response);
  return true;
}

template <typename Response>
void ShiftTracker::capture(const std::string& key, const std::string& note, unsigned int pairs, Response& response) {
  try {
    store_.requireFree(key);  // before anything is fired
    const std::lock_guard<std::mutex> guard(capture_mutex_);
    std::string remarks;
    StageRecord record;
    record.surface = pairs == 1 ? awaitSurface(key) : awaitMean(key, pairs, remarks);
    record.info.key = key;
    record.info.note = note;
    record.info.stamp = record.surface->header.stamp;
    requireTrustworthyPose(key, record.info.stamp);
    pairs_->fill(record);
    remarks +=
        completeStage(record, [this](const std::string& target, const std::string& source, const ros::Time& stamp) {
          return poses_.lookup(target, source, stamp, kPoseWait);
        });
    response.stage = store_.add(record);
    response.success = true;
    response.message = "stage '" + key + "' is stored (" + std::to_string(record.info.valid_points) + " points, " +
                       std::to_string(static_cast<int>(100 * record.info.coverage)) + " % of the image)" + remarks;
    ROS_INFO_STREAM(response.message);
  } catch (const std::exception& error) {  // whatever a request does, the node goes on
    response.success = false;
    response.message = error.what();
    ROS_WARN_STREAM("capture refused: " << error.what());
    const std::lock_guard<std::mutex> guard(status_mutex_);
    status_->last_refusal = error.what();
  }
}

sensor_msgs::PointCloud2ConstPtr ShiftTracker::awaitMean(const std::string& key, unsigned int pairs,
                                                         std::string& remarks) {
  const std::string refusal = "stage '" + key + "' was not captured: ";
  if (!average_.exists())
    throw TrackingError(refusal + "nobody offers " + kAverage + "; check that surface_reconstruction runs");
  // The reconstruction gathers while pairs are fired here, or come from a bag or a camera that runs free.
  const auto call = std::make_shared<cortshift_msgs::AveragePairs>();
  call->request.pairs = pairs;
  call->request.since = ros::Time::now();
  call->request.patience = ros::Duration(parameters_.capture_timeout);
  ros::ServiceClient average = average_;
  std::future<bool> answered =
      std::async(std::launch::async, [call, average]() mutable { return average.call(*call); });
  const auto isAnswered = [&] { return answered.wait_for(std::chrono::milliseconds(20)) == std::future_status::ready; };
  while (!isAnswered()) {
    std::optional<ros::Time> stamp;
    try {
      stamp = fireTrigger(trigger_, deadlineAfter(parameters_.capture_timeout));
    } catch (const TrackingError& error) {
      throw TrackingError(refusal + error.what());
    }
    if (!stamp) break;
    // One at a time, so that none overtakes another. A pair that gives no surface is replaced while patience lasts.
    const SurfaceInbox::Deadline enough = deadlineAfter(parameters_.capture_timeout / 4);
    while (!isAnswered() && std::chrono::steady_clock::now() < enough &&
           !inbox_.waitSince(*stamp, deadlineAfter(0.05))) {
    }
  }
  if (!answered.get()) throw TrackingError(refusal + "the call of " + kAverage + " failed");
  if (!call->response.success) throw TrackingError(refusal + call->response.message);
  remarks = "; " + call->response.message;
  return boost::make_shared<sensor_msgs::PointCloud2>(std::move(call->response.surface));
}

sensor_msgs::PointCloud2ConstPtr ShiftTracker::awaitSurface(const std::string& key) {
  const SurfaceInbox::Deadline deadline = deadlineAfter(parameters_.capture_timeout);
  std::optional<ros::Time> stamp;
  try {
    pose_watch_.requireSeen();
    stamp = fireTrigger(trigger_, deadline);
  } catch (const TrackingError& error) {
    throw TrackingError("stage '" + key + "' was not captured: " + error.what());
  }
  if (stamp) {
    if (auto surface = inbox_.waitSince(*stamp, deadline)) return surface;
    throw TrackingError("stage '" + key + "' was not captured: within " + seconds(parameters_.capture_timeout) +
                        " no surface of the pair at " + std::to_string(stamp->toSec()) + " arrived on /surface/points" +
                        whyNoSurface());
  }
  if (auto surface = inbox_.waitForRecent(ros::Duration(parameters_.max_surface_age), deadline)) return surface;
  throw TrackingError("stage '" + key + "' was not captured: within " + seconds(parameters_.capture_timeout) +
                      " no surface arrived on /surface/points that is at most " + seconds(parameters_.max_surface_age) +
                      " older than the request" + whyNoSurface());
}

void ShiftTracker::requireTrustworthyPose(const std::string& key, const ros::Time& stamp) const {
  try {
    registration_.requireSettled(stamp);
    pose_watch_.requireStill(stamp);
  } catch (const TrackingError& error) {
    throw TrackingError("stage '" + key + "' was not captured: " + error.what());
  }
}

std::string ShiftTracker::whyNoSurface() const {
  const std::lock_guard<std::mutex> guard(status_mutex_);
  std::string why;
  const ros::Time newest = inbox_.newestStamp();
  why += newest.isZero() ? "; none has come since the node started"
                         : "; the newest is of " + std::to_string(newest.toSec());
  if (!status_->last_malformed.empty()) why += "; the last malformed one: " + status_->last_malformed;
  if (!status_->drop_reason.empty())
    why += "; the reconstruction last dropped a pair (" + status_->drop_stamp + "): " + status_->drop_reason;
  else if (!status_->reconstruction.empty())
    why += "; the reconstruction says: " + status_->reconstruction;
  else
    why += "; nothing is heard of the reconstruction: check that surface_reconstruction runs and images flow";
  return why;
}

bool ShiftTracker::onList(cortshift_msgs::ListStages::Request&, cortshift_msgs::ListStages::Response& response) {
  response.stages = store_.list();
  return true;
}

bool ShiftTracker::onDelete(cortshift_msgs::DeleteStage::Request& request,
                            cortshift_msgs::DeleteStage::Response& response) {
  try {
    const std::lock_guard<std::mutex> guard(compute_mutex_);
    store_.remove(request.key);
    regions_.erase(request.key);  // a later stage of this key is another one
    response.success = true;
    response.message = "stage '" + request.key + "' is deleted";
    ROS_INFO_STREAM(response.message);
  } catch (const std::exception& error) {
    response.success = false;
    response.message = error.what();
  }
  return true;
}

bool ShiftTracker::onCompute(cortshift_msgs::ComputeShift::Request& request,
                             cortshift_msgs::ComputeShift::Response& response) {
  return compute(request, response, false);
}

bool ShiftTracker::onComputeAcrossEpochs(cortshift_msgs::ComputeShift::Request& request,
                                         cortshift_msgs::ComputeShift::Response& response) {
  return compute(request, response, true);
}

bool ShiftTracker::compute(const cortshift_msgs::ComputeShift::Request& request,
                           cortshift_msgs::ComputeShift::Response& response, bool across_epochs) {
  try {
    const std::lock_guard<std::mutex> guard(compute_mutex_);
    const auto excluded = regions_.find(request.from_key);
    const StageShift shift =
        request.from_key == kMrKey
            ? computeMrShift(store_, request.to_key, first_normal_, gravity_pmr_, parameters_.shift, regions_,
                             across_epochs)
            : computeStageShift(store_, request.from_key, request.to_key, first_normal_, gravity_pmr_,
                                parameters_.shift,
                                excluded == regions_.end() ? std::vector<Region>() : excluded->second, across_epochs);
    publish(shift.result, shift.from, shift.to, false);
    response.success = true;
    response.summary = toMessage(shift.result.summary, request.from_key, request.to_key);
    response.message = "shift " + request.from_key + " to " + request.to_key + ": " + toText(shift.result.summary);
    ROS_INFO_STREAM(response.message);
    const std::lock_guard<std::mutex> status_guard(status_mutex_);
    status_->last_shift = response.message;
  } catch (const std::exception& error) {
    response.success = false;
    response.message = "no shift from '" + request.from_key + "' to '" + request.to_key + "': " + error.what();
    ROS_WARN_STREAM("compute_shift refused: " << response.message);
    const std::lock_guard<std::mutex> guard(status_mutex_);
    status_->last_refusal = response.message;
  }
  return true;
}

Directions ShiftTracker::directions() { return {first_normal_.of(store_), gravity_pmr_}; }

bool ShiftTracker::onGravity(cortshift_msgs::SetGravity::Request& request,
                             cortshift_msgs::SetGravity::Response& response) {
  const Eigen::Vector3d down(request.gravity.x, request.gravity.y, request.gravity.z);
  if (!down.allFinite() || !(down.norm() > 1e-6)) {
    response.success = false;
    response.message = "gravity is not a direction; give a finite vector in pmr that points down";
    return true;
  }
  const std::lock_guard<std::mutex> guard(compute_mutex_);
  gravity_pmr_ = down.normalized();
  response.success = true;
  response.message = "gravity is set; it counts from the next shift on";
  ROS_INFO_STREAM("gravity set to " << gravity_pmr_->transpose() << " in pmr");
  return true;
}

bool ShiftTracker::onExclude(cortshift_msgs::ExcludeRegions::Request& request,
                             cortshift_msgs::ExcludeRegions::Response& response) {
  try {
    store_.indexOf(request.key);
    std::vector<Region> regions;
    for (const geometry_msgs::Polygon& polygon : request.polygons) {
      Region region;
      for (const geometry_msgs::Point32& corner : polygon.points) region.emplace_back(corner.x, corner.y);
      regions.push_back(region);
    }
    excludedMask(ProjectionFrame(), regions);  // checks them
    const std::lock_guard<std::mutex> guard(compute_mutex_);
    regions_[request.key] = regions;
    response.success = true;
    response.message =
        std::to_string(regions.size()) + " regions are excluded from shifts that start at '" + request.key + "'";
  } catch (const std::exception& error) {
    response.success = false;
    response.message = error.what();
  }
  return true;
}

bool ShiftTracker::onTrack(cortshift_msgs::TrackShift::Request& request,
                           cortshift_msgs::TrackShift::Response& response) {
  try {
    const std::lock_guard<std::mutex> guard(track_mutex_);
    if (request.on) store_.indexOf(request.key);  // before anything is stopped
    stopTracking();
    if (request.on) {
      tracking_ = true;
      tracker_ = std::thread(&ShiftTracker::trackLoop, this, request.key);
    }
    response.success = true;
    response.message = request.on ? "tracking the shift from '" + request.key + "'" : "tracking is off";
  } catch (const std::exception& error) {
    response.success = false;
    response.message = error.what();
  }
  return true;
}

void ShiftTracker::stopTracking() {
  tracking_ = false;
  if (tracker_.joinable()) tracker_.join();
}

void ShiftTracker::trackLoop(const std::string& key) {
  ShiftSettings settings = parameters_.shift;
  settings.frame.resolution = parameters_.track_resolution;
  std::optional<Reference> reference;
  cortshift_msgs::StageInfo from;
  unsigned long seen = 0;
  cv::Mat prediction;  // from the field before
  while (tracking_) {
    try {
      if (!reference) {
        const StageRecord record = store_.load(key);
        from = record.info;
        const std::lock_guard<std::mutex> guard(compute_mutex_);
        reference =
            prepareReference(cortshift_stereo::surfaceFromPointCloud2(*record.surface), settings, regions_[key]);
      }
      const sensor_msgs::PointCloud2ConstPtr surface = inbox_.waitForNewer(seen, std::chrono::milliseconds(200));
      if (!surface) continue;
      cortshift_msgs::StageInfo to;  // a surface that is no stage has no key
      to.stamp = surface->header.stamp;
      if (!sameRegistration(from.registration, registration_.newest()))
        throw TrackingError("the patient registration has changed since this stage; track from one of the new epoch");
      const std::lock_guard<std::mutex> guard(compute_mutex_);
      const ShiftResult result = computeShift(*reference, cortshift_stereo::surfaceFromPointCloud2(*surface),
                                              directions(), settings, prediction);
      prediction = predictionOf(result.flow, result.field.confidence);
      publish(result, from, to, true);
      const std::lock_guard<std::mutex> status_guard(status_mutex_);
      ++status_->tracked;
      status_->last_shift = "live from " + key + ": " + toText(result.summary);
    } catch (const std::exception& error) {  // the next surface may be better
      prediction.release();
      ROS_WARN_STREAM_THROTTLE(2, "tracking from '" << key << "': " << error.what());
      {
        const std::lock_guard<std::mutex> guard(status_mutex_);
        status_->last_refusal = error.what();
      }
      if (!reference) std::this_thread::sleep_for(std::chrono::milliseconds(500));
    }
  }
}

void ShiftTracker::publish(const ShiftResult& result, const cortshift_msgs::StageInfo& from,
                           const cortshift_msgs::StageInfo& to, bool live) {
  const cortshift_msgs::DisplacementField field = toMessage(result.field, result.summary, from, to);
  points_.publish(field.points);
  markers_.publish(arrowsOf(result.field, field.header, parameters_.arrow_spacing));
  // A live field does not wait for pictures that nobody looks at.
  const auto wanted = [&](const ros::Publisher& publisher) { return !live || publisher.getNumSubscribers() > 0; };
  const auto picture = [&](const ros::Publisher& publisher, const std::function<cv::Mat()>& draw) {
    if (wanted(publisher)) publisher.publish(cv_bridge::CvImage(field.header, "bgr8", draw()).toImageMsg());
  };
  const Directions to_measure = directions();
  picture(overlay_before_, [&] { return overlayBefore(result); });
  picture(overlay_after_, [&] { return overlayAfter(result); });
  picture(magnitude_, [&] { return magnitudeMap(result.field); });
  if (to_measure.gravity_pmr) picture(gravity_, [&] { return gravityMap(result.field, *to_measure.gravity_pmr); });
  picture(normal_, [&] { return normalMap(result.field, to_measure.first_normal_pmr); });
  picture(lateral_, [&] { return lateralMap(result.field, to_measure.first_normal_pmr); });
  if (parameters_.shift.with_own_points && wanted(own_points_))
    own_points_.publish(ownPointsMessage(result, field.header));
  field_.publish(field);
}

void ShiftTracker::onSurface(const sensor_msgs::PointCloud2ConstPtr& surface) {
  std::string reason;
  try {
    if (cortshift_stereo::withoutSlash(surface->header.frame_id) != "pmr")
      throw TrackingError("its frame is '" + surface->header.frame_id + "', not pmr");
    cortshift_stereo::surfaceFromPointCloud2(*surface);
    inbox_.put(surface);
  } catch (const std::exception& error) {
    reason = error.what();
    ROS_ERROR_STREAM_THROTTLE(5, "a surface on /surface/points is not usable: " << reason);
  }
  const std::lock_guard<std::mutex> guard(status_mutex_);
  ++status_->surfaces;
  status_->last_malformed = reason;
  if (!reason.empty()) ++status_->malformed;
}

void ShiftTracker::onDiagnostics(const diagnostic_msgs::DiagnosticArrayConstPtr& message) {
  for (const diagnostic_msgs::DiagnosticStatus& status : message->status) {
    if (status.name != kReconstructionStatus) continue;
    const std::lock_guard<std::mutex> guard(status_mutex_);
    status_->reconstruction = status.message;
    for (const diagnostic_msgs::KeyValue& value : status.values) {
      if (value.key == "last_drop_reason") status_->drop_reason = value.value;
      if (value.key == "last_drop_stamp") status_->drop_stamp = value.value;
    }
  }
}

void ShiftTracker::onTimer(const ros::WallTimerEvent&) {
  diagnostic_msgs::DiagnosticArray message;
  message.header.stamp = ros::Time::now();
  message.status.resize(2);
  message.status.push_back(poseStatus(pose_watch_, parameters_.max_pose_gap, parameters_.max_speed));
  message.status.push_back(caseStatus(store_));
  diagnostic_msgs::DiagnosticStatus &stages = message.status[0], &surfaces = message.status[1];
  stages.name = "shift_tracker: stages";
  const std::vector<std::string>& aside = store_.setAside();
  stages.level = aside.empty() ? diagnostic_msgs::DiagnosticStatus::OK : diagnostic_msgs::DiagnosticStatus::WARN;
  stages.message = aside.empty() ? "ok" : std::to_string(aside.size()) + " files of the case folder are not stages";
  stages.values = {entry("case_folder", store_.folder().string()),
                   entry("stages", std::to_string(store_.list().size()))};
  for (const std::string& file : aside) stages.values.push_back(entry("set_aside", file));
  const std::lock_guard<std::mutex> guard(status_mutex_);
  stages.values.push_back(entry("last_shift", status_->last_shift));
  stages.values.push_back(entry("tracked_fields", std::to_string(status_->tracked)));
  stages.values.push_back(entry("last_refusal", status_->last_refusal));
  surfaces.name = "shift_tracker: surfaces";
  const bool bad = !status_->last_malformed.empty();
  surfaces.level = bad ? diagnostic_msgs::DiagnosticStatus::ERROR : diagnostic_msgs::DiagnosticStatus::OK;
  surfaces.message = bad ? "the last surface is not usable: " + status_->last_malformed : "ok";
  surfaces.values = {entry("received", std::to_string(status_->surfaces)),
                     entry("malformed", std::to_string(status_->malformed)),
                     entry("newest_stamp", std::to_string(inbox_.newestStamp().toSec()))};
  diagnostics_.publish(message);
}

}  // namespace cortshift_tracking
