// Fields and numbers on request.
#include <cortshift_msgs/ExcludeRegions.h>
#include <cortshift_msgs/SetGravity.h>
#include <cv_bridge/cv_bridge.h>
#include <rosbag/bag.h>
#include <sensor_msgs/Image.h>
#include <visualization_msgs/MarkerArray.h>

#include <cmath>
#include <functional>
#include <map>

#include "cortshift_tracking/field/pictures.hpp"
#include "tracker_node.hpp"

namespace cortshift_tracking {
namespace {

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
  EXPECT_TRUE(std::isnan(answer.summary.latency));  // both stages are of the past

  const auto points = latched<sensor_msgs::PointCloud2>("/shift/points");
  EXPECT_EQ(points->data, message->points.data);
  const auto markers = latched<visualization_msgs::MarkerArray>("/shift/markers");
  EXPECT_GT(markers->markers.size(), 20U);
  for (const char* topic : {"/shift/overlay_before", "/shift/overlay_after", "/shift/magnitude"}) {
    const auto image = latched<sensor_msgs::Image>(topic);
    EXPECT_EQ(image->encoding, "bgr8");
    EXPECT_EQ(image->width, 1024U);
  }
  // Each map on its own topic, of the direction that the summary speaks of.
  const Eigen::Vector3d normal = averageNormal(rest);
  const std::map<std::string, cv::Mat> maps = {{"/shift/gravity", gravityMap(field, down)},
                                               {"/shift/normal", normalMap(field, normal)},
                                               {"/shift/lateral", lateralMap(field, normal)},
                                               {"/shift/magnitude", magnitudeMap(field)}};
  for (const auto& [topic, expected] : maps) {
    const cv::Mat seen = cv_bridge::toCvCopy(latched<sensor_msgs::Image>(topic), "bgr8")->image;
    ASSERT_EQ(seen.size(), expected.size()) << topic;
    EXPECT_EQ(cv::norm(seen, expected, cv::NORM_INF), 0) << topic;
    for (const auto& [other, map] : maps)
      if (other != topic) {
        EXPECT_GT(cv::norm(seen, map, cv::NORM_INF), 50) << topic << " is " << other;
      }
  }
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

}  // namespace
}  // namespace cortshift_tracking
