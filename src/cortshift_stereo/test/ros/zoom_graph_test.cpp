// The running graph under a zoom lens: surfaces at other settings than the calibrated one lie where the truth does, and
// a setting outside the calibrated range is refused by name; and means of several noisy pairs.
#include <cortshift_msgs/AveragePairs.h>
#include <cortshift_msgs/SetPhantomStage.h>
#include <cortshift_msgs/TriggerCapture.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>
#include <ros/ros.h>
#include <sensor_msgs/PointCloud2.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <future>
#include <map>
#include <mutex>
#include <string>

#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_stereo_phantom/phantom_renderer.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_stereo_phantom::Material;
using cortshift_stereo_phantom::PhantomScene;
using cortshift_stereo_phantom::Side;

const PhantomScene& scene() {
  static const PhantomScene value(
      cortshift_stereo_phantom::loadPhantomCase(CORTSHIFT_CONFIG_DIR "/phantom/phantom_zoom.yaml"));
  return value;
}

/// Mean |error| along the microscope's axis and across it [m] on the brain, and the share of it with a point.
struct Errors {
  double along = 0, across = 0, share = 0;
};

Errors errorsOf(const Surface& surface_pmr, int stage) {
  const auto view = scene().rectified(stage, Side::kLeft);
  const auto truth = truthOf(scene(), stage, view);
  const Eigen::Vector3d axis = scene().T_pmr_head(stage).linear().col(2);
  Errors errors;
  int points = 0, brain = 0;
  for (int y = 0; y < view.size.height; ++y)
    for (int x = 0; x < view.size.width; ++x) {
      if (truth.what.at<uint8_t>(y, x) != static_cast<uint8_t>(Material::kBrain)) continue;
      ++brain;
      const auto& p = surface_pmr.points.at<cv::Vec3f>(y, x);
      if (std::isnan(p[0])) continue;
      const cv::Vec3d& t = truth.points_pmr.at<cv::Vec3d>(y, x);
      const Eigen::Vector3d error(p[0] - t[0], p[1] - t[1], p[2] - t[2]);
      errors.along += std::abs(error.dot(axis));
      errors.across += (error - error.dot(axis) * axis).norm();
      ++points;
    }
  errors.along /= points;
  errors.across /= points;
  errors.share = static_cast<double>(points) / brain;
  return errors;
}

class Theatre {
 public:
  Theatre() {
    points_ = node_.subscribe<sensor_msgs::PointCloud2>("/surface/points", 10,
                                                        [this](const sensor_msgs::PointCloud2::ConstPtr& message) {
                                                          const std::lock_guard<std::mutex> lock(mutex_);
                                                          clouds_[message->header.stamp] = message;
                                                        });
    diagnostics_ = node_.subscribe<diagnostic_msgs::DiagnosticArray>(
        "/diagnostics", 100, [this](const diagnostic_msgs::DiagnosticArray::ConstPtr& message) {
          const std::lock_guard<std::mutex> lock(mutex_);
          for (const auto& status : message->status)
            if (status.name == "surface_reconstruction: surface")
              for (const auto& value : status.values) values_[value.key] = value.value;
        });
    EXPECT_TRUE(ros::service::waitForService("/stereo_driver/set_stage", ros::Duration(60)));
    EXPECT_TRUE(ros::service::waitForService("/surface_reconstruction/average_pairs", ros::Duration(60)));
    EXPECT_TRUE(eventually([&] { return points_.getNumPublishers() > 0 && diagnostics_.getNumPublishers() > 1; }));
    // The first pairs may find the nodes still connecting.
    EXPECT_TRUE(eventually([&] { return cloudAt(fire(), 2) != nullptr; }));
  }

  static bool eventually(const std::function<bool()>& condition, double seconds = 60) {
    const ros::WallTime give_up = ros::WallTime::now() + ros::WallDuration(seconds);
    while (!condition()) {
      if (ros::WallTime::now() > give_up) return false;
      ros::WallDuration(0.02).sleep();
    }
    return true;
  }

  void goTo(const std::string& stage) {
    cortshift_msgs::SetPhantomStage service;
    service.request.stage = stage;
    ASSERT_TRUE(ros::service::call("/stereo_driver/set_stage", service));
    ASSERT_TRUE(service.response.success) << service.response.message;
  }
  ros::Time fire() {
    cortshift_msgs::TriggerCapture service;
    EXPECT_TRUE(ros::service::call("/stereo_driver/trigger", service));
    EXPECT_TRUE(service.response.success) << service.response.message;
    return service.response.stamp;
  }
  sensor_msgs::PointCloud2::ConstPtr cloudAt(const ros::Time& stamp, double seconds = 60) {
    eventually([&] { return cloud(stamp) != nullptr; }, seconds);
    return cloud(stamp);
  }
  std::string value(const std::string& key) {
    const std::lock_guard<std::mutex> lock(mutex_);
    return values_[key];
  }

 private:
  sensor_msgs::PointCloud2::ConstPtr cloud(const ros::Time& stamp) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = clouds_.find(stamp);
    return found == clouds_.end() ? nullptr : found->second;
  }

  ros::NodeHandle node_;
  std::mutex mutex_;
  std::map<ros::Time, sensor_msgs::PointCloud2::ConstPtr> clouds_;
  std::map<std::string, std::string> values_;
  ros::Subscriber points_, diagnostics_;
};

