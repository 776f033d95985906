// The running node: good pairs give surfaces in pmr, each fault is named in the diagnostics, and the node lives on.
#include <cortshift_msgs/MicroscopeSettings.h>
#include <cv_bridge/cv_bridge.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>
#include <ros/ros.h>
#include <stereo_msgs/DisparityImage.h>
#include <tf2_msgs/TFMessage.h>

#include <opencv2/imgcodecs.hpp>

#include "analytic_scene.hpp"
#include "cortshift_stereo/ros/conversions.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_stereo_test::AnalyticScene;

constexpr double kLong = 30;  // [s] what must come comes long before

/// Cameras, tracker and listener of the node under test. One for all tests: stamps go on, as in theatre.
class Theatre {
 public:
  Theatre() {
    for (int side = 0; side < 2; ++side) {
      const std::string camera = side == 0 ? "/stereo/left" : "/stereo/right";
      images_[side] = node_.advertise<sensor_msgs::Image>(camera + "/image_raw", 5);
      compressed_[side] = node_.advertise<sensor_msgs::CompressedImage>(camera + "/image_raw/compressed", 5);
      infos_[side] = node_.advertise<sensor_msgs::CameraInfo>(camera + "/camera_info", 5, true);
    }
    settings_ = node_.advertise<cortshift_msgs::MicroscopeSettings>("/microscope/settings", 1, true);
    tf_ = node_.advertise<tf2_msgs::TFMessage>("/tf", 100);
    tf_static_ = node_.advertise<tf2_msgs::TFMessage>("/tf_static", 1, true);
    points_ = node_.subscribe<sensor_msgs::PointCloud2>(
        "/surface/points", 10, [this](const sensor_msgs::PointCloud2::ConstPtr& m) { clouds_[m->header.stamp] = m; });
    disparities_ = node_.subscribe<stereo_msgs::DisparityImage>(
        "/surface/disparity", 10,
        [this](const stereo_msgs::DisparityImage::ConstPtr& m) { disparity_stamp_ = m->header.stamp; });
    diagnostics_ = node_.subscribe<diagnostic_msgs::DiagnosticArray>(
        "/diagnostics", 100, [this](const diagnostic_msgs::DiagnosticArray::ConstPtr& m) {
          for (const auto& status : m->status) {
            if (status.name != "surface_reconstruction: surface") continue;
            message_ = status.message;
            for (const auto& value : status.values) values_[value.key] = value.value;
          }
        });
    tf2_msgs::TFMessage fixed;
    fixed.transforms = {edge("pmr", "reference", {0.1, 0.2, 0.3}, 0.4),
                        edge("microscope", "left_optical", {0, 0.05, 0}, -0.3)};
    tf_static_.publish(fixed);
    const bool ready = waitFor([this] {
      return images_[0].getNumSubscribers() && images_[1].getNumSubscribers() && compressed_[0].getNumSubscribers() &&
             compressed_[1].getNumSubscribers() && tf_.getNumSubscribers() && infos_[0].getNumSubscribers() &&
             infos_[1].getNumSubscribers() && settings_.getNumSubscribers() && points_.getNumPublishers() &&
             disparities_.getNumPublishers() && diagnostics_.getNumPublishers();
    });
    if (!ready) throw std::runtime_error("the node under test does not come up");
  }

  bool waitFor(const std::function<bool()>& condition, double seconds = kLong) {
    const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(seconds);
    while (ros::ok() && ros::WallTime::now() < end) {
      ros::spinOnce();
      if (condition()) return true;
      ros::WallDuration(0.01).sleep();
    }
    return false;
  }

  ros::Time nextStamp() { return stamp_ += ros::Duration(1.0); }

