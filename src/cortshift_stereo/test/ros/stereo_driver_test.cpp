// The running driver: pairs that belong together, poses at their stamps, stages, triggers, faults and refusals.
#include <cortshift_msgs/MicroscopeSettings.h>
#include <cortshift_msgs/SetPhantomStage.h>
#include <cortshift_msgs/TriggerCapture.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <geometry_msgs/PoseStamped.h>
#include <gtest/gtest.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/transform_listener.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_stereo_phantom/phantom_scene.hpp"

namespace {

using cortshift_stereo_phantom::PhantomScene;
using cortshift_stereo_phantom::Side;

const ros::Duration kShortAgo(0.2);  // poses of that time have arrived, from before it and from after it

const PhantomScene& scene() {
  static const PhantomScene value(cortshift_stereo_phantom::loadPhantomCase(CORTSHIFT_TEST_DIR "/small_phantom.yaml"));
  return value;
}

/// Waits for a condition; the limit only ends a test that has failed anyway.
bool eventually(const std::function<bool()>& condition) {
  const ros::WallTime give_up = ros::WallTime::now() + ros::WallDuration(60);
  while (!condition()) {
    if (ros::WallTime::now() > give_up) return false;
    ros::WallDuration(0.02).sleep();
  }
  return true;
}

/// Everything that arrived on a topic.
template <typename Message>
class Inbox {
 public:
  explicit Inbox(const std::string& topic) {
    subscriber_ = ros::NodeHandle().subscribe<Message>(topic, 200, [this](const boost::shared_ptr<const Message>& m) {
      const std::lock_guard<std::mutex> lock(mutex_);
      messages_.push_back(m);
    });
  }
  std::vector<boost::shared_ptr<const Message>> all() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return messages_;
  }
  std::size_t size() const { return all().size(); }
  bool connected() const { return subscriber_.getNumPublishers() > 0; }

  /// The message with that stamp; null where there is none.
  boost::shared_ptr<const Message> at(const ros::Time& stamp) const {
    for (const auto& message : all())
      if (message->header.stamp == stamp) return message;
    return nullptr;
  }

 private:
  mutable std::mutex mutex_;
  std::vector<boost::shared_ptr<const Message>> messages_;
  ros::Subscriber subscriber_;
};

struct Pairs {
  explicit Pairs(const std::string& prefix = "")
      : left(prefix + "/stereo/left/image_raw"),
        right(prefix + "/stereo/right/image_raw"),
        left_info(prefix + "/stereo/left/camera_info"),
        right_info(prefix + "/stereo/right/camera_info"),
        pose(prefix + "/microscope/pose") {
    EXPECT_TRUE(eventually([&] { return left.connected() && right.connected() && pose.connected(); }));
  }
  Inbox<sensor_msgs::Image> left, right;
  Inbox<sensor_msgs::CameraInfo> left_info, right_info;
  Inbox<geometry_msgs::PoseStamped> pose;
};

struct Transforms {
  Transforms() : listener(buffer) {}
  tf2_ros::Buffer buffer{ros::Duration(600)};  // a stage may take long to render
  tf2_ros::TransformListener listener;

  Eigen::Isometry3d lookup(const std::string& target, const std::string& source, const ros::Time& stamp) const {
    return tf2::transformToEigen(buffer.lookupTransform(target, source, stamp, ros::Duration(10)));
  }
};

template <typename Service>
typename Service::Response call(const std::string& name, const typename Service::Request& request = {}) {
  Service service;
  service.request = request;
  EXPECT_TRUE(ros::service::waitForService(name, ros::Duration(60)));
  EXPECT_TRUE(ros::service::call(name, service));
  return service.response;
}

cortshift_msgs::SetPhantomStage::Response setStage(const std::string& stage) {
  cortshift_msgs::SetPhantomStage::Request request;
  request.stage = stage;
  return call<cortshift_msgs::SetPhantomStage>("/stereo_driver/set_stage", request);
}

double gap(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) { return (a.matrix() - b.matrix()).norm(); }

