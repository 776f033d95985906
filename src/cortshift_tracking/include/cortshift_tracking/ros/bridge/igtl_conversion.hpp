// ROS messages to what the OpenIGTLink bridge sends.
#pragma once

#include <cortshift_msgs/DisplacementField.h>
#include <cortshift_msgs/MovedLabel.h>
#include <cortshift_msgs/ShiftSummary.h>
#include <cortshift_msgs/StageInfo.h>
#include <cortshift_msgs/UpdatedMr.h>
#include <geometry_msgs/TransformStamped.h>
#include <sensor_msgs/PointCloud2.h>

#include <string>
#include <vector>

#include "cortshift_tracking/igtl/mesh.hpp"
#include "cortshift_tracking/igtl/tool_board.hpp"

namespace cortshift_tracking::igt {

/// Organised cloud in pmr with float32 `x y z`, and where it has them `dx dy dz`, `confidence` and packed `rgb`.
/// @throws std::invalid_argument if a field is missing or not float32, the data are too short, or the frame is not pmr.
PointGrid gridFromCloud(const sensor_msgs::PointCloud2& cloud);

/// Colour of the earlier surface over the projection grid, red green blue, row by row; black where there is no vector.
std::vector<std::uint8_t> textureOfGrid(const PointGrid& grid);

/// Pose of that texture: (column, row, 0) to the link's space [mm].
/// @throws std::invalid_argument if resolution or orientation cannot be right.
Eigen::Matrix4d textureMatrix(const cortshift_msgs::DisplacementField& field, const LinkSpace& space);

/// Intensities of the updated MR; columns run fastest, then rows, then slices.
/// @throws std::invalid_argument if there is no slice, or they are not float32 of one size, whole and little-endian
std::vector<float> voxelsOf(const cortshift_msgs::UpdatedMr& mr);

/// (column, row, slice) of its voxels to the link's space [mm]. @throws std::invalid_argument if that is no space
Eigen::Matrix4d voxelMatrix(const cortshift_msgs::UpdatedMr& mr, const LinkSpace& space);

/// The structure where it is now; `displacements_mm` says from where. @throws std::invalid_argument naming what is
/// wrong
LinkMesh meshOfLabel(const cortshift_msgs::MovedLabel& label, const LinkSpace& space);

/// One line for people, lengths in mm.
std::string summaryText(const cortshift_msgs::ShiftSummary& summary);

/// For programs: valid_points, overlap, then mean and sd [mm] of magnitude, gravity, normal, lateral (NaN: not known),
/// gravity_normal_angle [rad], compute_time [s]: 12 numbers; then common_sd [mm], brain_points, and the four
/// means and sd [mm] of the brain alone: 10 more.
std::vector<double> summaryValues(const cortshift_msgs::ShiftSummary& summary);

/// "KEY stamp valid_points coverage" for people.
std::string stageText(const cortshift_msgs::StageInfo& stage);

geometry_msgs::TransformStamped transformFromPose(const TrackedPose& pose);

}  // namespace cortshift_tracking::igt
