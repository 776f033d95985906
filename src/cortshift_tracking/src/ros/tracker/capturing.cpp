#include "cortshift_tracking/ros/tracker/capturing.hpp"

#include <ros/ros.h>

#include <algorithm>
#include <boost/make_shared.hpp>

#include "cortshift_stereo/admission/rig_evidence.hpp"
#include "cortshift_stereo/admission/verdict.hpp"
#include "cortshift_tracking/case/stage_key.hpp"
#include "cortshift_tracking/case/stage_record.hpp"
#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {
namespace {

const char* const kTrigger = "stereo_driver/trigger";
const char* const kAverage = "surface_reconstruction/average_pairs";
const ros::WallDuration kPoseWait(0.5);  // for tracker samples that are still under way
constexpr unsigned int kMostPairs = 64;  // of a mean, see CaptureMeanStage.srv
constexpr double kGrace = 2.0;           // [s] for an answer that the reconstruction owes, on a busy machine

}  // namespace

Capturing::Capturing(const ShiftTrackerParameters& parameters, OpenCase& open, Placement& placement,
                     const SurfaceFeed& feed, const PairHistory& pairs, Activity& activity, ros::NodeHandle& data,
                     ros::NodeHandle& services)
    : timeout_(parameters.capture_timeout),
      max_surface_age_(parameters.max_surface_age),
      latency_sd_(parameters.shift.surround.pose_latency_sd),
      configuration_(
          [parameters](const std::string& of_reconstruction) { return parameters.configuration(of_reconstruction); }),
      case_(open),
      placement_(placement),
      feed_(feed),
      pairs_(pairs),
      activity_(activity),
      trigger_(data.serviceClient<cortshift_msgs::TriggerCapture>(kTrigger), "the driver",
               "check the cameras, and the network where the driver runs on another machine"),
      average_(data.serviceClient<cortshift_msgs::AveragePairs>(kAverage), "the reconstruction",
               "check that surface_reconstruction runs, or start it again"),
      capture_(services.advertiseService("capture_stage", &Capturing::onCapture, this)),
      capture_mean_(services.advertiseService("capture_mean_stage", &Capturing::onCaptureMean, this)) {}

bool Capturing::onCapture(cortshift_msgs::CaptureStage::Request& request,
                          cortshift_msgs::CaptureStage::Response& response) {
  capture(request.key, request.note, 1, response);
  return true;
}

bool Capturing::onCaptureMean(cortshift_msgs::CaptureMeanStage::Request& request,
                              cortshift_msgs::CaptureMeanStage::Response& response) {
  capture(request.key, request.note, request.pairs, response);
  return true;
}

template <typename Response>
void Capturing::capture(const std::string& key, const std::string& note, unsigned int pairs, Response& response) {
  try {
    StageRecord record;
    const std::string remarks = store(key, note, pairs, record);
    response.stage = record.info;
    response.success = true;
    response.message = "stage '" + key + "' is stored (" + std::to_string(record.info.valid_points) + " points, " +
                       std::to_string(static_cast<int>(100 * record.info.coverage)) + " % of the image)" + remarks;
    ROS_INFO_STREAM(response.message);
  } catch (const std::exception& error) {  // whatever a request does, the node goes on
    response.success = false;
    response.message = error.what();
    ROS_WARN_STREAM("capture refused: " << error.what());
    activity_.refused(error.what());
  }
}

std::string Capturing::store(const std::string& key, const std::string& note, unsigned int pairs, StageRecord& record) {
  case_.store.requireFree(key);  // before anything is fired
  const std::string refusal = "stage '" + key + "' was not captured: ";
  std::unique_lock<std::mutex> mine(under_way_, std::defer_lock);
  {
    const std::lock_guard<std::mutex> guard(key_mutex_);
    if (!mine.try_lock())
      throw TrackingError(refusal + "a capture of '" + key_under_way_ + "' is under way; try again when it is done");
    key_under_way_ = key;
  }
  std::string remarks;
  cortshift_msgs::SurfaceStatusConstPtr status;
  const ros::Time asked = ros::Time::now();
  try {
    record.surface = pairs == 1 ? awaitSurface() : awaitMean(pairs, remarks, status);
    record.info.stamp = record.surface->header.stamp;
    record.info.warnings = placement_.requireTrustworthy(record.info.stamp);
    if (pairs == 1 && !asked.isZero())
      cortshift_stereo::addWarnings(
          record.info.warnings,
          cortshift_stereo::checkWait(record.info.stamp.toSec() - asked.toSec(), max_surface_age_.toSec()).warnings());
  } catch (const TrackingError& error) {
    throw TrackingError(refusal + error.what());
  }
  record.info.key = key;
  record.info.note = note;
  pairs_.fill(record);
  if (pairs == 1) status = feed_.statusOf(record.info.stamp);
  if (status)
    cortshift_stereo::addWarnings(record.info.warnings, status->warnings);
  else
    record.info.warnings.push_back(cortshift_stereo::Finding{
        cortshift_stereo::CheckId::kStatus, cortshift_stereo::Verdict::kWarn, "The status of the surface",
        "was not heard on /surface/status, so that nothing is known of what speaks against it",
        "let surface_reconstruction make the surfaces"}
                                       .sentence());
  record.parameters = configuration_(status ? status->parameters : "");
  remarks += completeStage(record, placement_.poses.source(kPoseWait, placement_.limits), latency_sd_);
  record.info = case_.store.add(record);
  for (const std::string& warning : record.info.warnings) remarks += "; WARNING: " + warning;
  return remarks;
}