Eigen::Isometry3d leftOf(int stage) { return scene().view(stage, Side::kLeft).T_pmr_camera; }

TEST(StereoDriver, publishesPairsWithOneStampAtTheRateAskedFor) {
  const Pairs pairs;
  ASSERT_TRUE(eventually([&] { return pairs.left.size() >= 30 && pairs.right.size() >= 30; }));
  const auto left = pairs.left.all();
  int complete = 0;
  for (const auto& image : left) {
    const auto right = pairs.right.at(image->header.stamp);
    const auto left_info = pairs.left_info.at(image->header.stamp);
    const auto right_info = pairs.right_info.at(image->header.stamp);
    if (!right || !left_info || !right_info) continue;  // on their way at the first or the last pair
    ++complete;
    EXPECT_EQ(image->encoding, "bgr8");
    EXPECT_EQ(image->header.frame_id, "left_optical");
    EXPECT_EQ(right->header.frame_id, "right_optical");
    EXPECT_EQ(left_info->header.frame_id, "left_optical");
    EXPECT_EQ(right_info->header.frame_id, "left_optical");
    EXPECT_NE(image->data, right->data);
  }
  EXPECT_GE(complete, 28);
  std::vector<double> periods;
  for (std::size_t i = 1; i < left.size(); ++i) {
    EXPECT_LT(left[i - 1]->header.stamp, left[i]->header.stamp);
    periods.push_back((left[i]->header.stamp - left[i - 1]->header.stamp).toSec());
  }
  std::sort(periods.begin(), periods.end());
  EXPECT_NEAR(periods[periods.size() / 2], 1 / 8.0, 0.03);
}

TEST(StereoDriver, cameraInfoIsTheCalibrationOfTheHead) {
  const Pairs pairs;
  ASSERT_TRUE(eventually([&] { return pairs.left_info.size() > 0 && pairs.right_info.size() > 0; }));
  const auto model = cortshift_stereo::stereoModelFromInfo(*pairs.left_info.all()[0], *pairs.right_info.all()[0]);
  const auto& truth = scene().stereoHead().model;
  EXPECT_LT(cv::norm(model.left.R - truth.left.R), 1e-12);
  EXPECT_LT(cv::norm(model.right.P - truth.right.P), 1e-9);
  EXPECT_NEAR(model.baseline(), 0.025, 1e-12);
}

TEST(StereoDriver, tfAtTheStampIsThePoseOfThePairThroughEveryStage) {
  const Pairs pairs;
  const Transforms transforms;
  for (const char* const name : {"second", "first", "second"}) {
    const auto moved = setStage(name);
    ASSERT_TRUE(moved.success) << moved.message;
    const auto fired = call<cortshift_msgs::TriggerCapture>("/stereo_driver/trigger");
    ASSERT_TRUE(fired.success) << fired.message;
    ASSERT_TRUE(eventually([&] { return pairs.pose.at(fired.stamp) && pairs.left.at(fired.stamp); }));
    const int stage = scene().stageIndex(name);
    const Eigen::Isometry3d pose = cortshift_stereo::isometryFromMessage(pairs.pose.at(fired.stamp)->pose);
    EXPECT_EQ(pairs.pose.at(fired.stamp)->header.frame_id, "reference");
    EXPECT_LT(gap(pose, scene().T_reference_microscope(stage)), 1e-9);
    EXPECT_LT(gap(transforms.lookup("reference", "microscope", fired.stamp), pose), 1e-9);
    EXPECT_LT(gap(transforms.lookup("pmr", "left_optical", fired.stamp), leftOf(stage)), 1e-9);
    EXPECT_LT(gap(transforms.lookup("left_optical", "right_optical", fired.stamp), scene().stereoHead().T_left_right()),
              1e-9);
  }
}