Theatre& theatre() {
  static Theatre value;
  return value;
}

TEST(ZoomGraph, surfacesAtOtherSettingsLieWhereTheTruthDoes) {
  for (const char* const stage : {"reference", "zoomed_in", "zoomed_out", "near"}) {
    SCOPED_TRACE(stage);
    theatre().goTo(stage);
    const auto cloud = theatre().cloudAt(theatre().fire());
    ASSERT_TRUE(cloud) << theatre().value("last_drop_reason");
    const Errors errors = errorsOf(surfaceFromPointCloud2(*cloud), scene().stageIndex(stage));
    std::printf("%-10s along %.3f mm, across %.3f mm, %.1f %% of the brain\n", stage, 1e3 * errors.along,
                1e3 * errors.across, 100 * errors.share);
    EXPECT_LE(errors.along, 0.15e-3);
    EXPECT_LE(errors.across, 0.05e-3);
    EXPECT_GT(errors.share, 0.6);  // zoomed in, less is in view
  }
}

TEST(ZoomGraph, aSettingOutsideTheCalibratedRangeIsRefusedByName) {
  theatre().goTo("beyond");
  const ros::Time stamp = theatre().fire();
  char text[32];
  std::snprintf(text, sizeof text, "%u.%09u", stamp.sec, stamp.nsec);
  ASSERT_TRUE(Theatre::eventually([&] { return theatre().value("last_drop_stamp") == text; }));
  const std::string reason = theatre().value("last_drop_reason");
  EXPECT_EQ(reason.rfind("settings: ", 0), 0u) << reason;
  EXPECT_NE(reason.find("magnification 1.7"), std::string::npos) << reason;
  EXPECT_NE(reason.find("magnification 0.75 to 1.4"), std::string::npos) << reason;
  EXPECT_NE(theatre().value("calibrated_settings").find("magnification 0.75 to 1.4"), std::string::npos);
  EXPECT_FALSE(theatre().cloudAt(stamp, 0.5));
  theatre().goTo("reference");
  EXPECT_TRUE(theatre().cloudAt(theatre().fire()));
}

/// Fires pairs until the request is answered.
cortshift_msgs::AveragePairs::Response average(std::uint32_t pairs, const std::function<void(int)>& between) {
  cortshift_msgs::AveragePairs service;
  service.request.pairs = pairs;
  service.request.since = ros::Time::now();
  service.request.patience = ros::Duration(30);
  auto answer = std::async(std::launch::async,
                           [&] { return ros::service::call("/surface_reconstruction/average_pairs", service); });
  for (int fired = 0; answer.wait_for(std::chrono::milliseconds(50)) != std::future_status::ready; ++fired) {
    between(fired);
    theatre().cloudAt(theatre().fire());
  }
  EXPECT_TRUE(answer.get());
  return service.response;
}

TEST(MultiFrame, theMeanOfSeveralPairsIsMoreAccurateThanOne) {
  theatre().goTo("reference");
  const auto one = theatre().cloudAt(theatre().fire());
  ASSERT_TRUE(one);
  const auto mean = average(8, [](int) {});
  ASSERT_TRUE(mean.success) << mean.message;
  EXPECT_EQ(mean.message, "mean of 8 pairs");
  EXPECT_EQ(mean.surface.header.frame_id, "pmr");
  const int stage = scene().stageIndex("reference");
  const Surface single = surfaceFromPointCloud2(*one), averaged = surfaceFromPointCloud2(mean.surface);
  EXPECT_LT(errorsOf(averaged, stage).along, 0.8 * errorsOf(single, stage).along);
  EXPECT_GT(cv::mean(averaged.confidence)[0], cv::mean(single.confidence)[0]);
}

TEST(MultiFrame, pairsOfAnotherViewAreLeftOut) {
  theatre().goTo("reference");
  const auto mean = average(3, [](int fired) {
    if (fired == 2) theatre().goTo("near");
  });
  ASSERT_TRUE(mean.success) << mean.message;
  EXPECT_NE(mean.message.find("mean of 3 pairs; 2 more were left out"), std::string::npos) << mean.message;
  EXPECT_LT(errorsOf(surfaceFromPointCloud2(mean.surface), scene().stageIndex("near")).along, 0.1e-3);
}

TEST(MultiFrame, whatCannotBeHadIsRefused) {
  cortshift_msgs::AveragePairs service;
  for (const std::uint32_t pairs : {0u, 1u, 65u}) {
    service.request.pairs = pairs;
    ASSERT_TRUE(ros::service::call("/surface_reconstruction/average_pairs", service));
    EXPECT_FALSE(service.response.success);
    EXPECT_NE(service.response.message.find("allowed is 2 to 64"), std::string::npos);
  }
  service.request.pairs = 2;
  service.request.patience = ros::Duration(0.3);
  ASSERT_TRUE(ros::service::call("/surface_reconstruction/average_pairs", service));
  EXPECT_FALSE(service.response.success);
  EXPECT_NE(service.response.message.find("only 0 of 2 pairs"), std::string::npos) << service.response.message;
}

}  // namespace
}  // namespace cortshift_stereo

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "zoom_graph_test");
  ros::AsyncSpinner spinner(2);
  spinner.start();
  return RUN_ALL_TESTS();
}
