#include "cortshift_tracking/offline/case_recording.hpp"

#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "cortshift_stereo/admission/limits.hpp"
#include "cortshift_stereo/admission/pair_synchroniser.hpp"
#include "cortshift_stereo/admission/rig_evidence.hpp"
#include "cortshift_stereo/ros/shifted_time.hpp"
#include "cortshift_stereo/ros/stamped_history.hpp"
#include "cortshift_tracking/case/patient_registration.hpp"

namespace cortshift_tracking {
namespace {

using cortshift_stereo::CheckId;
using cortshift_stereo::ClockLimits;
using cortshift_stereo::Finding;
using cortshift_stereo::Findings;
using cortshift_stereo::PairMessages;
using cortshift_stereo::PoseError;
using cortshift_stereo::shifted;
using cortshift_stereo::Verdict;

const std::string kTf = "/tf", kStatic = "/tf_static", kSettings = "/microscope/settings";
const std::string kLeft = "/stereo/left/", kRight = "/stereo/right/", kInfo = "camera_info";
const std::vector<std::string> kImages = {"/stereo/left/image_raw", "/stereo/right/image_raw",
                                          "/stereo/left/image_raw/compressed", "/stereo/right/image_raw/compressed"};
using Synchroniser = cortshift_stereo::PairSynchroniser<BagEntry>;

constexpr double kHistory = 60;      // [s] as in the nodes
constexpr double kInfoReach = 1.0;   // [s] between an image's record and that of its camera_info
constexpr double kTwin = 1.0;        // [s] between the records of a raw image and of the same one compressed
constexpr double kWidePoses = 10.0;  // [s] on either side, to say what is missing

bool compressed(const std::string& topic) {
  return topic.size() > 11 && topic.substr(topic.size() - 11) == "/compressed";
}

}  // namespace

const std::vector<std::string>& CaseRecording::topics() {
  static const std::vector<std::string> all = [] {
    std::vector<std::string> names = kImages;
    names.insert(names.end(), {kLeft + kInfo, kRight + kInfo, kSettings, kTf, kStatic});
    return names;
  }();
  return all;
}

CaseRecording::CaseRecording(const std::string& path,
                             const cortshift_stereo::SurfaceReconstructionParameters& parameters,
                             const std::vector<geometry_msgs::TransformStamped>& static_tf)
    : parameters_(parameters), bag_(path, topics()), given_statics_(static_tf) {
  findRange();
  for (const BagEntry& entry : bag_.entries({kStatic}, ros::Time(), ros::TIME_MAX)) {
    const tf2_msgs::TFMessageConstPtr message = bag_.read<tf2_msgs::TFMessage>(entry);
    for (const geometry_msgs::TransformStamped& edge : message->transforms) {
      const auto earlier = std::find_if(statics_.rbegin(), statics_.rend(), [&](const Static& other) {
        return other.edge.child_frame_id == edge.child_frame_id;
      });
      if (earlier == statics_.rend() || earlier->edge.header.frame_id != edge.header.frame_id ||
          earlier->edge.transform != edge.transform)
        statics_.push_back({entry.time, edge});
    }
  }
  for (const auto& given : given_statics_)
    for (const Static& recorded : statics_)
      if (cortshift_stereo::withoutSlash(recorded.edge.child_frame_id) ==
          cortshift_stereo::withoutSlash(given.child_frame_id))
        throw TrackingError(
            "the pose of " + given.child_frame_id +
            " is in the file of static transforms and on /tf_static of the bag; remove it from the file");
}

void CaseRecording::findRange() {
  begin_ = bag_.begin();
  end_ = bag_.end();
  if (end_.toSec() - begin_.toSec() <= ClockLimits::kRecording) return;
  std::vector<BagEntry> entries = bag_.entries(topics(), ros::Time(), ros::TIME_MAX);
  if (entries.empty()) return;
  const double middle = entries[entries.size() / 2].time.toSec();  // they are in order of time
  std::size_t absurd = 0;
  std::optional<ros::Time> first, last;
  std::string which;
  for (const BagEntry& entry : entries) {
    if (std::abs(entry.time.toSec() - middle) <= ClockLimits::kRecording) {
      if (!first) first = entry.time;
      last = entry.time;
    } else if (++absurd == 1) {
      which = bag_.topicOf(entry) + " at " + std::to_string(entry.time.toSec()) + " s";
    }
  }
  begin_ = *first;
  end_ = *last;
  // Times are added to and subtracted from: beyond these bounds ros::Time and ros::Duration overflow.
  constexpr std::uint32_t kYear = 365 * 86400;
  if (end_.sec >= 0xffffffffu - kYear)
    throw TrackingError(bag_.path().string() + " is damaged: its messages' times go from " +
                        std::to_string(begin_.sec) + " s to " + std::to_string(end_.sec) + " s; " + kDamagedBagRemedy);
  remarks_.push_back(Finding{CheckId::kAbsurdStamp, Verdict::kWarn, "The recording",
                             "holds " +
                                 (absurd == 0 ? std::string("messages of other topics")
                                              : std::to_string(absurd) + " messages (the first: " + which + ")") +
                                 " with record times more than a day from all others; they do not count for its begin "
                                 "and end",
                             "set the recording machine's clock before it records"}
                         .sentence());
}

std::vector<PairPlace> CaseRecording::synchronise(const ros::Time& from, const ros::Time& to,
                                                  std::vector<std::string>* unpaired) const {
  Synchroniser synchroniser(std::llround(1e9 * parameters_.sync_tolerance), parameters_.pair_timeout);
  std::vector<PairPlace> found;
  const auto report = [&](double time) {
    for (const Synchroniser::Unpaired& image : synchroniser.takeUnpaired(time))
      if (unpaired) unpaired->push_back(image.message());
  };
  // A partner may have been recorded up to the synchroniser's patience earlier.
  for (const BagEntry& entry : bag_.entries(kImages, shifted(from, -2 * parameters_.pair_timeout), to)) {
    const auto side = bag_.topicOf(entry).compare(0, kLeft.size(), kLeft) == 0 ? Synchroniser::Side::kLeft
                                                                               : Synchroniser::Side::kRight;
    const double time = entry.time.toSec() - begin_.toSec();
    report(time);
    const auto pair = synchroniser.add(side, static_cast<int64_t>(bag_.stampOf(entry).toNSec()), entry, time);
    if (!pair || entry.time <= from) continue;
    found.push_back({ros::Time().fromNSec(static_cast<uint64_t>(pair->stamp_ns)), entry.time, pair->left, pair->right});
  }
  if (unpaired) report(to.toSec() - begin_.toSec() + 3 * parameters_.pair_timeout);
  return found;
}

std::vector<PairPlace> CaseRecording::pairs(const ros::Time& from, const ros::Time& to) const {
  return synchronise(from, to, nullptr);
}

std::vector<std::string> CaseRecording::unpaired(const ros::Time& from, const ros::Time& to) const {
  std::vector<std::string> reasons;
  synchronise(from, to, &reasons);
  return reasons;
}

std::string CaseRecording::notUnderstood() const {
  std::string others;
  for (const BagTopic& topic : bag_.topics()) {
    const bool image = topic.type.find("Image") != std::string::npos || topic.type.find("theora") != std::string::npos;
    if (image && std::find(kImages.begin(), kImages.end(), topic.name) == kImages.end())
      others += (others.empty() ? "" : ", ") + topic.name + " (" + topic.type + ")";
  }
  return others;
}

Findings CaseRecording::judgeClock(const PairPlace& pair) const {
  constexpr double kNear = 2;  // [s] on either side, to tell the period
  double period = std::numeric_limits<double>::infinity();
  for (const PairPlace& other : pairs(shifted(pair.arrival, -kNear), shifted(pair.arrival, kNear)))
    if (other.stamp != pair.stamp) period = std::min(period, std::abs(other.stamp.toSec() - pair.stamp.toSec()));
  if (!std::isfinite(period)) period = 0;
  Findings found = cortshift_stereo::checkLag("The stamp of the pair", pair.arrival.toSec() - pair.stamp.toSec(),
                                              std::max(period, ClockLimits::kTransport), "record time");
  constexpr double kBeside = 0.5;                   // [s]
  std::map<std::string, std::vector<double>> lags;  // of each edge: a publisher may have a clock of its own
  for (const BagEntry& entry : bag_.entries({kTf}, shifted(pair.arrival, -kBeside), shifted(pair.arrival, kBeside))) {
    const tf2_msgs::TFMessageConstPtr message = bag_.read<tf2_msgs::TFMessage>(entry);
    for (const auto& sample : message->transforms) {
      const std::string child = cortshift_stereo::withoutSlash(sample.child_frame_id);
      if (child == "reference" || child == "microscope" || child == parameters_.camera_frame)
        lags[child].push_back(entry.time.toSec() - sample.header.stamp.toSec());
    }
  }
  for (auto& [child, of_edge] : lags) {
    const auto middle = of_edge.begin() + static_cast<std::ptrdiff_t>(of_edge.size() / 2);
    std::nth_element(of_edge.begin(), middle, of_edge.end());
    found.add(cortshift_stereo::checkLag("The stamp of " + child + " on /tf", *middle, ClockLimits::kTransport,
                                         "record time"));
  }
  return found;
}

std::optional<PairPlace> CaseRecording::firstPair() const {
  constexpr int kSeconds = 60;
  for (int second = 0; second < kSeconds; ++second) {
    const auto found = pairs(shifted(begin_, second - (second == 0 ? 1e-3 : 0)), shifted(begin_, second + 1));
    if (!found.empty()) return found.front();
  }
  return std::nullopt;
}

PairMessages CaseRecording::read(const PairPlace& pair) const {
  const auto image = [&](const BagEntry& entry) {
    cortshift_stereo::ImageMessage out;
    if (compressed(bag_.topicOf(entry)))
      out.compressed = bag_.read<sensor_msgs::CompressedImage>(entry);
    else
      out.raw = bag_.read<sensor_msgs::Image>(entry);
    return out;
  };
  // Raw and compressed of one exposure are two sources of one image, whichever of them made the pair.
  const auto both = [&](const BagEntry& entry) {
    cortshift_stereo::ImageMessage out = image(entry);
    const std::string& own = bag_.topicOf(entry);
    const std::string twin = compressed(own) ? own.substr(0, own.rfind('/')) : own + "/compressed";
    if (bag_.messages(twin) == 0) return out;
    const ros::Time stamp = bag_.stampOf(entry);
    for (const BagEntry& other : bag_.entries({twin}, shifted(entry.time, -kTwin), shifted(entry.time, kTwin))) {
      if (bag_.stampOf(other) != stamp) continue;
      const cortshift_stereo::ImageMessage second = image(other);
      if (second.raw) out.raw = second.raw;
      if (second.compressed) out.compressed = second.compressed;
    }
    return out;
  };
  PairMessages out = known(pair);
  out.left = both(pair.left);
  out.right = both(pair.right);
  return out;
}

PairMessages CaseRecording::known(const PairPlace& pair) const {
  return {pair.stamp,
          {},
          {},
          infoOf(kLeft + kInfo, pair),
          infoOf(kRight + kInfo, pair),
          settingsOf(pair.stamp, pair.arrival)};
}

sensor_msgs::CameraInfoConstPtr CaseRecording::infoOf(const std::string& topic, const PairPlace& pair) const {
  std::vector<BagEntry> near =
      bag_.entries({topic}, shifted(pair.arrival, -kInfoReach), shifted(pair.arrival, kInfoReach));
  for (const BagEntry& entry : near)
    if (bag_.stampOf(entry) == pair.stamp) return bag_.read<sensor_msgs::CameraInfo>(entry);
  // None of this very exposure: the one in force, as in the node.
  const auto before = bag_.lastBefore(topic, shifted(pair.arrival, -kInfoReach));
  if (!before.empty() && (near.empty() || before.front() < near.front())) near.insert(near.begin(), before.front());
  if (near.empty()) near = bag_.entries({topic}, pair.arrival, shifted(pair.arrival, parameters_.calibration_timeout));
  cortshift_stereo::StampedHistory<sensor_msgs::CameraInfo> history;
  for (const BagEntry& entry : near) history.add(bag_.read<sensor_msgs::CameraInfo>(entry));
  return history.at(pair.stamp);
}

cortshift_msgs::MicroscopeSettingsConstPtr CaseRecording::settingsOf(const ros::Time& stamp,
                                                                     const ros::Time& arrival) const {
  constexpr std::size_t kChanges = 16;  // reported late or out of order
  std::vector<BagEntry> entries = bag_.lastBefore(kSettings, arrival, kChanges);
  std::sort(entries.begin(), entries.end());
  cortshift_stereo::StampedHistory<cortshift_msgs::MicroscopeSettings> history;
  for (const BagEntry& entry : entries) history.add(bag_.read<cortshift_msgs::MicroscopeSettings>(entry));
  return history.at(stamp);
}

ros::Time CaseRecording::calibratedSince(const std::string& topic, const sensor_msgs::CameraInfo& info,
                                         const ros::Time& arrival) const {
  constexpr std::size_t kBatch = 64;
  ros::Time since = arrival;
  for (ros::Time until = arrival;;) {
    const auto batch = bag_.lastBefore(topic, until, kBatch);
    for (const BagEntry& entry : batch) {
      if (!cortshift_stereo::sameCalibration(*bag_.read<sensor_msgs::CameraInfo>(entry), info)) return since;
      since = entry.time;
    }
    if (batch.size() < kBatch || batch.back().time == until || batch.back().time == ros::Time()) return since;
    until = batch.back().time - ros::Duration(0, 1);
  }
}

std::optional<cortshift_stereo::MicroscopeSetting> CaseRecording::referenceSetting(const PairMessages& pair) const {
  if (!pair.settings || !pair.left_info || !pair.right_info) return std::nullopt;
  const ros::Time arrival = end_;
  const auto first = firstPair();
  ros::Time seen = first ? first->arrival : begin_;
  ros::Time seen_stamp = first ? first->stamp : seen;
  const auto same = [&](const PairPlace& place) {
    const auto left = infoOf(kLeft + kInfo, place), right = infoOf(kRight + kInfo, place);
    return left && right && cortshift_stereo::sameCalibration(*left, *pair.left_info) &&
           cortshift_stereo::sameCalibration(*right, *pair.right_info);
  };
  if (!first || !same(*first)) {  // calibrated anew during the recording
    const ros::Time time = shifted(pair.stamp, kInfoReach) < arrival ? shifted(pair.stamp, kInfoReach) : arrival;
    seen = std::max(calibratedSince(kLeft + kInfo, *pair.left_info, time),
                    calibratedSince(kRight + kInfo, *pair.right_info, time));
    seen_stamp = seen;
  }
  const auto possible = [](const cortshift_msgs::MicroscopeSettingsConstPtr& settings) {
    std::optional<cortshift_stereo::MicroscopeSetting> setting;
    if (settings) setting = {settings->magnification, settings->focal_length};
    return setting && setting->possible() ? setting : std::nullopt;
  };
  auto reference = possible(settingsOf(seen_stamp, seen));
  // Else the first that came.
  for (ros::Time from = seen; !reference && from < arrival; from = shifted(from, 60))
    for (const BagEntry& entry : bag_.entries({kSettings}, from, shifted(from, 60)))
      if (!reference) reference = possible(bag_.read<cortshift_msgs::MicroscopeSettings>(entry));
  return reference;
}

cortshift_stereo::TransformTree CaseRecording::transforms(const ros::Time& from, const ros::Time& to,
                                                          const ros::Time& fixed_until, double max_pose_gap) const {
  cortshift_stereo::TransformTree tree(max_pose_gap, kHistory);
  tf2_msgs::TFMessage fixed;
  fixed.transforms = given_statics_;
  addTransforms(tree, fixed, true);
  for (const Static& recorded : statics_) {
    if (recorded.time > fixed_until) continue;
    fixed.transforms = {recorded.edge};
    addTransforms(tree, fixed, true, recorded.time);
  }
  for (const BagEntry& entry : bag_.entries({kTf}, from, to))
    addTransforms(tree, *bag_.read<tf2_msgs::TFMessage>(entry), false);
  return tree;
}

cortshift_stereo::PoseSource CaseRecording::posesAround(const ros::Time& arrival, double max_pose_gap) const {
  const double reach = max_pose_gap + parameters_.pose_timeout;
  const auto near = std::make_shared<const cortshift_stereo::TransformTree>(
      transforms(shifted(arrival, -reach), shifted(arrival, reach), shifted(arrival, reach), max_pose_gap));
  const auto wide = std::make_shared<std::optional<cortshift_stereo::TransformTree>>();
  const auto around = [=]() -> const cortshift_stereo::TransformTree& {
    if (!*wide)
      *wide = transforms(shifted(arrival, -kWidePoses), shifted(arrival, kWidePoses), shifted(arrival, kWidePoses),
                         max_pose_gap);
    return **wide;
  };
  const auto at = [=](const std::string& target, const std::string& source, const ros::Time& stamp) {
    try {
      return poseFrom(*near, target, source, stamp);
    } catch (const PoseError&) {
      if (reach >= kWidePoses) throw;
    }
    // Once more with more around it, to name the sample that is missing.
    return poseFrom(around(), target, source, stamp);
  };
  const auto judge = [=, limits = parameters_.poses](const std::string& target, const std::string& source,
                                                     const ros::Time& stamp) {
    return judgePoses(around(), target, source, stamp, limits);
  };
  const auto motion = [=](const std::string& target, const std::string& source, const ros::Time& stamp) {
    return poseMotion(around(), target, source, stamp);
  };
  return {at, judge, motion};
}

cortshift_stereo::PoseSource CaseRecording::posesWithin(const ros::Time& from, const ros::Time& to,
                                                        double max_pose_gap) const {
  const auto tree = std::make_shared<const cortshift_stereo::TransformTree>(
      transforms(shifted(from, -kWidePoses), shifted(to, kWidePoses), to, max_pose_gap));
  const auto at = [=](const std::string& target, const std::string& source, const ros::Time& stamp) {
    return poseFrom(*tree, target, source, stamp);
  };
  const auto judge = [=, limits = parameters_.poses](const std::string& target, const std::string& source,
                                                     const ros::Time& stamp) {
    return judgePoses(*tree, target, source, stamp, limits);
  };
  return {at, judge};
}

std::optional<ros::Time> CaseRecording::fixedEdgeChangesAfter(const ros::Time& time) const {
  for (const Static& recorded : statics_)
    if (recorded.time > time) return recorded.time;
  return std::nullopt;
}

std::optional<ros::Time> CaseRecording::registrationChanged(const ros::Time& time) const {
  RegistrationHistory history;
  for (const Static& recorded : statics_) {
    if (recorded.time > time) break;
    tf2_msgs::TFMessage message;
    message.transforms = {recorded.edge};
    history.add(message, recorded.time);
  }
  return history.changed();
}

}  // namespace cortshift_tracking