  void sendImages(const ros::Time& left_stamp, const ros::Time& right_stamp, const cv::Mat& left,
                  const cv::Mat& right) {
    std_msgs::Header header;
    header.stamp = left_stamp;
    images_[0].publish(cv_bridge::CvImage(header, "bgr8", left).toImageMsg());
    header.stamp = right_stamp;
    images_[1].publish(cv_bridge::CvImage(header, "bgr8", right).toImageMsg());
  }
  void sendCompressed(const ros::Time& stamp, const cv::Mat& left, const cv::Mat& right) {
    for (int side = 0; side < 2; ++side) {
      sensor_msgs::CompressedImage image;
      image.header.stamp = stamp;
      image.format = "bgr8; png compressed bgr8";
      cv::imencode(".png", side == 0 ? left : right, image.data);
      compressed_[side].publish(image);
    }
  }
  void sendInfos(const StereoModel& model, const ros::Time& since = ros::Time()) {
    std_msgs::Header header;
    header.stamp = since;
    header.frame_id = "left_optical";
    infos_[0].publish(toCameraInfo(model.left, header));
    infos_[1].publish(toCameraInfo(model.right, header));
  }
  void sendSettings(double magnification, const ros::Time& since = ros::Time()) {
    cortshift_msgs::MicroscopeSettings settings;
    settings.header.stamp = since;
    settings.magnification = magnification;
    settings.focal_length = 0.3;
    settings_.publish(settings);
  }
  void sendPose(const ros::Time& stamp) {
    tf2_msgs::TFMessage message;
    message.transforms = {edge("reference", "microscope", {0.01, 0.02, -0.4}, 0.8)};
    message.transforms[0].header.stamp = stamp;
    tf_.publish(message);
  }
  void sendPosesAround(const ros::Time& stamp) {
    sendPose(stamp - ros::Duration(0.02));
    sendPose(stamp + ros::Duration(0.03));
  }
  static Eigen::Isometry3d T_pmr_left() {
    return isometryFromMessage(edge("", "", {0.1, 0.2, 0.3}, 0.4).transform) *
           isometryFromMessage(edge("", "", {0.01, 0.02, -0.4}, 0.8).transform) *
           isometryFromMessage(edge("", "", {0, 0.05, 0}, -0.3).transform);
  }

  sensor_msgs::PointCloud2::ConstPtr cloudAt(const ros::Time& stamp) {
    return waitFor([&] { return clouds_.count(stamp) != 0; }) ? clouds_.at(stamp) : nullptr;
  }
  /// Waits until the diagnostics say that the pair of this stamp was dropped; its reason.
  std::string dropOf(const ros::Time& stamp) {
    char text[32];
    std::snprintf(text, sizeof text, "%u.%09u", stamp.sec, stamp.nsec);
    if (!waitFor([&] { return values_["last_drop_stamp"] == text; })) return "no drop";
    EXPECT_EQ(clouds_.count(stamp), 0u) << "a dropped pair gave a surface";
    return values_["last_drop_reason"];
  }

  std::string message_;
  std::map<std::string, std::string> values_;
  ros::Time disparity_stamp_;

 private:
  static geometry_msgs::TransformStamped edge(const std::string& parent, const std::string& child,
                                              const Eigen::Vector3d& t, double angle) {
    geometry_msgs::TransformStamped out;
    out.header.frame_id = parent;
    out.child_frame_id = child;
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() = Eigen::AngleAxisd(angle, Eigen::Vector3d(1, 2, -1).normalized()).toRotationMatrix();
    T.translation() = t;
    out.transform = toTransform(T);
    return out;
  }

  ros::NodeHandle node_;
  ros::Time stamp_{1000.0};
  ros::Publisher images_[2], compressed_[2], infos_[2], settings_, tf_, tf_static_;
  ros::Subscriber points_, disparities_, diagnostics_;
  std::map<ros::Time, sensor_msgs::PointCloud2::ConstPtr> clouds_;
};

class SurfaceReconstructionTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    theatre = new Theatre;
    left = scene.left();
    right = scene.right();
    const ros::Time stamp = theatre->nextStamp();
    theatre->sendPosesAround(stamp);
    theatre->sendImages(stamp, stamp, left, right);
    drop_without_camera_info = theatre->dropOf(stamp);
    theatre->sendInfos(scene.model());
  }
  static void TearDownTestSuite() { delete theatre; }

  /// After each fault a good pair must pass.
  void TearDown() override {
    const ros::Time stamp = theatre->nextStamp();
    theatre->sendPosesAround(stamp);
    theatre->sendImages(stamp, stamp, left, right);
    EXPECT_TRUE(theatre->cloudAt(stamp)) << "the node did not go on: " << theatre->message_;
  }
  std::string dropOfPair(const cv::Mat& l, const cv::Mat& r) {
    const ros::Time stamp = theatre->nextStamp();
    theatre->sendPosesAround(stamp);
    theatre->sendImages(stamp, stamp, l, r);
    return theatre->dropOf(stamp);
  }
  static void expectReason(const std::string& got, const std::string& reason, const std::string& detail) {
    EXPECT_EQ(got.substr(0, reason.size() + 2), reason + ": ");
    EXPECT_NE(got.find(detail), std::string::npos) << got;
  }

  static Theatre* theatre;
  static AnalyticScene scene;
  static cv::Mat left, right;
  static std::string drop_without_camera_info;  // of the first pair of all
};
Theatre* SurfaceReconstructionTest::theatre = nullptr;
AnalyticScene SurfaceReconstructionTest::scene;
cv::Mat SurfaceReconstructionTest::left, SurfaceReconstructionTest::right;
std::string SurfaceReconstructionTest::drop_without_camera_info;

TEST_F(SurfaceReconstructionTest, aPairBecomesASurfaceInPmr) {
  const ros::Time stamp = theatre->nextStamp();
  theatre->sendPosesAround(stamp);
  theatre->sendImages(stamp, stamp, left, right);
  const auto cloud = theatre->cloudAt(stamp);
  ASSERT_TRUE(cloud) << theatre->message_;
  EXPECT_EQ(cloud->header.frame_id, "pmr");
  const Surface surface = surfaceFromPointCloud2(*cloud);
  ASSERT_EQ(surface.size(), scene.size);

  // Back to the rectified left camera, where the truth is known.
  const cv::Mat depth = scene.trueDepth();
  const StereoModel model = scene.model();
  std::vector<double> errors;
  for (int y = 0; y < depth.rows; ++y)
    for (int x = 0; x < depth.cols; ++x) {
      const auto& p = surface.points.at<cv::Vec3f>(y, x);
      if (std::isnan(p[0])) continue;
      const Eigen::Vector3d in_left = Theatre::T_pmr_left().inverse() * Eigen::Vector3d(p[0], p[1], p[2]);
      const cv::Vec3d rectified = model.left.R * cv::Vec3d(in_left.x(), in_left.y(), in_left.z());
      const double z = depth.at<float>(y, x);
      const cv::Matx34d& P = model.left.P;
      const cv::Vec3d truth((x - P(0, 2)) / P(0, 0) * z, (y - P(1, 2)) / P(1, 1) * z, z);
      errors.push_back(cv::norm(rectified - truth));
    }
  ASSERT_GT(errors.size(), depth.total() * 7 / 10);
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], 0.3e-3);  // a tenth of a pixel: 1 px is 3 mm of depth here
  EXPECT_LT(errors[errors.size() * 95 / 100], 1.0e-3);
  EXPECT_TRUE(theatre->waitFor([&] { return theatre->disparity_stamp_ == stamp; }));
  EXPECT_TRUE(theatre->waitFor([&] { return !theatre->values_["search_range_px"].empty(); }));
}

TEST_F(SurfaceReconstructionTest, compressedImagesGiveTheSameCloud) {
  const ros::Time raw = theatre->nextStamp(), compressed = theatre->nextStamp();
  theatre->sendPosesAround(raw);
  theatre->sendImages(raw, raw, left, right);
  const auto from_raw = theatre->cloudAt(raw);
  theatre->sendPosesAround(compressed);
  theatre->sendCompressed(compressed, left, right);
  const auto from_compressed = theatre->cloudAt(compressed);
  ASSERT_TRUE(from_raw && from_compressed) << theatre->message_;
  EXPECT_EQ(from_raw->data, from_compressed->data);
}

