#include "cortshift_tracking/ros/bridge/graph_sender.hpp"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "cortshift_stereo/ros/image_layout.hpp"
#include "cortshift_tracking/case/stage_key.hpp"
#include "cortshift_tracking/igtl/compose.hpp"
#include "cortshift_tracking/ros/bridge/igtl_conversion.hpp"

namespace cortshift_tracking::igt {
namespace {

std::int64_t nanoseconds(const ros::Time& time) { return static_cast<std::int64_t>(time.toNSec()); }

/// One line about a field, for a header of at most 255 characters: what it was made with, and that there are warnings.
std::string titleOf(const cortshift_msgs::DisplacementField& field) {
  constexpr std::size_t kOfHash = 8, kOfSoftware = 24;
  std::string title = "displacement " + field.from_key + " to " + field.to_key;
  const auto add = [&](const std::string& before, const std::string& value, std::size_t most) {
    if (!value.empty()) title += before + value.substr(0, most);
  };
  add(" by ", field.provenance.software, kOfSoftware);
  add(" with parameters ", field.provenance.configuration, kOfHash);
  add(", calibration ", field.provenance.calibration, kOfHash);
  if (!field.summary.warnings.empty()) title += "; " + std::to_string(field.summary.warnings.size()) + " WARNINGS";
  return title;
}

}  // namespace

GraphSender::GraphSender(ros::NodeHandle& node, const BridgeParameters& parameters, const LinkSpace& space,
                         Endpoint& endpoint)
    : parameters_(parameters), space_(space), endpoint_(endpoint) {
  subscribers_ = {
      node.subscribe("shift/field", 4, &GraphSender::onField, this),
      node.subscribe("surface/points", 1, &GraphSender::onSurface, this),
      node.subscribe("brain_model/updated_mr", 1, &GraphSender::onUpdatedMr, this),
      subscribePicture(node, "brain_model/overlay", "BrainOverlayPict"),
      subscribePicture(node, "shift/overlay_before", "OverlayBeforePict"),
      subscribePicture(node, "shift/overlay_after", "OverlayAfterPict"),
      subscribePicture(node, "shift/magnitude", "MagnitudePict"),
  };
}

void GraphSender::onField(const cortshift_msgs::DisplacementField::ConstPtr& field) {
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

void GraphSender::writeField(const cortshift_msgs::DisplacementField& field, const PointGrid& grid) const {
  if (!isKey(field.from_key) || !isKey(field.to_key)) throw std::invalid_argument("its keys cannot name a file");
  writeVtk(parameters_.vtk_folder + "/" + field.from_key + "__" + field.to_key + ".vtk", titleOf(field),
           makeMesh(grid, 1, space_), space_.linkAxes());
}

void GraphSender::onUpdatedMr(const cortshift_msgs::UpdatedMr::ConstPtr& mr) {
  try {
    const std::int64_t stamp = nanoseconds(mr->header.stamp);
    std::map<std::string, LinkMesh> meshes;
    for (const cortshift_msgs::MovedLabel& label : mr->labels) {
      const std::string device = ("Now_" + label.name).substr(0, kDeviceSize);
      if (!meshes.emplace(device, meshOfLabel(label, space_)).second)
        throw std::invalid_argument("two labels would be sent as '" + device +
                                    "'; give prepare_model names that differ in 16 letters");
    }
    const std::vector<float> voxels = voxelsOf(*mr);
    const sensor_msgs::Image& first = mr->slices.front();
    const Voxels volume{static_cast<int>(first.width), static_cast<int>(first.height),
                        static_cast<int>(mr->slices.size()), voxels.data()};
    publish("UpdatedMr", composeVolume({"UpdatedMr", stamp}, volume, voxelMatrix(*mr, space_), space_.linkAxes()));
    for (const auto& [device, mesh] : meshes) publish(device, composePolyData({device, stamp}, mesh));
  } catch (const std::exception& error) {
    ROS_ERROR_STREAM("the MR updated by " << mr->from_key << " -> " << mr->to_key << " is not sent: " << error.what());
  }
}

void GraphSender::onSurface(const sensor_msgs::PointCloud2::ConstPtr& cloud) {
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

ros::Subscriber GraphSender::subscribePicture(ros::NodeHandle& node, const std::string& topic,
                                              const std::string& device) {
  return node.subscribe<sensor_msgs::Image>(
      topic, 2, [this, device](const sensor_msgs::Image::ConstPtr& image) { onPicture(device, image); });
}

void GraphSender::onPicture(const std::string& device, const sensor_msgs::Image::ConstPtr& image) {
  try {
    cortshift_stereo::requireWhole(*image);
    const bool grey = sensor_msgs::image_encodings::isMono(image->encoding);
    const cv::Mat pixels = cv_bridge::toCvShare(image, grey ? "mono8" : "rgb8")->image;
    const cv::Mat whole = pixels.isContinuous() ? pixels : pixels.clone();
    publish(device,
            composeImage({device, nanoseconds(image->header.stamp)}, {whole.rows, whole.cols, grey ? 1 : 3, whole.data},
                         Eigen::Matrix4d::Identity(), space_.linkAxes()));
  } catch (const std::exception& error) {
    ROS_ERROR_STREAM(device << " is not sent: " << error.what());
  }
}

void GraphSender::publish(const std::string& topic, Bytes bytes) {
  endpoint_.publish(topic, toPacket(std::move(bytes)), true);
}

}  // namespace cortshift_tracking::igt
