#include "cortshift_tracking/igtl/tool_board.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "packets.hpp"

namespace cortshift_tracking::igt {
namespace {

constexpr std::int64_t kNow = 1700000000000000000;
constexpr std::int64_t kMs = 1000000;

Eigen::Isometry3d pose(double angle, double x_mm, double y_mm, double z_mm) {
  return Eigen::Translation3d(x_mm / 1000, y_mm / 1000, z_mm / 1000) *
         Eigen::AngleAxisd(angle, Eigen::Vector3d(1, 2, -1).normalized()) * Eigen::Isometry3d::Identity();
}

Message transform(const std::string& device, std::int64_t stamp_ns, const Eigen::Isometry3d& T) {
  Message message;
  message.type = "TRANSFORM";
  message.device = device;
  message.stamp_ns = stamp_ns;
  Eigen::Matrix4d matrix_mm = T.matrix();
  matrix_mm.topRightCorner<3, 1>() *= 1000;
  message.content = transformContent(matrix_mm);
  return message;
}

ToolBoard board(std::vector<ToolSettings> tools) {
  ToolBoardSettings settings;
  settings.tools = std::move(tools);
  return ToolBoard(settings, LinkSpace(Axes::kRas, Axes::kRas));
}

const Eigen::Isometry3d kPose = pose(0.4, 10, -20, 300);

TEST(ToolBoard, TakesOffTheLatency) {
  ToolBoard tools = board({{"M", "reference", "microscope", 0.03}});
  const auto poses = tools.receive(1, transform("M", kNow, kPose), kNow + kMs);
  ASSERT_EQ(poses.size(), 1u);
  EXPECT_EQ(poses[0].stamp_ns, kNow - 30 * kMs);
  EXPECT_EQ(poses[0].parent, "reference");
  EXPECT_TRUE(poses[0].T_parent_child.isApprox(kPose, 1e-6));
  EXPECT_EQ(tools.report(kNow)[0].status, ToolStatus::kOk);
}

TEST(ToolBoard, SaysUnderWhichNamesPosesComeWhereTheConfiguredOneIsNotHeard) {
  ToolBoard tools = board({{"MicroscopeToReferen", "reference", "microscope", 0}});
  EXPECT_EQ(tools.report(kNow)[0].reason, "the device has sent nothing");
  tools.receive(1, transform("Scope", kNow, kPose), kNow);
  tools.receive(1, transform("MicroscopeToReference", kNow, kPose), kNow);
  EXPECT_EQ(
      tools.report(kNow)[0].reason,
      "the device has sent nothing; poses come under names that are not configured: MicroscopeToReference, Scope; "
      "set `device` of the tool to the name that is sent");
  for (int i = 0; i < 1000; ++i) tools.receive(1, transform("T" + std::to_string(i), kNow, kPose), kNow);
  EXPECT_LT(tools.report(kNow)[0].reason.size(), 700u);
  tools.receive(1, transform("MicroscopeToReferen", kNow, kPose), kNow);
  EXPECT_EQ(tools.report(kNow)[0].status, ToolStatus::kOk);
}

TEST(ToolBoard, SaysWhatIsWrong) {
  ToolBoard tools = board({{"M", "reference", "microscope", 0}});
  EXPECT_EQ(tools.report(kNow)[0].status, ToolStatus::kNeverSeen);
  EXPECT_TRUE(std::isnan(tools.report(kNow)[0].age));
  const auto refused = [&](const Message& message, const std::string& reason) {
    EXPECT_TRUE(tools.receive(1, message, kNow).empty()) << reason;
    EXPECT_EQ(tools.report(kNow)[0].status, ToolStatus::kInvalid) << reason;
    EXPECT_NE(tools.report(kNow)[0].reason.find(reason), std::string::npos) << tools.report(kNow)[0].reason;
  };
  refused(transform("M", 0, kPose), "no time stamp");
  refused(transform("M", kNow - 600 * kMs, kPose), "synchronise the clocks");
  refused(transform("M", kNow + 600 * kMs, kPose), "synchronise the clocks");
  Eigen::Isometry3d scaled = kPose;
  scaled.linear() *= 1.001;
  refused(transform("M", kNow, scaled), "not a rigid transform");
  Message hidden = transform("M", kNow + 1, kPose);
  hidden.metadata["Status"] = "INVALID";
  refused(hidden, "the device says INVALID");
  Message status;
  status.type = "STATUS";
  status.device = "M";
  status.content.assign(30, 0);
  status.content[1] = 16;
  refused(status, "status 16");
  EXPECT_EQ(tools.receive(1, transform("M", kNow + 2, kPose), kNow).size(), 1u);
  EXPECT_EQ(tools.report(kNow)[0].status, ToolStatus::kOk);
  EXPECT_EQ(tools.report(kNow + 300 * kMs)[0].status, ToolStatus::kStale);
}

TEST(ToolBoard, OldSamplesAreNoNews) {
  ToolBoard tools = board({{"M", "reference", "microscope", 0}});
  EXPECT_EQ(tools.receive(1, transform("M", kNow, kPose), kNow).size(), 1u);
  EXPECT_TRUE(tools.receive(1, transform("M", kNow, kPose), kNow).empty());
  EXPECT_TRUE(tools.receive(1, transform("M", kNow - kMs, kPose), kNow).empty());
  EXPECT_EQ(tools.report(kNow)[0].repeated, 2u);
}

TEST(ToolBoard, OneSenderPerTool) {
  ToolBoard tools = board({{"M", "reference", "microscope", 0}});
  EXPECT_EQ(tools.receive(1, transform("M", kNow, kPose), kNow).size(), 1u);
  EXPECT_TRUE(tools.receive(2, transform("M", kNow + 1, kPose), kNow).empty());
  EXPECT_EQ(tools.report(kNow)[0].status, ToolStatus::kOk);
  EXPECT_EQ(tools.report(kNow)[0].rejected, 1u);
  tools.peerLeft(1);
  EXPECT_EQ(tools.receive(2, transform("M", kNow + 2, kPose), kNow).size(), 1u);
}

TEST(ToolBoard, TrackerFramePosesNeedTheReferenceOfTheirTime) {
  ToolBoard tools = board({{"R", "tracker", "reference", 0}, {"M", "tracker", "microscope", 0}});
  const Eigen::Isometry3d T_tracker_reference = pose(1.1, 100, 200, -1500),
                          T_tracker_microscope = pose(-0.6, 80, 150, -1200);
  const Eigen::Isometry3d expected = T_tracker_reference.inverse() * T_tracker_microscope;
  for (const bool reference_first : {true, false}) {
    const std::int64_t stamp_ns = kNow + (reference_first ? 0 : 20 * kMs);
    const Message reference = transform("R", stamp_ns, T_tracker_reference),
                  tool = transform("M", stamp_ns, T_tracker_microscope);
    EXPECT_TRUE(tools.receive(1, reference_first ? reference : tool, stamp_ns).empty());
    const auto poses = tools.receive(1, reference_first ? tool : reference, stamp_ns);
    ASSERT_EQ(poses.size(), 1u);
    EXPECT_EQ(poses[0].parent, "reference");
    EXPECT_LT((poses[0].T_parent_child.matrix() - expected.matrix()).cwiseAbs().maxCoeff(), 1e-6);
  }
  // The reference is hidden: the microscope alone gives no pose.
  EXPECT_TRUE(tools.receive(1, transform("M", kNow + 40 * kMs, T_tracker_microscope), kNow + 40 * kMs).empty());
  EXPECT_TRUE(tools.receive(1, transform("M", kNow + 60 * kMs, T_tracker_microscope), kNow + 60 * kMs).empty());
  EXPECT_EQ(tools.report(kNow + 60 * kMs)[1].status, ToolStatus::kInvalid);
  EXPECT_NE(tools.report(kNow + 60 * kMs)[1].reason.find("reference"), std::string::npos);
}

TEST(ToolBoard, RegistrationEitherWayRound) {
  for (const bool inverse : {false, true}) {
    ToolBoard tools = inverse ? board({{"P", "reference", "pmr", 0}}) : board({{"P", "pmr", "reference", 0}});
    const auto poses = tools.receive(1, transform("P", kNow, inverse ? kPose.inverse() : kPose), kNow);
    ASSERT_EQ(poses.size(), 1u);
    EXPECT_EQ(poses[0].parent, "pmr");
    EXPECT_EQ(poses[0].child, "reference");
    EXPECT_LT((poses[0].T_parent_child.matrix() - kPose.matrix()).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_EQ(tools.report(kNow + 3600 * 1000 * kMs)[0].status, ToolStatus::kOk);
  }
}

TEST(ToolBoard, RefusesImpossibleSettings) {
  EXPECT_THROW(board({{"", "reference", "microscope", 0}}), std::invalid_argument);
  EXPECT_THROW(board({{std::string(21, 'x'), "reference", "microscope", 0}}), std::invalid_argument);
  EXPECT_THROW(board({{"M", "world", "microscope", 0}}), std::invalid_argument);
  EXPECT_THROW(board({{"M", "reference", "reference", 0}}), std::invalid_argument);
  EXPECT_THROW(board({{"M", "pmr", "microscope", 0}}), std::invalid_argument);
  EXPECT_THROW(board({{"M", "tracker", "microscope", 0}}), std::invalid_argument);
  EXPECT_THROW(board({{"M", "reference", "microscope", 2}}), std::invalid_argument);
  EXPECT_THROW(board({{"M", "reference", "microscope", 0}, {"M", "reference", "probe_tip", 0}}), std::invalid_argument);
  EXPECT_THROW(board({{"M", "reference", "microscope", 0}, {"N", "reference", "microscope", 0}}),
               std::invalid_argument);
}

}  // namespace
}  // namespace cortshift_tracking::igt
