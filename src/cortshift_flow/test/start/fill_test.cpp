// What is not known is continued from what is, in every channel; what is known stays as it is.
#include "start/fill.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace cortshift_flow {
namespace {

const cv::Size kSize(40, 30);
const cv::Vec4f kOneSide(0.2f, 0.5f, 0.8f, 0), kOther(0.6f, 0.3f, 0.4f, 0);

TEST(FillUnknown, ColoursAreContinuedFromBothSidesInEveryChannel) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  cv::Mat4f image(kSize, cv::Vec4f(kNan, kNan, kNan, 0));
  image.colRange(0, 8).setTo(cv::Scalar(kOneSide));
  image.colRange(32, 40).setTo(cv::Scalar(kOther));
  cv::Mat1b valid(kSize, uchar{1});
  valid.colRange(8, 32).setTo(0);
  fillUnknown(image, valid);
  const auto shareOfOther = [&](int x, int c) { return (image(15, x)[c] - kOneSide[c]) / (kOther[c] - kOneSide[c]); };
  for (int c = 0; c < 3; ++c) {
    EXPECT_FLOAT_EQ(image(15, 3)[c], kOneSide[c]);
    EXPECT_FLOAT_EQ(image(15, 36)[c], kOther[c]);
    for (const int x : {9, 20, 30}) EXPECT_NEAR(shareOfOther(x, c), shareOfOther(x, 0), 1e-4) << x << " " << c;
  }
  EXPECT_LT(shareOfOther(9, 0), 0.3);
  EXPECT_GT(shareOfOther(30, 0), 0.6);
  EXPECT_LT(shareOfOther(9, 0), shareOfOther(20, 0));
  EXPECT_LT(shareOfOther(20, 0), shareOfOther(30, 0));
}

TEST(FillUnknown, AFlowIsContinuedAndIsZeroWhereNothingIsKnown) {
  FlowPlanes flow{Plane(kSize, 3.f), Plane(kSize, -1.f)};
  cv::Mat1f weight(kSize, 0.f);
  weight.colRange(0, 10).setTo(1);
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 10; x < kSize.width; ++x) flow.u.row(y)[x] = 50;
  fillUnknown(flow, weight);
  EXPECT_NEAR(flow.u.row(15)[35], 3, 1e-4);
  EXPECT_NEAR(flow.v.row(15)[35], -1, 1e-4);
  fillUnknown(flow, cv::Mat1f(kSize, 0.f));
  EXPECT_EQ(flow.u.row(15)[5], 0);
}

TEST(FillUnknown, OneDoubtfulPixelIsEnough) {
  FlowPlanes flow{Plane(kSize, 3.f), Plane(kSize, -1.f)};
  cv::Mat1f weight(kSize, 0.f);
  weight(4, 7) = 0.2f;
  fillUnknown(flow, weight);
  for (const int x : {0, 7, 39}) {
    EXPECT_NEAR(flow.u.row(4)[x], 3, 1e-5);
    EXPECT_NEAR(flow.v.row(29)[x], -1, 1e-5);
  }
}

}  // namespace
}  // namespace cortshift_flow
