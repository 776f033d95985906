#include "cortshift_tracking/offline/case_check.hpp"

#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>

#include "cortshift_stereo/admission/rig_evidence.hpp"
#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_stereo/ros/shifted_time.hpp"
#include "cortshift_tracking/case/calibration_identity.hpp"

namespace cortshift_tracking {
namespace {

using cortshift_stereo::shifted;

constexpr double kSlice = 10;      // [s] of recording looked at in one go
constexpr double kNewStretch = 5;  // [s] without a usable pair that ends a stretch
const char* const kSides[] = {"left", "right"};

std::string format(const char* pattern, double a, double b = 0, double c = 0) {
  char text[160];
  std::snprintf(text, sizeof text, pattern, a, b, c);
  return text;
}

/// Stamps of the two sides, to say how far apart the images of a pair are even where none is paired.
void offsetsIn(const BagFile& bag, const ros::Time& from, const ros::Time& to, std::vector<double>& out) {
  std::set<int64_t> stamps[2];
  for (int side = 0; side < 2; ++side) {
    const std::string topic = std::string("/stereo/") + kSides[side] + "/image_raw";
    for (const BagEntry& entry : bag.entries({topic, topic + "/compressed"}, from, to))
      stamps[side].insert(static_cast<int64_t>(bag.stampOf(entry).toNSec()));
  }
  for (const int64_t left : stamps[0]) {
    const auto after = stamps[1].lower_bound(left);
    if (stamps[1].empty()) return;
    int64_t nearest = after == stamps[1].end() ? *std::prev(after) : *after;
    if (after != stamps[1].begin() && after != stamps[1].end() && left - *std::prev(after) < *after - left)
      nearest = *std::prev(after);
    out.push_back(1e-9 * static_cast<double>(nearest - left));
  }
}

void addSample(const geometry_msgs::TransformStamped& sample, const ros::Time& begin, double max_gap,
               std::vector<EdgeCheck>& edges) {
  const std::string name = sample.header.frame_id + " -> " + sample.child_frame_id;
  const ros::Time stamp = sample.header.stamp;
  auto edge = std::find_if(edges.begin(), edges.end(), [&](const EdgeCheck& other) { return other.name == name; });
  if (edge == edges.end()) {
    edges.push_back({name, 1, 0, 0, stamp, stamp, 0, 0});
    return;
  }
  const double step = stamp.toSec() - edge->last.toSec();
  ++edge->samples;
  if (step < 0) ++edge->backwards;
  if (step > max_gap) ++edge->gaps;
  if (step > edge->longest) {
    edge->longest = step;
    edge->longest_at = edge->last.toSec() - begin.toSec();
  }
  edge->last = std::max(edge->last, stamp);
}

void checkTopics(const CaseRecording& recording, CaseCheck& out) {
  const BagFile& bag = recording.bag();
  const auto need = [&](const std::string& topic, const std::string& why) {
    if (bag.messages(topic) == 0) out.missing.push_back(topic + ": none; " + why);
  };
  for (const char* side : kSides) {
    const std::string camera = std::string("/stereo/") + side;
    if (bag.messages(camera + "/image_raw") + bag.messages(camera + "/image_raw/compressed") == 0)
      out.missing.push_back(camera + "/image_raw (or .../compressed): none; there is nothing to reconstruct");
    need(camera + "/camera_info", "record it, or no pair can be rectified");
  }
  const std::string others = recording.notUnderstood();
  if (!others.empty()) out.warnings.push_back("images on topics that are not understood: " + others);
  need("/tf", "record it, or the microscope's pose is not known");
  need("/tf_static", "give registration and calibration with --static-tf");
}

void checkCalibration(const CaseRecording& recording, const PairPlace& place,
                      const cortshift_stereo::SurfaceReconstructionParameters& parameters, CaseCheck& out) {
  const cortshift_stereo::PairMessages pair = recording.known(place);
  if (!pair.left_info || !pair.right_info) return;
  try {
    const auto model = cortshift_stereo::stereoModelFromInfo(*pair.left_info, *pair.right_info);
    const auto& left = model.left;
    out.calibration.push_back(
        std::to_string(left.size.width) + " x " + std::to_string(left.size.height) + " px" +
        format(", rectified focal length %.1f px, baseline %.2f mm", left.P(0, 0), 1e3 * model.baseline()));
    if (left.P(0, 2) < model.right.P(0, 2))
      out.calibration.push_back(
          format("the cameras' axes cross at %.0f mm", 1e3 * cortshift_stereo::depthOfDisparity(model, 0)));
    const Eigen::Isometry3d T_left_right = recording.posesAround(place.arrival, parameters.max_pose_gap)
                                               .at(parameters.camera_frame, parameters.right_camera_frame, place.stamp);
    if (cortshift_stereo::checkStereoEdge(model, T_left_right).all().empty())
      out.calibration.push_back("tf and camera_info agree about the stereo head");
  } catch (const std::exception& error) {
    out.warnings.push_back(std::string("calibration: ") + error.what());
  }
}

/// What several pairs have in common is said once.
class Tally {
 public:
  void add(const std::string& word, double seconds, const std::string& sentence) {
    Entry& entry = entries_[word];
    if (entry.pairs++ == 0) entry.first = std::to_string(seconds) + " s: " + sentence;
  }
  std::vector<std::string> lines() const {
    std::vector<std::string> lines;
    for (const auto& [word, entry] : entries_)
      lines.push_back(word + ": " + std::to_string(entry.pairs) + " pairs, the first at " + entry.first);
    return lines;
  }

