// Which rectification a setting gets, which setting a pair has, and the gathering of pairs for a mean; no master
// needed.
#include <cortshift_msgs/MicroscopeSettings.h>
#include <gmock/gmock.h>

#include <boost/make_shared.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <thread>

#include "analytic_scene.hpp"
#include "cortshift_stereo/averaging/frame_collector.hpp"
#include "cortshift_stereo/rectification/rectifier_selector.hpp"
#include "cortshift_stereo/ros/stamped_history.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_stereo_test::AnalyticScene;
using testing::HasSubstr;

/// A field that magnifies about the image's middle, calibrated from 0.8 to 1.25 at 0.25 to 0.35 m.
SettingsWarp zoomWarp(const cv::Size& size) {
  WarpModel model;
  model.size = size;
  model.reference = {1, 0.3};
  model.setting_scale = {0.25, 1};
  model.centre = {0.5 * (size.width - 1), 0.5 * (size.height - 1)};
  model.radius = 100;
  model.image_powers = {{1, 0}, {0, 1}};
  model.setting_powers = {{1, 0}};
  model.coefficients = {{25, 0}, {0, 25}};  // [px] at 100 px from the middle at magnification 1.25
  model.calibrated = {{0.8, 0.25}, {1.25, 0.25}, {0.8, 0.35}, {1.25, 0.35}, {1, 0.3}};
  const double w = size.width, h = size.height;
  model.region = {{0, 0}, {w, 0}, {w, h}, {0, h}};
  return SettingsWarp(model);
}

std::shared_ptr<const SettingsFields> fieldsOf(const cv::Size& size) {
  return std::make_shared<const SettingsFields>(SettingsFields{zoomWarp(size), zoomWarp(size)});
}

std::string refusal(RectifierSelector& selector, const MicroscopeSetting& setting) {
  try {
    selector.at(setting);
    return "accepted";
  } catch (const PairError& error) {
    EXPECT_EQ(error.reason(), "settings");
    return error.what();
  }
}

TEST(RectifierSelector, withoutFieldsOnlyTheReferenceIsUsed) {
  RectifierSelector selector(nullptr, MicroscopeSetting{1, 0.3}, 0.005);
  EXPECT_THROW(selector.at(std::nullopt), CalibrationError);
  selector.calibrate(AnalyticScene().model());
  const auto reference = selector.at(std::nullopt);
  EXPECT_EQ(selector.at(MicroscopeSetting{1.004, 0.3}), reference);
  EXPECT_THAT(refusal(selector, {1.01, 0.3}), HasSubstr("calibrated is only magnification 1, focal length 300 mm"));
  EXPECT_EQ(selector.at(std::nullopt), reference) << "a refusal must not forget";
}

TEST(RectifierSelector, theFirstSettingIsTheReferenceWhereNoneIsGiven) {
  RectifierSelector selector(nullptr, std::nullopt, 0.005);
  selector.calibrate(AnalyticScene().model());
  EXPECT_NO_THROW(selector.at(MicroscopeSetting{2, 0.25}));
  EXPECT_THAT(refusal(selector, {1, 0.3}), HasSubstr("magnification 2"));
  selector.calibrate(AnalyticScene().model());  // another calibration, another reference
  EXPECT_NO_THROW(selector.at(MicroscopeSetting{1, 0.3}));
}

TEST(RectifierSelector, fieldsCompensateWhatTheyCoverAndNothingElse) {
  const StereoModel model = AnalyticScene().model();
  RectifierSelector selector(fieldsOf(model.left.size), std::nullopt, 0.005);
  selector.calibrate(model);
  const auto reference = selector.at(std::nullopt), zoomed = selector.at(MicroscopeSetting{1.25, 0.3});
  EXPECT_EQ(selector.at(MicroscopeSetting{1.25, 0.3}), zoomed) << "made once";
  // At magnification 1.25 an image shows 1 / 1.25 of the reference's width and height.
  EXPECT_NEAR(zoomed->leftShare() / reference->leftShare(), 0.64, 0.03);
  EXPECT_EQ(cv::norm(zoomed->leftMap(), reference->leftMap(), cv::NORM_INF), 0) << "positions at the reference";
  EXPECT_THAT(refusal(selector, {1.3, 0.3}), HasSubstr("magnification 0.8 to 1.25, focal length 250 to 350 mm"));
  EXPECT_THAT(refusal(selector, {1, 0.4}), HasSubstr("focal length 400 mm"));
  EXPECT_THAT(refusal(selector, {std::nan(""), 0.3}), HasSubstr("magnification nan"));
}

TEST(RectifierSelector, refusesFieldsOfAnotherCalibration) {
  const StereoModel model = AnalyticScene().model();
  EXPECT_THROW(RectifierSelector(fieldsOf(model.left.size), MicroscopeSetting{1.5, 0.3}, 0.005), CalibrationError);
  RectifierSelector selector(fieldsOf({640, 480}), std::nullopt, 0.005);
  selector.calibrate(model);
  EXPECT_THROW(selector.at(MicroscopeSetting{1.1, 0.3}), CalibrationError);  // another image size
  StereoModel bad = model;
  bad.right.P(0, 3) = 0;
  EXPECT_THROW(selector.calibrate(bad), CalibrationError);
  EXPECT_THROW(selector.at(std::nullopt), CalibrationError) << "the calibration before must not hold on";
}

