#include "cortshift_tracking/offline/case_check.hpp"

#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>

#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_stereo/ros/shifted_time.hpp"

namespace cortshift_tracking {
namespace {

using cortshift_stereo::shifted;

constexpr double kSlice = 10;            // [s] of recording looked at in one go
constexpr double kNewStretch = 5;        // [s] without a usable pair that ends a stretch
constexpr double kSameRotation = 0.001;  // [rad] between tf's and camera_info's idea of the stereo head
constexpr double kSamePlace = 0.0005;    // [m] the same
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
  const double step = (stamp - edge->last).toSec();
  ++edge->samples;
  if (step < 0) ++edge->backwards;
  if (step > max_gap) ++edge->gaps;
  if (step > edge->longest) {
    edge->longest = step;
    edge->longest_at = (edge->last - begin).toSec();
  }
  edge->last = std::max(edge->last, stamp);
}

Eigen::Matrix3d eigen(const cv::Matx33d& R) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(R.val);
}

void checkTopics(const BagFile& bag, CaseCheck& out) {
  const auto need = [&](const std::string& topic, const std::string& why) {
    if (bag.messages(topic) == 0) out.missing.push_back(topic + ": none; " + why);
  };
  for (const char* side : kSides) {
    const std::string camera = std::string("/stereo/") + side;
    if (bag.messages(camera + "/image_raw") + bag.messages(camera + "/image_raw/compressed") == 0)
      out.missing.push_back(camera + "/image_raw (or .../compressed): none; there is nothing to reconstruct");
    need(camera + "/camera_info", "record it, or no pair can be rectified");
  }
  need("/tf", "record it, or the microscope's pose is not known");
  need("/tf_static", "give registration and calibration with --static-tf");
  if (bag.messages("/microscope/settings") == 0)
    out.warnings.push_back("/microscope/settings: none; every pair counts as taken at the reference setting");
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
    const Eigen::Isometry3d T_left_right = recording.posesAround(place.arrival, parameters.max_pose_gap)(
        parameters.camera_frame, "right_optical", place.stamp);
    // Rectification turns both cameras into one orientation; the right one then lies along x.
    const Eigen::Matrix3d R_left = eigen(left.R), R_right = eigen(model.right.R);
    const double angle =
        Eigen::AngleAxisd(Eigen::Matrix3d(R_left.transpose() * R_right).transpose() * T_left_right.linear()).angle();
    const Eigen::Vector3d offset = R_left * T_left_right.translation() - Eigen::Vector3d(model.baseline(), 0, 0);
    if (angle > kSameRotation || offset.norm() > kSamePlace)
      out.warnings.push_back(
          format("tf and camera_info differ about the stereo head by %.2f deg and %.2f mm: they are not "
                 "of one calibration",
                 angle * 180 / M_PI, 1e3 * offset.norm()));
    else
      out.calibration.push_back("tf and camera_info agree about the stereo head");
  } catch (const std::exception& error) {
    out.warnings.push_back(std::string("calibration: ") + error.what());
  }
}

}  // namespace

CaseCheck checkCase(const CaseRecording& recording, const cortshift_stereo::SurfaceReconstructionParameters& parameters,
                    const std::function<void(double)>& progress) {
  const BagFile& bag = recording.bag();
  CaseCheck out;
  checkTopics(bag, out);
  cortshift_stereo::PairReconstruction reconstruction(parameters);
  const auto troubleOf = [&](const PairPlace& place) -> std::string {
    try {
      reconstruction.check(recording.known(place));
      recording.posesAround(place.arrival, parameters.max_pose_gap)(parameters.map_frame, parameters.camera_frame,
                                                                    place.stamp);
      return "";
    } catch (const std::exception& error) {
      const auto drop = cortshift_stereo::dropReason(error);
      return drop.reason + ": " + drop.message;
    }
  };
  const double length = (bag.end() - bag.begin()).toSec();
  ros::Time from = shifted(bag.begin(), -1e-3);
  while (from < bag.end()) {
    const ros::Time to = std::min(shifted(from, kSlice), bag.end());
    const ros::Time next = from + ros::Duration(0, 1);  // slices do not share a message
    offsetsIn(bag, next, to, out.image_offsets);
    for (const BagEntry& entry : bag.entries({"/tf"}, next, to)) {
      const tf2_msgs::TFMessageConstPtr message = bag.read<tf2_msgs::TFMessage>(entry);
      for (const auto& sample : message->transforms) addSample(sample, bag.begin(), parameters.max_pose_gap, out.edges);
    }
    for (const PairPlace& place : recording.pairs(from, to)) {
      if (out.pairs.empty()) checkCalibration(recording, place, parameters, out);
      const double seconds = (place.arrival - bag.begin()).toSec();
      out.pairs.push_back({seconds, troubleOf(place)});
      if (!out.pairs.back().trouble.empty()) continue;
      if (out.capturable.empty() || seconds - out.capturable.back().last > kNewStretch)
        out.capturable.push_back({seconds, seconds, 0});
      out.capturable.back().last = seconds;
      ++out.capturable.back().pairs;
    }
    from = to;
    if (progress) progress(length > 0 ? std::min(1.0, (from - bag.begin()).toSec() / length) : 1.0);
  }
  if (out.pairs.empty()) out.missing.push_back("no two images have one stamp: there is no pair");
  return out;
}

}  // namespace cortshift_tracking