TEST(StereoDriver, noFreelyRunningPairIsTakenInMotion) {
  const Pairs pairs;
  const Transforms transforms;
  // What was exposed before this listener heard its first pose cannot be looked up.
  ASSERT_TRUE(
      eventually([&] { return transforms.buffer.canTransform("pmr", "left_optical", ros::Time::now() - kShortAgo); }));
  const std::size_t first = pairs.left.size() + 1;
  ASSERT_TRUE(setStage("first").success);
  ASSERT_TRUE(setStage("second").success);
  ASSERT_TRUE(setStage("first").success);
  const std::size_t moved = std::max(pairs.left.size(), first);
  ASSERT_TRUE(eventually([&] { return pairs.left.size() > moved + 4; }));
  const auto images = pairs.left.all();
  for (std::size_t i = first; i + 3 < images.size(); ++i) {
    const Eigen::Isometry3d pose = transforms.lookup("pmr", "left_optical", images[i]->header.stamp);
    EXPECT_LT(std::min(gap(pose, leftOf(0)), gap(pose, leftOf(1))), 1e-9);
  }
}

TEST(StereoDriver, settingsFollowTheStageAndAreLatched) {
  ASSERT_TRUE(setStage("second").success);
  ASSERT_TRUE(call<cortshift_msgs::TriggerCapture>("/stereo_driver/trigger").success);
  const Inbox<cortshift_msgs::MicroscopeSettings> settings("/microscope/settings");  // subscribes after the fact
  ASSERT_TRUE(eventually([&] { return settings.size() > 0; }));
  EXPECT_EQ(settings.all().back()->magnification, 1.5);
  EXPECT_EQ(settings.all().back()->focal_length, 0.25);
  EXPECT_EQ(settings.all().back()->header.frame_id, "microscope");
}

TEST(StereoDriver, probeTipRestsOnTheSurface) {
  ASSERT_TRUE(setStage("first").success);
  const Transforms transforms;
  ASSERT_TRUE(
      eventually([&] { return transforms.buffer.canTransform("pmr", "probe_tip", ros::Time::now() - kShortAgo); }));
  const auto fired = call<cortshift_msgs::TriggerCapture>("/stereo_driver/trigger");
  const Eigen::Isometry3d tip = transforms.lookup("pmr", "probe_tip", fired.stamp);
  EXPECT_LT((tip.translation() - scene().pointAt(0, 0.004, 0.002)).norm(), 1e-9);
}

TEST(StereoDriver, unknownStageIsRefusedAndTheDriverGoesOn) {
  const auto refused = setStage("later");
  EXPECT_FALSE(refused.success);
  EXPECT_NE(refused.message.find("later"), std::string::npos);
  EXPECT_NE(refused.message.find("second"), std::string::npos);
  EXPECT_TRUE(call<cortshift_msgs::TriggerCapture>("/stereo_driver/trigger").success);
}

TEST(StereoDriver, diagnosticsNameStageAndPairs) {
  ASSERT_TRUE(setStage("second").success);
  const Inbox<diagnostic_msgs::DiagnosticArray> diagnostics("/diagnostics");
  const auto says = [&](const std::string& status_name, const std::string& key, const std::string& value) {
    for (const auto& message : diagnostics.all())
      for (const auto& status : message->status)
        if (status.name == status_name)
          for (const auto& entry : status.values)
            if (entry.key == key && (value.empty() || entry.value == value)) return true;
    return false;
  };
  EXPECT_TRUE(eventually([&] { return says("stereo_driver: phantom", "stage", "second"); }));
  EXPECT_TRUE(eventually([&] { return says("stereo_driver: pairs", "pairs published", ""); }));
}

TEST(StereoDriverFaults, spoilWhatTheyPromiseAndNothingElse) {
  const Pairs pairs("/faulty");
  const auto fired = call<cortshift_msgs::TriggerCapture>("/faulty/stereo_driver/trigger");
  ASSERT_TRUE(fired.success);
  ASSERT_TRUE(eventually([&] { return pairs.left.size() == 1 && pairs.right.size() == 1; }));
  EXPECT_EQ(pairs.left.all()[0]->header.stamp, fired.stamp);
  EXPECT_NEAR((pairs.right.all()[0]->header.stamp - fired.stamp).toSec(), 0.004, 1e-9);
  for (const auto value : pairs.left.all()[0]->data) ASSERT_EQ(value, 0);
  EXPECT_EQ(pairs.left_info.size(), 0u);
  EXPECT_EQ(pairs.pose.size(), 0u);
}