TEST(Reconstruction, coverageIsOfThePartInView) {
  AnalyticScene scene;
  const StereoModel model = scene.model();
  // Images taken at magnification 1.25, made from those at the reference.
  const auto zoomed = [](const cv::Mat& image) {
    cv::Mat out;
    const cv::Point2d middle(0.5 * (image.cols - 1), 0.5 * (image.rows - 1));
    cv::warpAffine(image, out, cv::Matx23d(1.25, 0, -0.25 * middle.x, 0, 1.25, -0.25 * middle.y), image.size(),
                   cv::INTER_CUBIC);
    return out;
  };
  ReconstructionSettings settings;
  settings.limits.min_sharpness = 0;  // enlarged
  const auto plain = reconstruct(scene.left(), scene.right(), Rectifier(model), settings);
  const auto warped = reconstruct(zoomed(scene.left()), zoomed(scene.right()),
                                  Rectifier(model, *fieldsOf(model.left.size), {1.25, 0.3}), settings);
  EXPECT_NEAR(warped.quality.coverage, plain.quality.coverage, 0.1);
  cv::Mat difference = cv::abs(plain.disparity - warped.disparity);
  std::vector<float> known;
  for (const float d : cv::Mat_<float>(difference))
    if (std::isfinite(d)) known.push_back(d);
  ASSERT_GT(known.size(), difference.total() / 3);
  std::nth_element(known.begin(), known.begin() + static_cast<std::ptrdiff_t>(known.size() / 2), known.end());
  EXPECT_LT(known[known.size() / 2], 0.06);  // [px]
}

cortshift_msgs::MicroscopeSettingsConstPtr change(double seconds, double magnification) {
  auto message = boost::make_shared<cortshift_msgs::MicroscopeSettings>();
  message->header.stamp = ros::Time(seconds);
  message->magnification = magnification;
  return message;
}

TEST(StampedHistory, aPairHasTheSettingThatWasInForceWhenItWasTaken) {
  StampedHistory<cortshift_msgs::MicroscopeSettings> history;
  EXPECT_FALSE(history.at(ros::Time(1)));
  history.add(change(10, 1));
  history.add(change(20, 2));
  EXPECT_EQ(history.at(ros::Time(5))->magnification, 1);
  EXPECT_EQ(history.at(ros::Time(19.9))->magnification, 1) << "taken before the microscope was turned";
  EXPECT_EQ(history.at(ros::Time(20))->magnification, 2);
  EXPECT_EQ(history.at(ros::Time(99))->magnification, 2);
  history.add(change(3, 4));  // the recording runs again
  EXPECT_EQ(history.at(ros::Time(30))->magnification, 4);
}

PosedFrame frameAt(double seconds, double x) {
  static const auto rectifier = std::make_shared<const Rectifier>(AnalyticScene().model());
  PosedFrame frame;
  frame.stamp_ns = static_cast<std::int64_t>(1e9 * seconds);
  frame.T_pmr_left.translation() = Eigen::Vector3d(x, 0, 0);
  frame.rectifier = rectifier;
  frame.frame.disparity = cv::Mat(rectifier->model().left.size, CV_32FC1, cv::Scalar(seconds));
  frame.frame.colour = cv::Mat(frame.frame.disparity.size(), CV_8UC3, cv::Scalar::all(100));
  frame.frame.confidence = cv::Mat(frame.frame.disparity.size(), CV_32FC1, cv::Scalar(0.5));
  return frame;
}

TEST(ViewFrames, holdsWhatAgreesWithTheNewest) {
  ViewTolerance tolerance;
  ViewFrames frames(tolerance, 3);
  frames.add(frameAt(1.00, 0));
  frames.add(frameAt(1.02, 0.0003));
  EXPECT_EQ(frames.size(), 2u);
  EXPECT_NEAR(frames.mean().T_pmr_left.translation().x(), 0.00015, 1e-12);
  EXPECT_NEAR(frames.mean().result.disparity.at<float>(100, 100), 1.01, 1e-5);
  frames.add(frameAt(1.04, 0.0007));  // too far from the first
  EXPECT_EQ(frames.size(), 2u);
  frames.add(frameAt(5.0, 0.0007));  // too late
  EXPECT_EQ(frames.size(), 1u);
  PosedFrame other = frameAt(5.1, 0.0007);
  other.rectifier = std::make_shared<const Rectifier>(AnalyticScene().model());  // another setting
  frames.add(other);
  EXPECT_EQ(frames.size(), 1u);
}

TEST(FrameCollector, gathersFramesSinceAStampOrSaysHowManyCame) {
  FrameCollector collector({});
  EXPECT_THROW(collector.await(1, 0, std::chrono::seconds(1)), std::invalid_argument);
  EXPECT_THROW(collector.await(65, 0, std::chrono::seconds(1)), std::invalid_argument);
  collector.offer(frameAt(1, 0));  // nobody waits
  try {
    collector.await(2, 0, std::chrono::milliseconds(50));
    FAIL();
  } catch (const CollectionError& error) {
    EXPECT_THAT(error.what(), HasSubstr("only 0 of 2 pairs of one view came, of 0 pairs in all"));
  }
  std::thread camera([&] {
    for (int i = 0; i < 400; ++i) {
      collector.offer(frameAt(10 + 0.01 * i, i < 105 ? 0.0 : 0.01));
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  });
  const auto gathered = collector.await(4, 11'000'000'000, std::chrono::seconds(20));
  collector.close();
  camera.join();
  EXPECT_EQ(gathered.frames.size(), 4u);
  EXPECT_GE(gathered.last_stamp_ns, 11'030'000'000);
  EXPECT_THROW(collector.await(2, 0, std::chrono::seconds(20)), CollectionError) << "closed";
}

}  // namespace
}  // namespace cortshift_stereo
