// What computeFlow promises whatever the images: determinism, masks, sizes, types, errors.
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>
#include <thread>

#include "cortshift_flow/flo_file.hpp"
#include "cortshift_flow/flow.hpp"
#include "small_phantom.hpp"

namespace cortshift_flow {
namespace {

using cortshift_flow_phantom::PlanarPhantom;
using cortshift_flow_test::sameBits;
using cortshift_flow_test::small;

bool finite(const cv::Mat& image) { return cv::checkRange(image); }

template <typename Call>
std::string refusal(const Call& call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

#define EXPECT_REFUSAL(call, about) EXPECT_NE(refusal([&] { call; }).find(about), std::string::npos) << #call

class EveryPreset : public testing::TestWithParam<std::string> {};

TEST_P(EveryPreset, TwoAtTheSameTimeGiveTheSameBits) {
  const PlanarPhantom& p = small();
  const FlowSettings settings = FlowSettings::preset(GetParam());
  const FlowResult alone = computeFlow(p.first, p.second, {}, settings);
  FlowResult one;
  std::thread beside([&] { one = computeFlow(p.first, p.second, {}, settings); });
  const FlowResult other = computeFlow(p.first, p.second, {}, settings);
  beside.join();
  EXPECT_TRUE(sameBits(alone.flow, one.flow) && sameBits(alone.flow, other.flow));
}

TEST_P(EveryPreset, IdenticalImagesDoNotMove) {
  const PlanarPhantom& p = small();
  const FlowResult result = computeFlow(p.first, p.first, {}, FlowSettings::preset(GetParam()));
  EXPECT_EQ(cv::countNonZero(result.flow.reshape(1) != 0), 0);
}

TEST_P(EveryPreset, WorksOnTinyAndNarrowImages) {
  for (const cv::Size size : {cv::Size(16, 16), cv::Size(17, 16), cv::Size(16, 200), cv::Size(301, 19)}) {
    cv::Mat first(size, CV_8UC3), second(size, CV_8UC3);
    cv::RNG random(5);
    random.fill(first, cv::RNG::UNIFORM, 0, 256);
    random.fill(second, cv::RNG::UNIFORM, 0, 256);
    const FlowResult result = computeFlow(first, second, {}, FlowSettings::preset(GetParam()));
    EXPECT_EQ(result.flow.size(), size);
    EXPECT_EQ(result.flow.type(), CV_32FC2);
    EXPECT_EQ(result.confidence.type(), CV_32FC1);
    EXPECT_TRUE(finite(result.flow)) << size;
  }
}

TEST_P(EveryPreset, ConstantImagesDoNotMove) {
  const cv::Mat first(64, 80, CV_8UC1, cv::Scalar(90));
  const FlowResult result = computeFlow(first, first.clone(), {}, FlowSettings::preset(GetParam()));
  EXPECT_EQ(cv::countNonZero(result.flow.reshape(1) != 0), 0);
}

TEST_P(EveryPreset, WhatIsMaskedDoesNotMatter) {
  const PlanarPhantom& p = small();
  cv::Mat mask(p.first.size(), CV_8UC1, cv::Scalar(255)), second_mask = mask.clone();
  cv::circle(mask, {200, 120}, 30, cv::Scalar(0), -1);
  cv::circle(second_mask, {120, 90}, 25, cv::Scalar(0), -1);
  cv::Mat first = p.first.clone(), second = p.second.clone();
  cv::RNG random(9);
  cv::Mat garbage(first.size(), first.type());
  random.fill(garbage, cv::RNG::UNIFORM, 0, 256);
  garbage.copyTo(first, mask == 0);
  garbage.copyTo(second, second_mask == 0);
  const FlowSettings settings = FlowSettings::preset(GetParam());
  const FlowResult clean = computeFlow(p.first, p.second, mask, second_mask, settings);
  const FlowResult soiled = computeFlow(first, second, mask, second_mask, settings);
  EXPECT_TRUE(sameBits(clean.flow, soiled.flow));
  EXPECT_TRUE(sameBits(clean.confidence, soiled.confidence));
  EXPECT_EQ(cv::norm(clean.confidence, cv::NORM_INF, mask == 0), 0);
  EXPECT_TRUE(finite(clean.flow));
}

INSTANTIATE_TEST_SUITE_P(Presets, EveryPreset, testing::Values("default", "fast", "ji2014"));

TEST(Images, OfEveryDepthAndChannelCountGiveTheSameFlow) {
  const PlanarPhantom& p = small();
  cv::Mat grey_first, grey_second;
  cv::cvtColor(p.first, grey_first, cv::COLOR_BGR2GRAY);
  cv::cvtColor(p.second, grey_second, cv::COLOR_BGR2GRAY);
  for (const auto& [first, second] : {std::pair(p.first, p.second), std::pair(grey_first, grey_second)}) {
    const cv::Mat expected = computeFlow(first, second).flow;
    cv::Mat first16, second16, first32, second32;
    first.convertTo(first16, CV_16U, 257);
    second.convertTo(second16, CV_16U, 257);
    first.convertTo(first32, CV_32F, 1 / 255.0);
    second.convertTo(second32, CV_32F, 1 / 255.0);
    const auto medianGap = [&](const cv::Mat& flow) {
      std::vector<float> gaps;
      for (int y = 0; y < flow.rows; ++y)
        for (int x = 0; x < flow.cols; ++x)
          gaps.push_back(static_cast<float>(cv::norm(flow.at<cv::Vec2f>(y, x) - expected.at<cv::Vec2f>(y, x))));
      std::nth_element(gaps.begin(), gaps.begin() + static_cast<std::ptrdiff_t>(gaps.size() / 2), gaps.end());
      return gaps[gaps.size() / 2];
    };
    EXPECT_LT(medianGap(computeFlow(first16, second16).flow), 1e-3);
    EXPECT_LT(medianGap(computeFlow(first32, second32).flow), 1e-3);
  }
}

TEST(Images, NotANumberIsTreatedAsExcluded) {
  const PlanarPhantom& p = small();
  cv::Mat first, second;
  p.first.convertTo(first, CV_32F, 1 / 255.0);
  p.second.convertTo(second, CV_32F, 1 / 255.0);
  first(cv::Rect(100, 100, 20, 20)).setTo(std::numeric_limits<float>::quiet_NaN());
  second(cv::Rect(30, 60, 10, 30)).setTo(std::numeric_limits<float>::infinity());
  const FlowResult result = computeFlow(first, second);
  EXPECT_TRUE(finite(result.flow));
  EXPECT_TRUE(finite(result.confidence));
  EXPECT_EQ(result.confidence.at<float>(110, 110), 0);
}

TEST(Errors, NameWhatIsWrong) {
  const cv::Mat image(32, 32, CV_8UC3, cv::Scalar::all(100));
  EXPECT_REFUSAL(computeFlow(cv::Mat(), image), "empty");
  EXPECT_REFUSAL(computeFlow(image, cv::Mat(32, 40, CV_8UC3, cv::Scalar::all(1))), "size");
  EXPECT_REFUSAL(computeFlow(image, cv::Mat(32, 32, CV_8UC1, cv::Scalar(1))), "type");
  EXPECT_REFUSAL(computeFlow(cv::Mat(32, 32, CV_8UC2), cv::Mat(32, 32, CV_8UC2)), "channels");
  EXPECT_REFUSAL(computeFlow(cv::Mat(32, 32, CV_64F), cv::Mat(32, 32, CV_64F)), "depth");
  EXPECT_REFUSAL(computeFlow(cv::Mat(8, 32, CV_8U), cv::Mat(8, 32, CV_8U)), "16");
  EXPECT_REFUSAL(computeFlow(image, image, cv::Mat(32, 31, CV_8UC1, cv::Scalar(1))), "mask");
  EXPECT_REFUSAL(computeFlow(image, image, cv::Mat(32, 32, CV_32F, cv::Scalar(1))), "mask");
  EXPECT_REFUSAL(computeFlow(image, image, cv::Mat::zeros(32, 32, CV_8UC1)), "excludes every pixel");
  const cv::Mat nothing(32, 32, CV_32FC1, cv::Scalar(std::numeric_limits<float>::quiet_NaN()));
  EXPECT_REFUSAL(computeFlow(nothing, nothing), "finite");
}

class SettingsFile : public testing::Test {
 protected:
  std::string write(const std::string& text) {
    const std::string path = testing::TempDir() + "cortshift_flow_settings.yaml";
    std::ofstream(path) << text;
    return path;
  }
};

TEST_F(SettingsFile, ChoosesAPresetAndChangesIt) {
  const FlowSettings settings = readSettings(write("preset: ji2014\nalpha: 0.05\nthreads: 1\n"));
  EXPECT_EQ(settings.method, Method::kVariational);
  EXPECT_EQ(settings.alpha, 0.05);
  EXPECT_EQ(settings.threads, 1);
  EXPECT_EQ(settings.epsilon, FlowSettings::preset("ji2014").epsilon);
}

TEST_F(SettingsFile, RefusesWhatItDoesNotKnow) {
  EXPECT_REFUSAL(readSettings(write("alhpa: 0.05\n")), "alhpa");
  EXPECT_REFUSAL(readSettings(write("alpha: -1\n")), "alpha = -1");
  EXPECT_REFUSAL(readSettings(write("outer_iterations: 2.5\n")), "outer_iterations");
  EXPECT_REFUSAL(readSettings(write("preset: best\n")), "best");
  EXPECT_THROW(readSettings(write("") + "/no folder.yaml"), std::runtime_error);
}

TEST(FloFile, RoundTrip) {
  cv::Mat flow(7, 5, CV_32FC2);
  cv::RNG random(1);
  random.fill(flow, cv::RNG::UNIFORM, -50, 50);
  const std::string path = testing::TempDir() + "cortshift_flow_round_trip.flo";
  writeFlo(path, flow);
  EXPECT_TRUE(sameBits(readFlo(path), flow));
  std::ofstream(path, std::ios::trunc) << "PIEH";
  EXPECT_THROW(readFlo(path), std::runtime_error);
}

/// Found by script/fuzz: a header alone made the reader ask for its four gigabytes before it looked whether they are
/// there.
TEST(FloFile, AHeaderAloneAsksForNoMemory) {
  const std::string path = testing::TempDir() + "cortshift_flow_header.flo";
  const char header[] = {'P', 'I', 'E', 'H', 0x40, 0x40, 0, 0, 0, char(0x80), 0, 0};
  std::ofstream(path, std::ios::binary | std::ios::trunc).write(header, sizeof header);
  rlimit before{}, little{};
  ASSERT_EQ(getrlimit(RLIMIT_AS, &before), 0);
  little = {rlim_t(3) << 30, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_AS, &little), 0);
  EXPECT_THROW(readFlo(path), std::runtime_error);  // and not what OpenCV throws where there is no memory
  EXPECT_EQ(setrlimit(RLIMIT_AS, &before), 0);
}

}  // namespace
}  // namespace cortshift_flow

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
