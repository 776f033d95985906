// Masks and levels: exactly the pixels that an excluded one reaches are lost.
#include "images/prepare.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "start/rough_flow.hpp"
#include "textures.hpp"

namespace cortshift_flow {
namespace {

const cv::Size kSize(41, 31);  // odd, so that a half is rounded up

Level plain() { return {grains(kSize, 1), grains(kSize, 2), cv::Mat1b(kSize, uchar{1}), cv::Mat1b(kSize, uchar{1})}; }

TEST(Halve, LosesTheCoarsePixelsWhoseFiveByFiveHoldsAnExcludedOne) {
  for (const cv::Point excluded : {cv::Point(20, 14), cv::Point(21, 15), cv::Point(0, 0), cv::Point(40, 30)}) {
    Level level = plain();
    level.first_valid(excluded) = 0;
    const Level coarse = halve(level, 1);
    EXPECT_EQ(coarse.first.size(), cv::Size(21, 16));
    EXPECT_EQ(cv::countNonZero(coarse.second_valid), 21 * 16);
    for (int y = 0; y < coarse.first_valid.rows; ++y)
      for (int x = 0; x < coarse.first_valid.cols; ++x) {
        const bool reached = std::abs(2 * x - excluded.x) <= 2 && std::abs(2 * y - excluded.y) <= 2;
        EXPECT_EQ(coarse.first_valid(y, x), reached ? 0 : 1) << x << " " << y << " of " << excluded;
      }
  }
}

TEST(Halve, KeepsARampAndLiesOnTheEvenPixels) {
  Level level = plain();
  level.first = imageOf(kSize, [](float x, float y) { return 0.01f * x + 0.02f * y; });
  const cv::Mat4f coarse = halve(level, 1).first;
  for (int y = 1; y + 1 < coarse.rows; ++y)
    for (int x = 1; x + 1 < coarse.cols; ++x)
      EXPECT_NEAR(coarse(y, x)[1], 0.01 * 2 * x + 0.02 * 2 * y, 1e-6) << x << " " << y;
}

TEST(Interpolable, LosesTheCellsWhoseSixBySixHoldsAnExcludedPixel) {
  cv::Mat1b valid(kSize, uchar{1});
  const cv::Point excluded(20, 14);
  valid(excluded) = 0;
  const cv::Mat1b result = interpolable(valid);
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x) {
      // Cell (x, y) reads pixels x - 2...x + 3.
      const bool reached = excluded.x - x >= -2 && excluded.x - x <= 3 && excluded.y - y >= -2 && excluded.y - y <= 3;
      EXPECT_EQ(result(y, x), reached ? 0 : 1) << x << " " << y;
    }
  EXPECT_TRUE(interpolable({}).empty());
}

TEST(PrepareImages, ScalesEveryDepthAndRepeatsGrey) {
  const cv::Mat grey8(kSize, CV_8UC1, cv::Scalar(51)), grey16(kSize, CV_16UC1, cv::Scalar(13107));
  EXPECT_NEAR(prepareImages(grey8, grey8, {}, {}, 1).first(5, 5)[2], 0.2, 1e-6);
  EXPECT_NEAR(prepareImages(grey16, grey16, {}, {}, 1).second(5, 5)[0], 0.2, 1e-6);
  const cv::Mat colour(kSize, CV_8UC3, cv::Scalar(51, 102, 153));
  const cv::Vec4f value = prepareImages(colour, colour, {}, {}, 1).first(5, 5);
  EXPECT_NEAR(value[0], 0.2, 1e-6);
  EXPECT_NEAR(value[1], 0.4, 1e-6);
  EXPECT_NEAR(value[2], 0.6, 1e-6);
  EXPECT_EQ(value[3], 0);
}

TEST(PrepareImages, FillsWhatIsNotFiniteOrMaskedAndSaysSo) {
  cv::Mat image(kSize, CV_32FC3, cv::Scalar::all(0.25)), mask(kSize, CV_8UC1, cv::Scalar(255));
  image.at<cv::Vec3f>(10, 12)[1] = std::numeric_limits<float>::quiet_NaN();
  mask.at<uchar>(3, 4) = 0;
  const Level level = prepareImages(image, image, mask, {}, 1);
  EXPECT_EQ(level.first_valid(10, 12), 0);
  EXPECT_EQ(level.first_valid(3, 4), 0);
  EXPECT_EQ(level.second_valid(3, 4), 1);
  EXPECT_EQ(cv::countNonZero(level.first_valid), kSize.area() - 2);
  EXPECT_NEAR(level.first(10, 12)[1], 0.25, 1e-4);
}

TEST(SearchPyramid, EndsBelowTwiceTheSideOfTheSearch) {
  const auto sides = [](int side) {
    Level level;
    level.first = level.second = cv::Mat4f(side, side + 100, cv::Vec4f::all(0));
    std::vector<int> rows;
    for (const Level& l : searchPyramid(level, 1)) rows.push_back(l.first.rows);
    return rows;
  };
  EXPECT_EQ(sides(192), (std::vector<int>{192, 96, 48}));
  EXPECT_EQ(sides(190), (std::vector<int>{190, 95}));
  EXPECT_EQ(sides(40), (std::vector<int>{40, 20}));
}

}  // namespace
}  // namespace cortshift_flow