TEST_F(SurfaceReconstructionTest, aPoseThatComesLateIsWaitedFor) {
  const ros::Time stamp = theatre->nextStamp();
  theatre->sendPose(stamp - ros::Duration(0.02));
  theatre->sendImages(stamp, stamp, left, right);
  theatre->waitFor([] { return false; }, 0.6);
  theatre->sendPose(stamp + ros::Duration(0.03));
  EXPECT_TRUE(theatre->cloudAt(stamp)) << theatre->message_;
}

TEST_F(SurfaceReconstructionTest, aMissingPoseIsRefused) {
  const ros::Time stamp = theatre->nextStamp();
  theatre->sendPose(stamp - ros::Duration(0.02));
  theatre->sendImages(stamp, stamp, left, right);
  expectReason(theatre->dropOf(stamp), "pose", "reference -> microscope");
}

TEST_F(SurfaceReconstructionTest, aGapInTheTrackingIsRefused) {
  const ros::Time stamp = theatre->nextStamp();
  theatre->sendPose(stamp - ros::Duration(0.2));
  theatre->sendPose(stamp + ros::Duration(0.05));
  theatre->sendImages(stamp, stamp, left, right);
  expectReason(theatre->dropOf(stamp), "pose", "0.200000 s away");
}

TEST_F(SurfaceReconstructionTest, aPairWithoutCameraInfoIsRefused) {
  expectReason(drop_without_camera_info, "camera_info", "check that the driver or the bag publishes it");
}

TEST_F(SurfaceReconstructionTest, anUnsynchronisedPairIsRefused) {
  const ros::Time stamp = theatre->nextStamp(), later = stamp + ros::Duration(0.003);
  theatre->sendPosesAround(stamp);
  theatre->sendImages(stamp, later, left, right);
  expectReason(theatre->dropOf(later), "unsynchronised", "-3.0");
}

TEST_F(SurfaceReconstructionTest, aBadCalibrationIsRefused) {
  StereoModel bad = scene.model();
  bad.right.P(0, 3) = 0;
  theatre->sendInfos(bad);
  theatre->waitFor([] { return false; }, 0.3);
  expectReason(dropOfPair(left, right), "calibration", "baseline");
  bad = scene.model();
  bad.left.R(0, 0) = 0.5;
  theatre->sendInfos(bad);
  theatre->waitFor([] { return false; }, 0.3);
  expectReason(dropOfPair(left, right), "calibration", "not a rotation");
  theatre->sendInfos(scene.model());
  theatre->waitFor([] { return false; }, 0.3);
}

/// Distances of the points from the camera [m], where both clouds have one: how many times the first's the second's
/// are.
double scaleBetween(const sensor_msgs::PointCloud2& first, const sensor_msgs::PointCloud2& second) {
  const Surface a = surfaceFromPointCloud2(first), b = surfaceFromPointCloud2(second);
  const Eigen::Vector3d camera = Theatre::T_pmr_left().translation();
  const auto distance = [&](const cv::Vec3f& p) { return (Eigen::Vector3d(p[0], p[1], p[2]) - camera).norm(); };
  double sum = 0;
  int count = 0;
  for (int y = 0; y < a.points.rows; ++y)
    for (int x = 0; x < a.points.cols; ++x) {
      const auto &p = a.points.at<cv::Vec3f>(y, x), &q = b.points.at<cv::Vec3f>(y, x);
      if (std::isnan(p[0]) || std::isnan(q[0])) continue;
      sum += distance(q) / distance(p);
      ++count;
    }
  return sum / count;
}

