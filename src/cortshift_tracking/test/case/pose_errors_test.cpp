// From the tracker's samples around a capture, through the stage, to the budget of a shift.
#include <gmock/gmock.h>

#include <cmath>
#include <fstream>

#include "case/case_folder.hpp"
#include "case/stage_samples.hpp"
#include "cortshift_stereo/ros/pose_source.hpp"
#include "cortshift_tracking/case/stage_record.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/ros/parameters.hpp"
#include "cortshift_tracking/ros/stage_shift.hpp"

namespace cortshift_tracking {
namespace {

using cortshift_stereo::ParameterError;
using cortshift_stereo::ParameterSource;
using testing::HasSubstr;

/// A stage whose camera moves along x [m/s].
cortshift_msgs::StageInfo stageAt(double speed, double latency_sd) {
  StageRecord record = sampleStage("moving");
  const ros::Time stamp = record.info.stamp;
  cortshift_stereo::TransformTree tree(0.2, 10);
  tree.addFixed("pmr", "reference", {0, 0, 0}, Eigen::Quaterniond::Identity());
  tree.addFixed("microscope", "left_optical", {0, 0, 0}, Eigen::Quaterniond::Identity());
  for (int n = -10; n <= 10; ++n)
    tree.addSample("reference", "microscope", static_cast<int64_t>(stamp.toNSec()) + n * 50000000LL,
                   {speed * 0.05 * n, 0, -0.3}, Eigen::Quaterniond::Identity());
  const cortshift_stereo::PoseSource poses([&](const std::string& target, const std::string& source,
                                               const ros::Time& at) { return poseFrom(tree, target, source, at); },
                                           {},
                                           [&](const std::string& target, const std::string& source,
                                               const ros::Time& at) { return poseMotion(tree, target, source, at); });
  placeRecord(record, poses, latency_sd);
  return record.info;
}

StageRecord recordOf(const cortshift_msgs::StageInfo& info) {
  StageRecord record;
  record.info = info;
  return record;
}

double shareOf(const std::vector<PoseErrorShare>& shares, const std::string& source) {
  for (const PoseErrorShare& share : shares)
    if (share.source == source) return sdAt(share.covariance, Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero());
  ADD_FAILURE() << source << " is not in the budget";
  return NAN;
}

TEST(Stages, OneInAnotherFrameIsRefused) {
  StageRecord record = sampleStage("elsewhere");
  auto surface = boost::make_shared<sensor_msgs::PointCloud2>(*record.surface);
  surface->header.frame_id = "/head_a";
  record.surface = surface;
  try {
    completeStage(record, cortshift_stereo::PoseSource({}, {}), 0);
    FAIL() << "accepted";
  } catch (const TrackingError& error) {
    EXPECT_STREQ(error.what(),
                 "the surface is in the frame 'head_a', not pmr; a case is of one patient's pmr: leave "
                 "surface_reconstruction's map_frame as it is");
  }
}

TEST(PoseErrors, ALatencyCountsTimesTheSpeedAtTheCapture) {
  const cortshift_msgs::StageInfo still = stageAt(0, 0.020), moving = stageAt(0.010, 0.020);
  const PairKnowledge knowledge = knowledgeOf(recordOf(still), moving, {}, {});
  ASSERT_TRUE(knowledge.earlier && knowledge.later);
  const auto shares = poseErrorShares(*knowledge.earlier, *knowledge.later, Eigen::Vector3d::Zero());
  EXPECT_NEAR(shareOf(shares, "latency of the tracker"), 0.0002, 1e-7);  // 20 ms at 10 mm/s
  EXPECT_NEAR(shareOf(shares, "tremble of the tracker"), 0, 1e-7);
}

TEST(PoseErrors, TheBaselineIsThatOfTheStagesCameras) {
  StageRecord record = recordOf(stageAt(0, 0));
  EXPECT_DOUBLE_EQ(knowledgeOf(record, record.info, {}, {}).baseline, 0.025);
  sensor_msgs::CameraInfo info;
  record.left_info = record.right_info = boost::make_shared<sensor_msgs::CameraInfo>(info);
  EXPECT_DOUBLE_EQ(knowledgeOf(record, record.info, {}, {}).baseline, 0.025) << "they do not say";
  info.P[0] = 2000;
  info.P[3] = -2000 * 0.0052;
  record.right_info = boost::make_shared<sensor_msgs::CameraInfo>(info);
  EXPECT_NEAR(knowledgeOf(record, record.info, {}, {}).baseline, 0.0052, 1e-12);
}

TEST(PoseErrors, WithoutSamplesWhatIsStoredStays) {
  StageRecord record = sampleStage("stored");
  record.info.pose_errors.resize(1);
  record.info.pose_errors[0].source = "known before";
  placeRecord(
      record, [](const std::string&, const std::string&, const ros::Time&) { return Eigen::Isometry3d::Identity(); },
      1);
  ASSERT_EQ(record.info.pose_errors.size(), 1U);
  EXPECT_EQ(record.info.pose_errors[0].source, "known before");
}

class Residuals : public CaseFolderTest {
 protected:
  std::string file(const std::string& name, const std::string& text) const {
    const std::string path = (folder / name).string();
    std::ofstream(path) << text;
    return path;
  }
  ShiftTrackerParameters load(const std::string& text) const {
    return ShiftTrackerParameters::load(ParameterSource::fromYaml(file("parameters.yaml", text)));
  }
  std::string stereo() const {
    return "stereo_report: " +
           file("report.yaml",
                "focal_length_deviation_percent: 0.5\nbaseline_mm: 25\n"
                "left: {focal_length_px: 4000}\ndistortion_model: k1\n"
                "cross_validation:\n  - {model: none, epipolar_rms_px: 3}\n"
                "  - {model: k1, epipolar_rms_px: 0.1}\n") +
           "\n";
  }
  std::string zoom() const {
    return "settings_report: " +
           file("settings_report.yaml",
                "reference: {magnification: 1.0, focal_length: 0.3}\n"
                "left: {held_out_rms_px: 0.2}\nright: {held_out_rms_px: 0.2}\n") +
           "\n";
  }
};

TEST_F(Residuals, OfStereoCalibrationAndSettingsBecomeDepths) {
  const SurroundSettings known = load(stereo() + zoom()).shift.surround;
  ASSERT_EQ(known.depths.size(), 1U);
  EXPECT_NEAR(known.depths[0].scale_sd, 0.005, 1e-12);
  EXPECT_NEAR(known.depths[0].disparity_sd * 0.3 * 0.3, 0.1 * 0.3 * 0.3 / (4000 * 0.025), 1e-9);  // 0.09 mm
  cortshift_msgs::StageInfo reference = stageAt(0, 0), zoomed = reference;
  reference.settings.magnification = reference.settings.focal_length = NAN;
  zoomed.settings.magnification = 1.2;
  zoomed.settings.focal_length = 0.3;
  const PairKnowledge knowledge = knowledgeOf(recordOf(reference), zoomed, known, {});
  const auto shares = poseErrorShares(*knowledge.earlier, *knowledge.later, Eigen::Vector3d::Zero());
  EXPECT_NEAR(shareOf(shares, "zoom and focus"), 0.2 * 0.3 * 0.3 / (4000 * 0.025), 1e-9);  // 0.18 mm
  const PairKnowledge same = knowledgeOf(recordOf(reference), reference, known, {});
  for (const PoseErrorShare& share : poseErrorShares(*same.earlier, *same.later, Eigen::Vector3d::Zero()))
    EXPECT_NE(share.source, "zoom and focus") << "both stages are at the reference";
}

TEST_F(Residuals, FilesThatSayNothingAreRefusedByName) {
  const auto refusal = [&](const std::string& text) -> std::string {
    try {
      load(text);
    } catch (const ParameterError& error) {
      return error.what();
    }
    return "not refused";
  };
  EXPECT_THAT(refusal(zoom()), HasSubstr("settings_report needs stereo_report"));
  EXPECT_THAT(refusal("stereo_report: " + file("empty.yaml", "verdict: good\n") + "\n"),
              testing::AllOf(HasSubstr("stereo_report"), HasSubstr("focal_length_deviation_percent")));
  EXPECT_THAT(refusal(stereo() + "settings_report: /nowhere.yaml\n"), HasSubstr("/nowhere.yaml"));
}

}  // namespace
}  // namespace cortshift_tracking