/// Samples of reference -> microscope of the shaky tracker with the time of their arrival.
class ShakyTracker {
 public:
  ShakyTracker() {
    subscriber_ = ros::NodeHandle().subscribe<tf2_msgs::TFMessage>(
        "/shaky/tf", 200, [this](const tf2_msgs::TFMessageConstPtr& message) {
          const std::lock_guard<std::mutex> lock(mutex_);
          for (const auto& edge : message->transforms)
            if (edge.child_frame_id == "microscope") {
              late_.push_back((ros::Time::now() - edge.header.stamp).toSec());
              samples_.push_back(edge);
            }
        });
  }
  std::vector<geometry_msgs::TransformStamped> samples() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return samples_;
  }
  std::vector<double> late() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return late_;
  }

 private:
  mutable std::mutex mutex_;
  std::vector<geometry_msgs::TransformStamped> samples_;
  std::vector<double> late_;
  ros::Subscriber subscriber_;
};

TEST(StereoDriverFaults, shakyTrackerIsLateNoisyAndDropsOut) {
  const ShakyTracker tracker;
  ASSERT_TRUE(eventually([&] { return tracker.samples().size() >= 120; }));
  const Eigen::Vector3d truth = scene().T_reference_microscope(0).translation();
  Eigen::Vector3d square(0, 0, 0);
  double longest_gap = 0;
  const auto samples = tracker.samples();
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const auto& t = samples[i].transform.translation;
    const Eigen::Vector3d error = Eigen::Vector3d(t.x, t.y, t.z) - truth;
    square += error.cwiseProduct(error);
    if (i > 0) longest_gap = std::max(longest_gap, (samples[i].header.stamp - samples[i - 1].header.stamp).toSec());
  }
  EXPECT_NEAR(std::sqrt(square.sum() / (3.0 * static_cast<double>(samples.size()))), 0.0002, 0.00005);
  EXPECT_GT(longest_gap, 0.29);
  for (const double late : tracker.late()) EXPECT_GE(late, 0.03);
}

/// Starts a driver with parameters of its own and returns its exit status and log.
std::pair<int, std::string> runDriver(const std::string& arguments) {
  const std::string command =
      "timeout 60 rosrun cortshift_stereo stereo_driver_node __ns:=refused " + arguments + " 2>&1";
  FILE* pipe = popen(command.c_str(), "r");
  if (pipe == nullptr) return {-1, "popen failed"};
  std::string output;
  std::array<char, 256> buffer;
  while (fgets(buffer.data(), buffer.size(), pipe) != nullptr) output += buffer.data();
  return {WEXITSTATUS(pclose(pipe)), output};
}

TEST(StereoDriverRefusals, saysWhatToSetAndExits) {
  const std::map<std::string, std::string> cases = {
      {"", "source is missing"},
      {"_source:=none", "config/site.yaml"},
      {"_source:=theodolite", "not a source of this build"},
      {"_source:=aravis", "calibration_left is missing"},
      {"_source:=phantom", "phantom_case is missing"},
      {"_source:=phantom _phantom_case:=/nowhere.yaml", "/nowhere.yaml cannot be read"},
      {"_source:=phantom _rate:=31.0", "rate = 31"},
      {"_source:=phantom _colour:=red", "colour is unknown"},
      {"_source:=phantom _fault_images:=torn", "fault_images = torn"},
  };
  for (const auto& [arguments, complaint] : cases) {
    // Each start leaves its parameters behind.
    ros::param::del("/refused/stereo_driver");
    const auto [status, output] = runDriver(arguments);
    EXPECT_EQ(status, 1) << arguments << "\n" << output;
    EXPECT_NE(output.find(complaint), std::string::npos) << arguments << "\n" << output;
  }
}

}  // namespace

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "stereo_driver_test");
  ros::AsyncSpinner spinner(2);
  spinner.start();
  return RUN_ALL_TESTS();
}