TEST_F(SurfaceReconstructionTest, theCalibrationInForceAtThePairCounts) {
  StereoModel wider = scene.model();
  wider.right.P(0, 3) *= 1.1;  // every point is 1.1 times as far
  const ros::Time before = theatre->nextStamp(), after = theatre->nextStamp(), late = theatre->nextStamp();
  theatre->sendInfos(scene.model(), before - ros::Duration(0.5));
  theatre->sendInfos(wider, after - ros::Duration(0.5));
  theatre->waitFor([] { return false; }, 0.3);
  const auto surfaceAt = [&](const ros::Time& stamp) {
    theatre->sendPosesAround(stamp);
    theatre->sendImages(stamp, stamp, left, right);
    return theatre->cloudAt(stamp);
  };
  const auto old_calibration = surfaceAt(before), new_calibration = surfaceAt(after);
  ASSERT_TRUE(old_calibration && new_calibration) << theatre->message_;
  EXPECT_NEAR(scaleBetween(*old_calibration, *new_calibration), 1.1, 1e-4);

  // One that comes after the pair that it holds for. The pose that the pair waits for comes last.
  theatre->sendImages(late, late, left, right);
  theatre->waitFor([] { return false; }, 0.3);
  theatre->sendInfos(scene.model(), late);
  theatre->waitFor([] { return false; }, 0.3);
  theatre->sendPosesAround(late);
  const auto back = theatre->cloudAt(late);
  ASSERT_TRUE(back) << theatre->message_;
  EXPECT_NEAR(scaleBetween(*old_calibration, *back), 1.0, 1e-4);
  theatre->sendInfos(scene.model());  // at no time, for the tests after this one
  theatre->waitFor([] { return false; }, 0.3);
}

TEST_F(SurfaceReconstructionTest, aMicroscopeSettingOtherThanThatOfTheCalibrationIsRefused) {
  theatre->sendSettings(1.0);
  theatre->waitFor([] { return false; }, 0.3);
  EXPECT_EQ(dropOfPair(left, right), "no drop");  // none is configured: the first one counts
  theatre->sendSettings(2.5);
  theatre->waitFor([] { return false; }, 0.3);
  expectReason(dropOfPair(left, right), "settings", "magnification 2.5");
  theatre->sendSettings(1.0);
  theatre->waitFor([] { return false; }, 0.3);
}

TEST_F(SurfaceReconstructionTest, aSettingReportedAfterThePairItHoldsForCounts) {
  theatre->sendSettings(1.0);
  theatre->waitFor([] { return false; }, 0.3);
  const ros::Time zoomed = theatre->nextStamp();
  theatre->sendImages(zoomed, zoomed, left, right);
  theatre->waitFor([] { return false; }, 0.3);
  theatre->sendSettings(2.5, zoomed - ros::Duration(0.5));
  theatre->waitFor([] { return false; }, 0.3);
  theatre->sendPosesAround(zoomed);  // what is made under the earlier setting is held up until here
  expectReason(theatre->dropOf(zoomed), "settings", "magnification 2.5");

  const ros::Time back = theatre->nextStamp();
  theatre->sendPosesAround(back);
  theatre->sendImages(back, back, left, right);
  theatre->waitFor([] { return false; }, 0.03);
  theatre->sendSettings(1.0, back - ros::Duration(0.5));
  EXPECT_TRUE(theatre->cloudAt(back)) << theatre->message_;
}

TEST_F(SurfaceReconstructionTest, imagesThatCannotGiveASurfaceAreRefused) {
  expectReason(dropOfPair(cv::Mat(left.size(), CV_8UC3, cv::Scalar::all(20)), right), "blank", "left");
  cv::Mat bright;
  right.convertTo(bright, -1, 2.2);
  expectReason(dropOfPair(left, bright), "saturated", "right");
  cv::Mat small;
  cv::resize(left, small, {}, 0.5, 0.5);
  expectReason(dropOfPair(small, right), "image_size", "160x120");
  EXPECT_NE(dropOfPair(right, left), "no drop") << "left and right swapped";
}

}  // namespace
}  // namespace cortshift_stereo

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "surface_reconstruction_test");
  return RUN_ALL_TESTS();
}
