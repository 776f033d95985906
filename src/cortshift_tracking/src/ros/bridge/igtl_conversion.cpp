#include "cortshift_tracking/ros/bridge/igtl_conversion.hpp"

#include <cmath>
#include <cstring>
#include <iomanip>
#include <sstream>
#include <stdexcept>

#include "cortshift_tracking/ros/field_message.hpp"

namespace cortshift_tracking::igt {
namespace {

constexpr double kMmPerMetre = 1000.0;

/// Offset of a float32 field within a point; -1: the cloud does not have it.
int offsetOf(const sensor_msgs::PointCloud2& cloud, const std::string& name) {
  for (const sensor_msgs::PointField& field : cloud.fields) {
    if (field.name != name) continue;
    if (field.datatype != sensor_msgs::PointField::FLOAT32 || std::uint64_t{field.offset} + 4 > cloud.point_step)
      throw std::invalid_argument("field " + name + " of the cloud is not a float32 within the point");
    return static_cast<int>(field.offset);
  }
  return -1;
}

std::array<int, 3> offsetsOf(const sensor_msgs::PointCloud2& cloud, const std::array<const char*, 3>& names) {
  return {offsetOf(cloud, names[0]), offsetOf(cloud, names[1]), offsetOf(cloud, names[2])};
}

float floatAt(const std::uint8_t* point, int offset) {
  float value = 0;
  std::memcpy(&value, point + offset, sizeof value);
  return value;
}

Eigen::Vector3f vectorAt(const std::uint8_t* point, const std::array<int, 3>& offsets) {
  return {floatAt(point, offsets[0]), floatAt(point, offsets[1]), floatAt(point, offsets[2])};
}

/// Packed as 0x00rrggbb in the place of a float; read as an integer, for some colours are NaN as a float.
Eigen::Vector3f colourAt(const std::uint8_t* point, int offset) {
  std::uint32_t packed = 0;
  std::memcpy(&packed, point + offset, sizeof packed);
  return Eigen::Vector3f(static_cast<float>(packed >> 16 & 0xff), static_cast<float>(packed >> 8 & 0xff),
                         static_cast<float>(packed & 0xff)) /
         255.0F;
}

}  // namespace

PointGrid gridFromCloud(const sensor_msgs::PointCloud2& cloud) {
  if (cloud.header.frame_id != "pmr")
    throw std::invalid_argument("the cloud is in frame '" + cloud.header.frame_id + "', not in pmr");
  const auto position = offsetsOf(cloud, {"x", "y", "z"});
  const auto displacement = offsetsOf(cloud, {"dx", "dy", "dz"});
  const int confidence = offsetOf(cloud, "confidence"), colour = offsetOf(cloud, "rgb");
  if (position[0] < 0 || position[1] < 0 || position[2] < 0)
    throw std::invalid_argument("the cloud has no fields x, y, z");
  const bool moves = displacement[0] >= 0 && displacement[1] >= 0 && displacement[2] >= 0;
  const std::size_t row_bytes = static_cast<std::size_t>(cloud.width) * cloud.point_step;
  if (cloud.is_bigendian || cloud.row_step < row_bytes ||
      cloud.data.size() < static_cast<std::size_t>(cloud.height) * cloud.row_step)
    throw std::invalid_argument("the cloud's data are shorter than its size, or big-endian");

  PointGrid grid;
  grid.rows = static_cast<int>(cloud.height);
  grid.columns = static_cast<int>(cloud.width);
  const std::size_t size = static_cast<std::size_t>(cloud.height) * cloud.width;
  grid.points_pmr.reserve(size);
  for (std::uint32_t row = 0; row < cloud.height; ++row)
    for (std::uint32_t column = 0; column < cloud.width; ++column) {
      const std::uint8_t* point = cloud.data.data() + static_cast<std::size_t>(row) * cloud.row_step +
                                  static_cast<std::size_t>(column) * cloud.point_step;
      grid.points_pmr.push_back(vectorAt(point, position));
      if (moves) grid.displacements_pmr.push_back(vectorAt(point, displacement));
      if (confidence >= 0) grid.confidence.push_back(floatAt(point, confidence));
      if (colour >= 0) grid.colours_rgb.push_back(colourAt(point, colour));
    }
  return grid;
}

std::vector<std::uint8_t> textureOfGrid(const PointGrid& grid) {
  std::vector<std::uint8_t> pixels;
  pixels.reserve(3 * grid.points_pmr.size());
  for (std::size_t i = 0; i < grid.points_pmr.size(); ++i) {
    const bool shown = grid.points_pmr[i].allFinite() && !grid.colours_rgb.empty();
    for (int channel = 0; channel < 3; ++channel)
      pixels.push_back(shown ? static_cast<std::uint8_t>(std::lround(255 * grid.colours_rgb[i][channel])) : 0);
  }
  return pixels;
}

Eigen::Matrix4d textureMatrix(const cortshift_msgs::DisplacementField& field, const LinkSpace& space) {
  const auto& q = field.projection.orientation;
  const auto& p = field.projection.position;
  const Eigen::Quaterniond rotation(q.w, q.x, q.y, q.z);
  if (!(field.resolution > 0) || !(std::abs(rotation.norm() - 1) < 1e-3))
    throw std::invalid_argument("the field's resolution or projection is not set");
  Eigen::Isometry3d T_pmr_grid = Eigen::Translation3d(p.x, p.y, p.z) * rotation.normalized();
  Eigen::Matrix4d matrix_mm = space.poseToLink(T_pmr_grid, "pmr", "projection");
  matrix_mm.topLeftCorner<3, 2>() *= field.resolution * kMmPerMetre;
  return matrix_mm;
}

std::vector<float> voxelsOf(const cortshift_msgs::UpdatedMr& mr) {
  std::vector<float> voxels;
  if (mr.slices.empty()) throw std::invalid_argument("the updated MR has no slice");
  const sensor_msgs::Image& first = mr.slices.front();
  const std::size_t size = static_cast<std::size_t>(first.width) * first.height;
  voxels.reserve(size * mr.slices.size());
  for (const sensor_msgs::Image& slice : mr.slices) {
    if (slice.encoding != "32FC1" || slice.is_bigendian || slice.width != first.width || slice.height != first.height ||
        slice.step != slice.width * sizeof(float) || slice.data.size() != size * sizeof(float))
      throw std::invalid_argument("a slice of the updated MR is not whole, not of float32, or of another size");
    const std::size_t before = voxels.size();
    voxels.resize(before + size);
    std::memcpy(voxels.data() + before, slice.data.data(), size * sizeof(float));
  }
  return voxels;
}

Eigen::Matrix4d voxelMatrix(const cortshift_msgs::UpdatedMr& mr, const LinkSpace& space) {
  const Eigen::Matrix4d T_pmr_voxel =
      Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(mr.T_pmr_voxel.data());
  Eigen::Matrix4d matrix_mm = T_pmr_voxel;
  for (int column = 0; column < 4; ++column)
    matrix_mm.block<3, 1>(0, column) = space.vectorToLink(T_pmr_voxel.block<3, 1>(0, column));
  if (mr.header.frame_id != "pmr" || !matrix_mm.allFinite() || matrix_mm.row(3) != Eigen::RowVector4d(0, 0, 0, 1) ||
      !(std::abs(matrix_mm.topLeftCorner<3, 3>().determinant()) > 0))
    throw std::invalid_argument("the place of the updated MR's voxels in pmr is not known");
  return matrix_mm;
}

LinkMesh meshOfLabel(const cortshift_msgs::MovedLabel& label, const LinkSpace& space) {
  if (label.quads.empty() && label.border.data.empty())
    return {};  // taken out: an empty mesh takes the place of the last
  const PointGrid grid = gridFromCloud(label.border);
  if (grid.displacements_pmr.empty() || label.quads.size() % 4 != 0)
    throw std::invalid_argument("label '" + label.name + "' says no displacement, or corners that are no quads");
  LinkMesh mesh;
  for (std::size_t i = 0; i < grid.points_pmr.size(); ++i) {
    const Eigen::Vector3f& moved = grid.displacements_pmr[i];
    mesh.points_mm.push_back(space.vectorToLink((grid.points_pmr[i] + moved).cast<double>()).cast<float>());
    mesh.displacements_mm.push_back(space.vectorToLink(moved.cast<double>()).cast<float>());
    if (!mesh.points_mm.back().allFinite())
      throw std::invalid_argument("label '" + label.name + "' has a corner that is nowhere");
  }
  for (std::size_t i = 0; i < label.quads.size(); i += 4) {
    mesh.cells.push_back({label.quads[i], label.quads[i + 1], label.quads[i + 2], label.quads[i + 3]});
    for (const std::uint32_t corner : mesh.cells.back())
      if (corner >= mesh.points_mm.size())
        throw std::invalid_argument("label '" + label.name + "' has a quad at a corner that is not there");
  }
  return mesh;
}

std::string summaryText(const cortshift_msgs::ShiftSummary& message) {
  return message.from_key + " -> " + message.to_key + ": " + describe(summaryFromMessage(message));
}

std::vector<double> summaryValues(const cortshift_msgs::ShiftSummary& s) {
  return {static_cast<double>(s.valid_points),
          s.overlap,
          kMmPerMetre * s.magnitude_mean,
          kMmPerMetre * s.magnitude_sd,
          kMmPerMetre * s.gravity_mean,
          kMmPerMetre * s.gravity_sd,
          kMmPerMetre * s.normal_mean,
          kMmPerMetre * s.normal_sd,
          kMmPerMetre * s.lateral_mean,
          kMmPerMetre * s.lateral_sd,
          s.gravity_normal_angle,
          s.compute_time,
          kMmPerMetre * s.common_sd,
          static_cast<double>(s.brain_points),
          kMmPerMetre * s.brain_magnitude_mean,
          kMmPerMetre * s.brain_magnitude_sd,
          kMmPerMetre * s.brain_gravity_mean,
          kMmPerMetre * s.brain_gravity_sd,
          kMmPerMetre * s.brain_normal_mean,
          kMmPerMetre * s.brain_normal_sd,
          kMmPerMetre * s.brain_lateral_mean,
          kMmPerMetre * s.brain_lateral_sd};
}

std::string stageText(const cortshift_msgs::StageInfo& stage) {
  std::ostringstream text;
  text << stage.key << ": taken at " << std::fixed << std::setprecision(3) << stage.stamp.toSec() << " s, "
       << stage.valid_points << " points, coverage " << std::lround(100 * stage.coverage) << " %";
  if (!stage.note.empty()) text << ", " << stage.note;
  return text.str();
}

geometry_msgs::TransformStamped transformFromPose(const TrackedPose& pose) {
  geometry_msgs::TransformStamped message;
  message.header.stamp.fromNSec(static_cast<std::uint64_t>(pose.stamp_ns));
  message.header.frame_id = pose.parent;
  message.child_frame_id = pose.child;
  const Eigen::Vector3d t = pose.T_parent_child.translation();
  const Eigen::Quaterniond q = Eigen::Quaterniond(pose.T_parent_child.linear()).normalized();
  message.transform.translation.x = t.x();
  message.transform.translation.y = t.y();
  message.transform.translation.z = t.z();
  message.transform.rotation.x = q.x();
  message.transform.rotation.y = q.y();
  message.transform.rotation.z = q.z();
  message.transform.rotation.w = q.w();
  return message;
}

}  // namespace cortshift_tracking::igt