 private:
  struct Entry {
    std::size_t pairs = 0;
    std::string first;
  };
  std::map<std::string, Entry> entries_;
};

/// Of what happens in every recording: a tracker that loses the tool, an image that lacks its partner. Every other
/// refusal says that something is set up wrongly.
bool isOrdinary(const std::string& word) {
  using cortshift_stereo::CheckId;
  return word == cortshift_stereo::checkOf(CheckId::kPose).word ||
         word == cortshift_stereo::checkOf(CheckId::kSettings).word;
}

/// The calibration that a stage of the pair would be known by.
std::string calibrationAt(const cortshift_stereo::PairMessages& pair, const cortshift_stereo::PoseAt& pose_at,
                          const cortshift_stereo::SurfaceReconstructionParameters& parameters) {
  StageRecord record;
  record.left_info = pair.left_info;
  record.right_info = pair.right_info;
  const auto add = [&](const std::string& parent, const std::string& child) {
    try {
      geometry_msgs::TransformStamped edge;
      edge.header.frame_id = parent;
      edge.child_frame_id = child;
      edge.transform = cortshift_stereo::toTransform(pose_at(parent, child, pair.stamp));
      record.tf_static.transforms.push_back(edge);
    } catch (const cortshift_stereo::PoseError&) {  // not in this tree
    }
  };
  add("microscope", parameters.camera_frame);
  add(parameters.camera_frame, parameters.right_camera_frame);
  return calibrationOf(record);
}

}  // namespace

CaseCheck checkCase(const CaseRecording& recording, const cortshift_stereo::SurfaceReconstructionParameters& parameters,
                    const std::function<void(double)>& progress) {
  const BagFile& bag = recording.bag();
  const ros::Time begin = recording.begin(), end = recording.end();
  CaseCheck out;
  out.warnings = recording.remarks();
  checkTopics(recording, out);
  cortshift_stereo::PairReconstruction reconstruction(parameters);
  const bool twins = bag.messages("/stereo/left/image_raw") * bag.messages("/stereo/left/image_raw/compressed") +
                         bag.messages("/stereo/right/image_raw") * bag.messages("/stereo/right/image_raw/compressed") >
                     0;
  Tally warned, contradicted;
  std::string calibration;
  const auto judge = [&](const PairPlace& place, double seconds, const cortshift_stereo::PoseSource& poses,
                         bool with_images) -> std::string {
    try {
      const cortshift_stereo::PairMessages pair = with_images ? recording.read(place) : recording.known(place);
      if (with_images) {
        requireOneContent(pair.left, "left");
        requireOneContent(pair.right, "right");
      }
      cortshift_stereo::Findings found = reconstruction.check(pair, poses);
      found.add(recording.judgeClock(place));
      for (const cortshift_stereo::Finding& finding : found.all())
        warned.add(cortshift_stereo::checkOf(finding.check).word, seconds, finding.sentence());
      const std::string own = calibrationAt(pair, poses.at, parameters);
      if (!calibration.empty() && !own.empty() && own != calibration)
        contradicted.add(
            cortshift_stereo::checkOf(cortshift_stereo::CheckId::kEpoch).word, seconds,
            "The calibration (camera_info, the hand-eye or the stereo edge) has changed: stages before and "
            "after it are of different epochs, between which no shift is computed.");
      if (!own.empty()) calibration = own;
      return "";
    } catch (const std::exception& error) {
      const auto drop = cortshift_stereo::dropReason(error);
      if (!isOrdinary(drop.reason)) contradicted.add(drop.reason, seconds, drop.message);
      return drop.reason + ": " + drop.message;
    }
  };
  const double length = end.toSec() - begin.toSec();
  ros::Time from = shifted(begin, -1e-3);
  while (from < end) {
    const ros::Time next = from + ros::Duration(0, 1);  // slices do not share a message
    ros::Time to = std::min(shifted(from, kSlice), end);
    if (const auto change = recording.fixedEdgeChangesAfter(next)) to = std::min(to, *change - ros::Duration(0, 1));
    offsetsIn(bag, next, to, out.image_offsets);
    for (const BagEntry& entry : bag.entries({"/tf"}, next, to)) {
      const tf2_msgs::TFMessageConstPtr message = bag.read<tf2_msgs::TFMessage>(entry);
      for (const auto& sample : message->transforms) addSample(sample, begin, parameters.max_pose_gap, out.edges);
    }
    const cortshift_stereo::PoseSource poses = recording.posesWithin(from, to, parameters.max_pose_gap);
    bool with_images = twins;  // of the first pair of each slice
    for (const PairPlace& place : recording.pairs(from, to)) {
      if (out.pairs.empty()) checkCalibration(recording, place, parameters, out);
      const double seconds = place.arrival.toSec() - begin.toSec();
      out.pairs.push_back({seconds, judge(place, seconds, poses, with_images)});
      with_images = false;
      if (!out.pairs.back().trouble.empty()) continue;
      if (out.capturable.empty() || seconds - out.capturable.back().last > kNewStretch)
        out.capturable.push_back({seconds, seconds, 0});
      out.capturable.back().last = seconds;
      ++out.capturable.back().pairs;
    }
    from = to;
    if (progress) progress(length > 0 ? std::min(1.0, (from.toSec() - begin.toSec()) / length) : 1.0);
  }
  if (out.pairs.empty()) {
    std::string why = "no two images have one stamp: there is no pair";
    const auto unpaired = recording.unpaired(shifted(begin, -1e-3), std::min(end, shifted(begin, kSlice)));
    if (!unpaired.empty()) why += ". " + unpaired.front();
    out.missing.push_back(why);
  }
  const auto append = [](std::vector<std::string>& to, const std::vector<std::string>& lines) {
    to.insert(to.end(), lines.begin(), lines.end());
  };
  append(out.warnings, warned.lines());
  append(out.contradictions, contradicted.lines());
  return out;
}

}  // namespace cortshift_tracking