std::optional<ros::Time> Capturing::fire(Deadline deadline) {
  using Outcome = decltype(trigger_)::Call::Outcome;
  const auto call = trigger_.call({}, deadline);
  if (call->outcome == Outcome::kNobody) return std::nullopt;
  if (call->outcome == Outcome::kFailed)
    throw TrackingError("the call of " + ros::names::resolve(kTrigger) + " failed; check the driver");
  if (!call->response.success) throw TrackingError("the driver took no pair: " + call->response.message);
  return call->response.stamp;
}

sensor_msgs::PointCloud2ConstPtr Capturing::awaitSurface() {
  const Deadline deadline = deadlineAfter(timeout_);
  placement_.watch.requireSeen();
  const unsigned long seen = feed_.inbox().count();
  const std::optional<ros::Time> stamp = fire(deadline);
  if (stamp) {
    if (auto surface = feed_.waitSince(*stamp, seen, deadline)) return surface;
    throw TrackingError("within " + secondsText(timeout_) + " no surface of the pair at " +
                        std::to_string(stamp->toSec()) + " arrived on /surface/points" + feed_.whyNone());
  }
  if (auto surface = feed_.waitForRecent(max_surface_age_, deadline)) return surface;
  throw TrackingError("within " + secondsText(timeout_) + " no surface arrived on /surface/points that is at most " +
                      secondsText(max_surface_age_.toSec()) + " older than the request" + feed_.whyNone());
}

sensor_msgs::PointCloud2ConstPtr Capturing::awaitMean(unsigned int pairs, std::string& remarks,
                                                      cortshift_msgs::SurfaceStatusConstPtr& status) {
  using Outcome = decltype(average_)::Call::Outcome;
  // The reconstruction gathers while pairs are fired here, or come from a bag or a camera that runs free.
  cortshift_msgs::AveragePairs::Request request;
  request.pairs = pairs;
  request.since = ros::Time::now();
  request.patience = ros::Duration(timeout_);
  const auto call = average_.begin(request);
  // It gives up by itself when the next pair does not come within its patience. If no surface comes for longer than
  // that, or each of the pairs has had its time, it hangs.
  const Deadline latest = deadlineAfter(timeout_ * (std::min(pairs, kMostPairs) + 1) + kGrace);
  Deadline silent = deadlineAfter(timeout_ + kGrace), enough{};
  bool driver = true;
  ros::Time fired;
  unsigned long seen = 0, seen_when_fired = 0;
  while (!call->waitUntil(deadlineAfter(0.02))) {
    if (feed_.inbox().waitForNewer(seen, std::chrono::milliseconds(0))) silent = deadlineAfter(timeout_ + kGrace);
    if (!ros::ok()) throw TrackingError("the node shuts down");
    const Deadline now = std::chrono::steady_clock::now();
    if (now >= std::min(silent, latest)) throw TrackingError(average_.hangs() + feed_.whyNone());
    // One at a time, so that none overtakes another. A pair that gives no surface is replaced while patience lasts.
    if (!driver || (now < enough && !feed_.inbox().waitSince(fired, seen_when_fired, now))) continue;
    seen_when_fired = feed_.inbox().count();
    const auto stamp = fire(deadlineAfter(timeout_));
    driver = stamp.has_value();
    if (!driver) continue;
    fired = *stamp;
    enough = deadlineAfter(timeout_ / 4);
  }
  if (call->outcome == Outcome::kNobody)
    throw TrackingError("nobody offers " + ros::names::resolve(kAverage) + "; check that surface_reconstruction runs");
  if (call->outcome == Outcome::kFailed)
    throw TrackingError("the call of " + ros::names::resolve(kAverage) + " failed");
  if (!call->response.success) throw TrackingError(call->response.message);
  remarks = "; " + call->response.message;
  status = boost::make_shared<cortshift_msgs::SurfaceStatus>(call->response.status);
  return boost::make_shared<sensor_msgs::PointCloud2>(call->response.surface);
}

}  // namespace cortshift_tracking
