// tf against camera_info, a setting that is not told, clocks, and two images under one name.
#include "cortshift_stereo/admission/rig_evidence.hpp"

#include <gmock/gmock.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "cortshift_stereo/admission/pair_quality.hpp"
#include "cortshift_stereo/admission/pair_synchroniser.hpp"

namespace cortshift_stereo {
namespace {

using testing::HasSubstr;

StereoModel head(double baseline) {
  StereoModel model;
  for (CameraModel* camera : {&model.left, &model.right}) {
    camera->size = {1024, 768};
    camera->R = cv::Matx33d::eye();
    camera->P = cv::Matx34d(3800, 0, 512, 0, 0, 3800, 384, 0, 0, 0, 1, 0);
  }
  model.right.P(0, 3) = -3800 * baseline;
  return model;
}

Eigen::Isometry3d rightAt(double x, double turned = 0) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation().x() = x;
  T.linear() = Eigen::AngleAxisd(turned, Eigen::Vector3d::UnitY()).toRotationMatrix();
  return T;
}

TEST(StereoEdge, TwoTruthsAreRefused) {
  EXPECT_TRUE(checkStereoEdge(head(0.025), rightAt(0.025)).all().empty());
  EXPECT_TRUE(checkStereoEdge(head(0.025), rightAt(0.0253)).all().empty()) << "rounding of two files";
  for (const Eigen::Isometry3d& T : {rightAt(0.0275), rightAt(0.0225), rightAt(-0.025), rightAt(0.025, 0.01)}) {
    const Findings found = checkStereoEdge(head(0.025), T);
    ASSERT_NE(found.refusal(), nullptr);
    EXPECT_EQ(found.refusal()->check, CheckId::kStereoEdge);
    EXPECT_THAT(found.refusal()->sentence(), HasSubstr("not of one calibration"));
  }
}

TEST(Setting, AbsentIsNotTheReference) {
  const MicroscopeSetting set{1.5, 0.3};
  EXPECT_TRUE(checkSettingKnown(set, true).all().empty());
  EXPECT_EQ(checkSettingKnown({}, true).verdict(), Verdict::kRefuse);
  const Findings assumed = checkSettingKnown({}, false);
  EXPECT_EQ(assumed.verdict(), Verdict::kWarn);
  EXPECT_THAT(assumed.warnings().front(), HasSubstr("(nothing on /microscope/settings)"));
  for (const double none : {0.0, -1.0, std::nan(""), static_cast<double>(INFINITY)})
    for (const MicroscopeSetting& said : {MicroscopeSetting{none, 0.3}, MicroscopeSetting{1.5, none}}) {
      EXPECT_EQ(checkSettingKnown(said, true).verdict(), Verdict::kRefuse);
      EXPECT_THAT(checkSettingKnown(said, false).warnings().front(),
                  HasSubstr("(" + describe(said) + " on /microscope/settings); that of the calibration is assumed"));
    }
}

TEST(Clocks, ATrackersThatIsAheadIsRefused) {
  const std::string edge = "reference -> microscope";
  EXPECT_TRUE(checkTrackerClock(edge, {0.01, 0.02, -5}, 0.1).all().empty()) << "one stray stamp";
  EXPECT_TRUE(checkTrackerClock(edge, {-0.45, -0.45}, 0.1).all().empty()) << "clocks agree to that";
  EXPECT_TRUE(checkTrackerClock(edge, {-3.01, -3.02}, -2.9).all().empty()) << "the recorder's clock is 3 s behind";
  const Findings found = checkTrackerClock(edge, {-37, -36.99, -36.98}, 0.1);
  ASSERT_NE(found.refusal(), nullptr);
  EXPECT_EQ(found.refusal()->check, CheckId::kTrackerClock);
  EXPECT_THAT(
      found.refusal()->sentence(),
      HasSubstr("The samples of reference -> microscope come in 36.990 s before the time that they are stamped with"));
}

TEST(Clocks, ALagIsWarnedOfInBothDirections) {
  EXPECT_TRUE(checkLag("The stamp of the pair", 0.1, 0.25, "record time").all().empty());
  EXPECT_THAT(checkLag("The stamp of the pair", 3, 0.25, "record time").warnings().front(),
              HasSubstr("3.000 s behind its record time"));
  EXPECT_THAT(checkLag("The stamp of the pair", -3, 0.25, "record time").warnings().front(),
              HasSubstr("3.000 s ahead of its record time"));
  EXPECT_EQ(checkStamp(0).verdict(), Verdict::kRefuse);
  EXPECT_TRUE(checkStamp(1).all().empty());
}

TEST(Clocks, ACaptureThatHadToWaitSaysSo) {
  EXPECT_TRUE(checkWait(-0.5, 2).all().empty());
  EXPECT_TRUE(checkWait(1.9, 2).all().empty());
  EXPECT_THAT(checkWait(6.8, 2).warnings().front(), HasSubstr("6.8 s after the time that was asked for"));
}

TEST(Pairs, StampsThatAreAlmostTheSameNameTheTolerance) {
  PairSynchroniser<int> pairs(0, 0.5);
  using Side = PairSynchroniser<int>::Side;
  pairs.add(Side::kLeft, 1000000000, 1, 0);
  pairs.add(Side::kRight, 1000012000, 2, 0);
  const auto unpaired = pairs.takeUnpaired(1);
  ASSERT_EQ(unpaired.size(), 2u);
  for (const auto& image : unpaired) EXPECT_THAT(image.message(), HasSubstr("or set sync_tolerance"));
  pairs.add(Side::kLeft, 2000000000, 1, 2);
  pairs.add(Side::kRight, 2100000000, 2, 2);
  for (const auto& image : pairs.takeUnpaired(3)) EXPECT_THAT(image.message(), testing::Not(HasSubstr("or set")));
}

TEST(Images, RawAndCompressedAgreeButForTheLosses) {
  cv::Mat raw(240, 320, CV_8UC3);
  cv::RNG(3).fill(raw, cv::RNG::NORMAL, 120, 60);
  cv::GaussianBlur(raw, raw, {}, 2);
  for (const int quality : {40, 95}) {
    std::vector<uchar> bytes;
    cv::imencode(".jpg", raw, bytes, {cv::IMWRITE_JPEG_QUALITY, quality});
    EXPECT_TRUE(checkSameImage(raw, cv::imdecode(bytes, cv::IMREAD_COLOR), "left").all().empty()) << quality;
  }
  cv::Mat turned, brighter, small;
  cv::flip(raw, turned, 1);
  brighter = raw + cv::Scalar::all(10);
  cv::resize(raw, small, {}, 0.5, 0.5);
  for (const cv::Mat& other : {turned, brighter, small}) {
    const Findings found = checkSameImage(raw, other, "left");
    ASSERT_NE(found.refusal(), nullptr);
    EXPECT_THAT(found.refusal()->sentence(), HasSubstr("two sources publish under one name"));
  }
}

}  // namespace
}  // namespace cortshift_stereo
