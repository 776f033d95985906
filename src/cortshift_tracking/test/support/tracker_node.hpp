// A shift_tracker from outside: synthetic surfaces in, services and topics out. What the tests of the node share.
#pragma once

#include <cortshift_msgs/CaptureStage.h>
#include <cortshift_msgs/ComputeShift.h>
#include <cortshift_msgs/DeleteStage.h>
#include <cortshift_msgs/DisplacementField.h>
#include <cortshift_msgs/ListStages.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>
#include <ros/ros.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "analytic_scene.hpp"
#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_tracking/ros/field_message.hpp"

namespace cortshift_tracking {

template <typename Message>
boost::shared_ptr<Message const> latched(const std::string& topic) {
  const auto message = ros::topic::waitForMessage<Message>(topic, ros::Duration(30));
  if (!message) throw std::runtime_error("nothing came on " + topic);
  return message;
}

class ShiftTrackerNode : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    scene = std::make_unique<AnalyticScene>(standardScene());
    camera = scene->cameraAt(0.3, 0, 0, 0, {360, 270}, 0.03);
    rest = scene->see(camera, AnalyticScene::atRest());
    sagged = scene->see(scene->cameraAt(0.305, 6 * M_PI / 180, 0.002, 12 * M_PI / 180, {360, 270}, 0.032), kSag);
    ros::NodeHandle node;
    surfaces = node.advertise<sensor_msgs::PointCloud2>("/surface/points", 2);
    diagnostics = node.advertise<diagnostic_msgs::DiagnosticArray>("/diagnostics", 2);
    tf = node.advertise<tf2_msgs::TFMessage>("/tf_static", 1, true);
    tf2_msgs::TFMessage message;
    geometry_msgs::TransformStamped edge;
    edge.header.frame_id = "pmr";
    edge.child_frame_id = "left_optical";
    edge.transform = cortshift_stereo::toTransform(camera.T_pmr_camera);
    message.transforms = {edge};
    tf.publish(message);
    ASSERT_TRUE(ros::service::waitForService("/shift_tracker/compute_shift", ros::Duration(30)));
    const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(20);
    while (surfaces.getNumSubscribers() == 0 || diagnostics.getNumSubscribers() == 0) {
      ASSERT_LT(ros::WallTime::now(), end);
      ros::WallDuration(0.01).sleep();
    }
  }

  static void TearDownTestSuite() {
    surfaces.shutdown();
    diagnostics.shutdown();
    tf.shutdown();
    std::string folder;
    if (ros::param::get("~case_folder", folder)) std::filesystem::remove_all(folder);
  }

  void SetUp() override {
    for (const auto& stage : list()) {
      cortshift_msgs::DeleteStage service;
      service.request.key = stage.key;
      ASSERT_TRUE(ros::service::call("/shift_tracker/delete_stage", service));
      ASSERT_TRUE(service.response.success) << service.response.message;
    }
  }

  /// Publishes and waits until the node says that it has it.
  static void publish(const sensor_msgs::PointCloud2& cloud) {
    surfaces.publish(cloud);
    ros::WallDuration(0.5).sleep();
  }

  static sensor_msgs::PointCloud2 cloudOf(const cortshift_stereo::Surface& surface, const ros::Time& stamp) {
    std_msgs::Header header;
    header.frame_id = "pmr";
    header.stamp = stamp;
    return cortshift_stereo::toPointCloud2(surface, header);
  }

  static cortshift_msgs::CaptureStage::Response capture(const std::string& key, const std::string& note = "") {
    cortshift_msgs::CaptureStage service;
    service.request.key = key;
    service.request.note = note;
    EXPECT_TRUE(ros::service::call("/shift_tracker/capture_stage", service));
    return service.response;
  }

  static cortshift_msgs::ComputeShift::Response compute(const std::string& from, const std::string& to) {
    cortshift_msgs::ComputeShift service;
    service.request.from_key = from;
    service.request.to_key = to;
    EXPECT_TRUE(ros::service::call("/shift_tracker/compute_shift", service));
    return service.response;
  }

  static std::vector<cortshift_msgs::StageInfo> list() {
    cortshift_msgs::ListStages service;
    EXPECT_TRUE(ros::service::call("/shift_tracker/list_stages", service));
    return service.response.stages;
  }

  static bool holds(const std::string& text, const std::string& part) {
    if (text.find(part) != std::string::npos) return true;
    ADD_FAILURE() << "'" << part << "' is not in: " << text;
    return false;
  }

  /// Checks a field from the scene at rest to the sagged one. Returns the true displacements of its points [m].
  static std::vector<Eigen::Vector3d> expectTheTruth(const DisplacementField& field, std::size_t points,
                                                     std::size_t fewest) {
    std::vector<Eigen::Vector3d> truths;
    std::vector<double> errors;
    for (int row = 0; row < field.frame.size.height; ++row)
      for (int column = 0; column < field.frame.size.width; ++column) {
        const cv::Vec3f p = field.start_pmr.at<cv::Vec3f>(row, column),
                        d = field.displacement_pmr.at<cv::Vec3f>(row, column);
        if (std::isnan(d[0])) continue;
        truths.push_back(scene->displacement_pmr({p[0], p[1], p[2]}, AnalyticScene::atRest(), kSag));
        errors.push_back((truths.back() - Eigen::Vector3d(d[0], d[1], d[2])).norm());
      }
    EXPECT_EQ(errors.size(), points);
    EXPECT_GT(errors.size(), fewest);
    if (errors.empty()) return truths;
    std::sort(errors.begin(), errors.end());
    EXPECT_LT(errors[errors.size() / 2], 0.00003);
    EXPECT_LT(errors[errors.size() * 95 / 100], 0.00015);
    return truths;
  }

  inline static const AnalyticScene::Deformation kSag = sagAndShift(0.005, 0.0015);
  inline static std::unique_ptr<AnalyticScene> scene;
  inline static PinholeCamera camera;
  inline static cortshift_stereo::Surface rest, sagged;
  inline static ros::Publisher surfaces, diagnostics, tf;
};

}  // namespace cortshift_tracking
