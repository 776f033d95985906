#include "cortshift_tracking/case/calibration_identity.hpp"

#include <cmath>
#include <cstdio>

#include "cortshift_stereo/provenance.hpp"
#include "cortshift_stereo/ros/pose_tree.hpp"

namespace cortshift_tracking {
namespace {

using cortshift_stereo::withoutSlash;

template <typename Numbers>
std::string exactly(const Numbers& numbers) {
  std::string text;
  for (const double number : numbers) {
    char digits[32];
    std::snprintf(digits, sizeof digits, "%.17g ", number);
    text += digits;
  }
  return text + "\n";
}

std::string textOf(const sensor_msgs::CameraInfo& info) {
  return std::to_string(info.width) + " x " + std::to_string(info.height) + " " + info.distortion_model + "\n" +
         exactly(info.D) + exactly(info.K) + exactly(info.R) + exactly(info.P);
}

std::string textOf(const geometry_msgs::Transform& edge) {
  // Numbers that were typed lie on the edge between two roundings more often than others; these edges lie elsewhere.
  constexpr double kStep = 1e-6, kBetween = 0.3137;
  const auto rounded = [](double value) { return std::to_string(std::llround(value / kStep + kBetween)) + " "; };
  const geometry_msgs::Quaternion& q = edge.rotation;
  const double sign = q.w < 0 ? -1 : 1;
  return rounded(edge.translation.x) + rounded(edge.translation.y) + rounded(edge.translation.z) + rounded(sign * q.x) +
         rounded(sign * q.y) + rounded(sign * q.z) + rounded(sign * q.w) + "\n";
}

}  // namespace

std::string calibrationOf(const StageRecord& record) {
  if (!record.left_info || !record.right_info) return "";
  std::string edges;
  for (const char* child : {"left_optical", "right_optical"})
    for (const geometry_msgs::TransformStamped& edge : record.tf_static.transforms)
      if (withoutSlash(edge.child_frame_id) == child)
        edges += withoutSlash(edge.header.frame_id) + " -> " + child + "\n" + textOf(edge.transform);
  if (edges.empty()) return "";
  return cortshift_stereo::sha256(textOf(*record.left_info) + textOf(*record.right_info) + edges);
}

std::string calibrationOf(const cortshift_msgs::StageInfo& from, const cortshift_msgs::StageInfo& to) {
  const std::string &first = from.provenance.calibration, &second = to.provenance.calibration;
  if (first.empty() || second.empty() || first == second) return first.empty() ? second : first;
  return first + "," + second;
}

bool sameCalibration(const cortshift_msgs::StageInfo& a, const cortshift_msgs::StageInfo& b) {
  const std::string &first = a.provenance.calibration, &second = b.provenance.calibration;
  return first.empty() || second.empty() || first == second;
}

}  // namespace cortshift_tracking
