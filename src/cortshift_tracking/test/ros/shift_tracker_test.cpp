// The node from outside: synthetic surfaces in, services and topics out.
#include <cortshift_msgs/CaptureStage.h>
#include <cortshift_msgs/ComputeShift.h>
#include <cortshift_msgs/DeleteStage.h>
#include <cortshift_msgs/DisplacementField.h>
#include <cortshift_msgs/ExcludeRegions.h>
#include <cortshift_msgs/ListStages.h>
#include <cortshift_msgs/SetGravity.h>
#include <cortshift_msgs/TrackShift.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>
#include <ros/ros.h>
#include <rosbag/bag.h>
#include <sensor_msgs/Image.h>
#include <tf2_msgs/TFMessage.h>
#include <visualization_msgs/MarkerArray.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

#include "analytic_scene.hpp"
#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_tracking/ros/field_message.hpp"

namespace cortshift_tracking {
namespace {

constexpr double kDegree = M_PI / 180;

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
    sagged = scene->see(scene->cameraAt(0.305, 6 * kDegree, 0.002, 12 * kDegree, {360, 270}, 0.032), kSag);
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

  static const AnalyticScene::Deformation kSag;
  static std::unique_ptr<AnalyticScene> scene;
  static PinholeCamera camera;
  static cortshift_stereo::Surface rest, sagged;
  static ros::Publisher surfaces, diagnostics, tf;
};

const AnalyticScene::Deformation ShiftTrackerNode::kSag = sagAndShift(0.005, 0.0015);
std::unique_ptr<AnalyticScene> ShiftTrackerNode::scene;
PinholeCamera ShiftTrackerNode::camera;
cortshift_stereo::Surface ShiftTrackerNode::rest, ShiftTrackerNode::sagged;
ros::Publisher ShiftTrackerNode::surfaces, ShiftTrackerNode::diagnostics, ShiftTrackerNode::tf;

TEST_F(ShiftTrackerNode, TimesOutWithTheReasonOfTheReconstruction) {
  diagnostic_msgs::DiagnosticArray message;
  message.status.resize(1);
  message.status[0].name = "surface_reconstruction: surface";
  message.status[0].values.resize(2);
  message.status[0].values[0].key = "last_drop_reason";
  message.status[0].values[0].value = "no pose of microscope near the stamp";
  message.status[0].values[1].key = "last_drop_stamp";
  message.status[0].values[1].value = "12.5";
  diagnostics.publish(message);
  ros::WallDuration(0.3).sleep();
  const auto response = capture("never");
  EXPECT_FALSE(response.success);
  holds(response.message, "'never'");
  holds(response.message, "/surface/points");
  holds(response.message, "no pose of microscope near the stamp");
  holds(response.message, "12.5");
  EXPECT_TRUE(list().empty());
}

TEST_F(ShiftTrackerNode, RefusesBadKeysAtOnce) {
  const ros::WallTime begin = ros::WallTime::now();
  for (const std::string& key : {std::string(), std::string("a b"), std::string("../x"), std::string(65, 'k'),
                                 std::string("caf\xc3\xa9"), std::string("n\0l", 3)}) {
    const auto response = capture(key);
    EXPECT_FALSE(response.success) << key;
    holds(response.message, "1-64 of A-Z a-z 0-9 _ -");
  }
  EXPECT_LT((ros::WallTime::now() - begin).toSec(), 1.9);  // none waited for a surface
  EXPECT_TRUE(list().empty());
}

TEST_F(ShiftTrackerNode, MalformedSurfacesAreNamedAndSurvived) {
  auto cloud = cloudOf(rest, ros::Time::now());
  cloud.data.resize(cloud.data.size() / 2);
  publish(cloud);
  auto other_frame = cloudOf(rest, ros::Time::now());
  other_frame.header.frame_id = "map";
  publish(other_frame);
  const auto response = capture("malformed");
  EXPECT_FALSE(response.success);
  holds(response.message, "its frame is 'map', not pmr");
  bool reported = false;
  for (int i = 0; i < 30 && !reported; ++i) {
    const auto array = latched<diagnostic_msgs::DiagnosticArray>("/diagnostics");
    for (const auto& status : array->status)
      reported |= status.name == "shift_tracker: surfaces" && status.level == diagnostic_msgs::DiagnosticStatus::ERROR;
  }
  EXPECT_TRUE(reported);

  auto empty = rest;
  empty.points = cv::Mat(rest.points.size(), CV_32FC3, cv::Scalar::all(std::nan("")));
  publish(cloudOf(empty, ros::Time::now()));
  const auto nothing = capture("empty");
  EXPECT_FALSE(nothing.success);
  holds(nothing.message, "too few connected points");
}

TEST_F(ShiftTrackerNode, TakesARecentSurfaceAndRefusesAnOldOne) {
  publish(cloudOf(rest, ros::Time::now() - ros::Duration(10)));
  EXPECT_FALSE(capture("old").success);
  const ros::Time stamp = ros::Time::now();
  publish(cloudOf(rest, stamp));
  const auto response = capture("now", "after opening");
  ASSERT_TRUE(response.success) << response.message;
  EXPECT_EQ(response.stage.key, "now");
  EXPECT_EQ(response.stage.note, "after opening");
  EXPECT_EQ(response.stage.stamp, stamp);
  EXPECT_EQ(response.stage.valid_points, 360U * 270U);
  EXPECT_DOUBLE_EQ(response.stage.coverage, 1.0);
  EXPECT_TRUE(std::isnan(response.stage.settings.magnification));
  EXPECT_NEAR(response.stage.camera_pose.position.x, camera.T_pmr_camera.translation()[0], 1e-9);

  const auto again = capture("now");
  EXPECT_FALSE(again.success);
  holds(again.message, "'now' exists already");
  ASSERT_EQ(list().size(), 1U);
}

TEST_F(ShiftTrackerNode, ASurfaceThatArrivesWhileTheRequestWaits) {
  ros::WallDuration(2.5).sleep();  // what other tests published is too old by now
  ros::AsyncSpinner spinner(1);
  spinner.start();
  const ros::Time asked = ros::Time::now();
  ros::NodeHandle node;
  const ros::WallTimer during = node.createWallTimer(
      ros::WallDuration(0.7), [](const ros::WallTimerEvent&) { surfaces.publish(cloudOf(rest, ros::Time::now())); },
      true);
  const auto response = capture("waited");
  ASSERT_TRUE(response.success) << response.message;
  EXPECT_GE(response.stage.stamp, asked - ros::Duration(2.0));
}

TEST_F(ShiftTrackerNode, FieldHasTheNumbersOfTheTruth) {
  publish(cloudOf(rest, ros::Time::now()));
  ASSERT_TRUE(capture("a").success);
  publish(cloudOf(sagged, ros::Time::now()));
  ASSERT_TRUE(capture("b").success);
  const auto stages = list();
  ASSERT_EQ(stages.size(), 2U);
  EXPECT_EQ(stages[0].key, "a");
  EXPECT_EQ(stages[1].key, "b");

  const auto answer = compute("a", "b");
  ASSERT_TRUE(answer.success) << answer.message;
  const auto message = latched<cortshift_msgs::DisplacementField>("/shift/field");
  EXPECT_EQ(message->header.frame_id, "pmr");
  EXPECT_EQ(message->header.stamp, stages[1].stamp);
  EXPECT_EQ(message->from_key, "a");
  EXPECT_EQ(message->to_key, "b");
  EXPECT_EQ(message->from_stamp, stages[0].stamp);
  EXPECT_EQ(message->to_stamp, stages[1].stamp);
  EXPECT_EQ(message->resolution, 0.0001);
  EXPECT_EQ(message->summary.valid_points, answer.summary.valid_points);

  const DisplacementField field = fieldFromMessage(*message);
  const std::vector<Eigen::Vector3d> truths = expectTheTruth(field, answer.summary.valid_points, 20000);
  double sum = 0, gravity = 0;
  const Eigen::Vector3d down = Eigen::Vector3d(0.1, 0.2, -2.0).normalized();
  for (const Eigen::Vector3d& truth : truths) {
    sum += truth.norm();
    gravity += truth.dot(down);
  }
  EXPECT_NEAR(answer.summary.magnitude_mean, sum / static_cast<double>(truths.size()), 3e-5);
  EXPECT_NEAR(answer.summary.gravity_mean, gravity / static_cast<double>(truths.size()), 3e-5);
  EXPECT_LT(answer.summary.normal_mean, -0.001);
  EXPECT_GT(answer.summary.overlap, 0.7);
  EXPECT_GT(answer.summary.compute_time, 0.0);

  const auto points = latched<sensor_msgs::PointCloud2>("/shift/points");
  EXPECT_EQ(points->data, message->points.data);
  const auto markers = latched<visualization_msgs::MarkerArray>("/shift/markers");
  EXPECT_GT(markers->markers.size(), 20U);
  for (const char* topic : {"/shift/overlay_before", "/shift/overlay_after", "/shift/magnitude"}) {
    const auto image = latched<sensor_msgs::Image>(topic);
    EXPECT_EQ(image->encoding, "bgr8");
    EXPECT_EQ(image->width, 1024U);
  }
}

TEST_F(ShiftTrackerNode, TheKeyOfTheMrIsNotForCaptures) {
  publish(cloudOf(rest, ros::Time::now()));
  const auto response = capture("pmr");
  EXPECT_FALSE(response.success);
  holds(response.message, "'pmr' stands for the preoperative MR");
  EXPECT_TRUE(list().empty());
}

TEST_F(ShiftTrackerNode, ShiftFromTheMrGoesOnFromTheStageThatIsRegisteredToIt) {
  const AnalyticScene::Deformation first = sagAndShift(0.002, 0.0006);
  publish(cloudOf(scene->see(camera, first), ros::Time::now()));
  ASSERT_TRUE(capture("a").success);
  publish(cloudOf(sagged, ros::Time::now()));
  ASSERT_TRUE(capture("b").success);
  const auto stages = list();
  std::string folder;
  ASSERT_TRUE(ros::param::get("~case_folder", folder));

  const auto none = compute("pmr", "b");
  EXPECT_FALSE(none.success);
  holds(none.message, "rosrun cortshift_tracking register_mr '" + folder + "' a MR");

  // As register_mr leaves it: the brain at rest is that of the MR.
  ShiftResult registered;
  registered.field.frame = fitProjectionFrame(rest, {0.0002, 0});
  const Projection projection = project(rest, registered.field.frame);
  const cv::Size size = registered.field.frame.size;
  registered.field.start_pmr = cv::Mat(size, CV_32FC3, cv::Scalar::all(std::nan("")));
  registered.field.displacement_pmr = registered.field.start_pmr.clone();
  registered.field.colour = cv::Mat(size, CV_8UC3, cv::Scalar(90, 90, 90));
  registered.field.confidence = cv::Mat(size, CV_32FC1, cv::Scalar(0.9));
  for (int row = 0; row < size.height; ++row)
    for (int column = 0; column < size.width; ++column) {
      if (projection.mask.at<uchar>(row, column) == 0) continue;
      const Eigen::Vector3d p =
          registered.field.frame.T_pmr_projection *
          Eigen::Vector3d(0.0002 * column, 0.0002 * row, projection.height.at<float>(row, column));
      const Eigen::Vector3d d = scene->displacement_pmr(p, AnalyticScene::atRest(), first);
      registered.field.start_pmr.at<cv::Vec3f>(row, column) = cv::Vec3d(p.x(), p.y(), p.z());
      registered.field.displacement_pmr.at<cv::Vec3f>(row, column) = cv::Vec3d(d.x(), d.y(), d.z());
    }
  registered.summary.overlap = 1;
  cortshift_msgs::StageInfo mr;
  mr.key = "pmr";
  mr.stamp = stages[0].stamp;
  std::filesystem::create_directories(folder + "/fields");
  const auto leave = [&](const cortshift_msgs::StageInfo& to) {
    rosbag::Bag bag(folder + "/fields/pmr__a.bag", rosbag::bagmode::Write);
    bag.write("/shift/field", ros::Time(1), toMessage(registered.field, registered.summary, mr, to));
  };

  auto recaptured = stages[0];
  recaptured.stamp += ros::Duration(1);
  leave(recaptured);
  const auto stale = compute("pmr", "a");
  EXPECT_FALSE(stale.success);
  holds(stale.message, "of another capture than stage 'a'");

  const auto backwards = compute("a", "pmr");
  EXPECT_FALSE(backwards.success);
  holds(backwards.message, "the preoperative MR comes before every stage");

  leave(stages[0]);
  const auto direct = compute("pmr", "a");
  ASSERT_TRUE(direct.success) << direct.message;
  EXPECT_EQ(direct.summary.from_key, "pmr");
  const auto onwards = compute("pmr", "b");
  ASSERT_TRUE(onwards.success) << onwards.message;
  EXPECT_LT(onwards.summary.gravity_mean / direct.summary.gravity_mean, 3.5);
  EXPECT_GT(onwards.summary.gravity_mean / direct.summary.gravity_mean, 1.5);
  const auto message = latched<cortshift_msgs::DisplacementField>("/shift/field");
  EXPECT_EQ(message->from_key, "pmr");
  EXPECT_EQ(message->to_key, "b");
  EXPECT_EQ(message->header.stamp, stages[1].stamp);
  expectTheTruth(fieldFromMessage(*message), onwards.summary.valid_points, 5000);
  EXPECT_NO_THROW(latched<sensor_msgs::Image>("/shift/overlay_after"));
  std::filesystem::remove_all(folder + "/fields");
}

TEST_F(ShiftTrackerNode, RefusesPairsThatMakeNoShift) {
  const auto none = compute("a", "b");
  EXPECT_FALSE(none.success);
  holds(none.message, "none has been captured yet");
  publish(cloudOf(rest, ros::Time::now()));
  ASSERT_TRUE(capture("one").success);
  ASSERT_TRUE(capture("two").success);
  const auto unknown = compute("one", "three");
  EXPECT_FALSE(unknown.success);
  holds(unknown.message, "'three'");
  holds(unknown.message, "there are: one, two");
  const auto same = compute("one", "one");
  EXPECT_FALSE(same.success);
  holds(same.message, "two different stages");
  const auto backwards = compute("two", "one");
  EXPECT_FALSE(backwards.success);
  holds(backwards.message, "captured after");
  EXPECT_TRUE(compute("one", "two").success);
}

TEST_F(ShiftTrackerNode, DeletesOnlyWhatIsThere) {
  publish(cloudOf(rest, ros::Time::now()));
  ASSERT_TRUE(capture("one").success);
  ASSERT_TRUE(capture("two").success);
  cortshift_msgs::DeleteStage service;
  service.request.key = "nine";
  ASSERT_TRUE(ros::service::call("/shift_tracker/delete_stage", service));
  EXPECT_FALSE(service.response.success);
  holds(service.response.message, "there are: one, two");
  service.request.key = "one";
  ASSERT_TRUE(ros::service::call("/shift_tracker/delete_stage", service));
  EXPECT_TRUE(service.response.success);
  ASSERT_EQ(list().size(), 1U);
  EXPECT_EQ(list()[0].key, "two");
  EXPECT_TRUE(capture("one").success);  // the key is free again, and comes after "two" now
  EXPECT_EQ(list()[1].key, "one");
}

TEST_F(ShiftTrackerNode, GravityAndExcludedRegionsCountFromTheNextShiftOn) {
  publish(cloudOf(rest, ros::Time::now()));
  ASSERT_TRUE(capture("a").success);
  publish(cloudOf(sagged, ros::Time::now()));
  ASSERT_TRUE(capture("b").success);
  const auto before = compute("a", "b");
  ASSERT_TRUE(before.success) << before.message;
  const auto field = fieldFromMessage(*latched<cortshift_msgs::DisplacementField>("/shift/field"));

  cortshift_msgs::SetGravity gravity;  // zero
  ASSERT_TRUE(ros::service::call("/shift_tracker/set_gravity", gravity));
  EXPECT_FALSE(gravity.response.success);
  const Eigen::Vector3d against = -2 * field.frame.normal_pmr();
  gravity.request.gravity.x = against[0];
  gravity.request.gravity.y = against[1];
  gravity.request.gravity.z = against[2];
  ASSERT_TRUE(ros::service::call("/shift_tracker/set_gravity", gravity));
  EXPECT_TRUE(gravity.response.success);

  cortshift_msgs::ExcludeRegions exclude;
  exclude.request.key = "nine";
  ASSERT_TRUE(ros::service::call("/shift_tracker/exclude_regions", exclude));
  EXPECT_FALSE(exclude.response.success);
  exclude.request.key = "a";
  exclude.request.polygons.resize(1);
  ASSERT_TRUE(ros::service::call("/shift_tracker/exclude_regions", exclude));
  EXPECT_FALSE(exclude.response.success);  // no corners
  const double x = 0.5 * field.frame.size.width * field.frame.resolution,
               y = 0.5 * field.frame.size.height * field.frame.resolution, half = 0.003;
  for (const auto& [dx, dy] : {std::pair<double, double>{-half, -half}, {half, -half}, {half, half}, {-half, half}}) {
    geometry_msgs::Point32 corner;
    corner.x = static_cast<float>(x + dx);
    corner.y = static_cast<float>(y + dy);
    exclude.request.polygons[0].points.push_back(corner);
  }
  ASSERT_TRUE(ros::service::call("/shift_tracker/exclude_regions", exclude));
  EXPECT_TRUE(exclude.response.success) << exclude.response.message;

  const auto after = compute("a", "b");
  ASSERT_TRUE(after.success) << after.message;
  EXPECT_NEAR(after.summary.gravity_normal_angle, M_PI, 1e-6);
  EXPECT_NEAR(after.summary.gravity_mean, -after.summary.normal_mean, 1e-9);
  const auto holed = fieldFromMessage(*latched<cortshift_msgs::DisplacementField>("/shift/field"));
  const int column = field.frame.size.width / 2, row = field.frame.size.height / 2;
  EXPECT_FALSE(std::isnan(field.displacement_pmr.at<cv::Vec3f>(row, column)[0]));
  EXPECT_TRUE(std::isnan(holed.displacement_pmr.at<cv::Vec3f>(row, column)[0]));
  EXPECT_FALSE(std::isnan(holed.displacement_pmr.at<cv::Vec3f>(row, column + 60)[0]));

  // Other stages under the same keys, seen along another normal: nothing of the old ones may linger.
  SetUp();
  publish(cloudOf(sagged, ros::Time::now()));
  ASSERT_TRUE(capture("a").success);
  publish(cloudOf(rest, ros::Time::now()));
  ASSERT_TRUE(capture("b").success);
  const auto anew = compute("a", "b");
  ASSERT_TRUE(anew.success) << anew.message;
  EXPECT_NEAR(anew.summary.gravity_normal_angle, std::acos((-field.frame.normal_pmr()).dot(averageNormal(sagged))),
              1e-6);
  EXPECT_GT(anew.summary.valid_points, after.summary.valid_points);
}

TEST_F(ShiftTrackerNode, LiveModePublishesAFieldForTheNewestSurfaces) {
  publish(cloudOf(rest, ros::Time::now()));
  ASSERT_TRUE(capture("a").success);
  cortshift_msgs::TrackShift track;
  track.request.on = true;
  track.request.key = "nine";
  ASSERT_TRUE(ros::service::call("/shift_tracker/track", track));
  EXPECT_FALSE(track.response.success);
  track.request.key = "a";
  ASSERT_TRUE(ros::service::call("/shift_tracker/track", track));
  ASSERT_TRUE(track.response.success) << track.response.message;

  std::vector<ros::Time> stamps;
  cortshift_msgs::DisplacementFieldConstPtr last;
  ros::NodeHandle node;
  const ros::Subscriber fields [[maybe_unused]] = node.subscribe<cortshift_msgs::DisplacementField>(
      "/shift/field", 10,
      boost::function<void(const cortshift_msgs::DisplacementFieldConstPtr&)>([&](const auto& message) {
        if (message->to_key.empty()) stamps.push_back(message->to_stamp);
        last = message;
      }));
  ros::Time newest;
  for (int i = 0; i < 40; ++i) {
    newest = ros::Time::now();
    surfaces.publish(cloudOf(i % 2 == 0 ? rest : sagged, newest));
    ros::WallDuration(0.1).sleep();
    ros::spinOnce();
  }
  for (int i = 0; i < 100 && (stamps.empty() || stamps.back() != newest); ++i) {
    ros::WallDuration(0.1).sleep();
    ros::spinOnce();
  }
  ASSERT_GE(stamps.size(), 2U);
  EXPECT_EQ(stamps.back(), newest);  // whatever was passed over, the newest was not
  EXPECT_TRUE(std::is_sorted(stamps.begin(), stamps.end()));
  EXPECT_EQ(last->from_key, "a");
  EXPECT_EQ(last->resolution, 0.0002);
  EXPECT_GT(last->summary.magnitude_mean, 0.003);  // the last one was the sagged surface
  track.request.on = false;
  ASSERT_TRUE(ros::service::call("/shift_tracker/track", track));
  EXPECT_TRUE(track.response.success);
  const std::size_t count = stamps.size();
  ros::spinOnce();
  surfaces.publish(cloudOf(rest, ros::Time::now()));
  ros::WallDuration(1.5).sleep();
  ros::spinOnce();
  EXPECT_LE(stamps.size(), count + 1);  // one may have been under way
}

}  // namespace
}  // namespace cortshift_tracking

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_shift_tracker");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
