// Whole-pixel motions are found as they are, either way, whatever the brightness.
#include "start/coarse_search.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "textures.hpp"

namespace cortshift_flow {
namespace {

const cv::Size kSize(90, 64);

/// `image` moved by (u, v): what is seen at x in the first is at x + (u, v) in the result; new texture comes in.
cv::Mat4f moved(const cv::Mat4f& image, int u, int v) {
  cv::Mat4f out = grains(image.size(), 99);
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols; ++x)
      if (x - u >= 0 && y - v >= 0 && x - u < image.cols && y - v < image.rows) out(y, x) = image(y - v, x - u);
  return out;
}

double shareOf(const FlowPlanes& flow, float u, float v, int border) {
  int right = 0, all = 0;
  for (int y = border; y < flow.u.height() - border; ++y)
    for (int x = border; x < flow.u.width() - border; ++x, ++all)
      right += std::abs(flow.u.row(y)[x] - u) < 0.01f && std::abs(flow.v.row(y)[x] - v) < 0.01f;
  return static_cast<double>(right) / all;
}

TEST(CoarseSearch, FindsEveryDisplacementWithinItsRadiusBothWays) {
  const cv::Mat4f first = grains(kSize, 1);
  for (const auto& [u, v] : {std::pair(7, -5), std::pair(-8, 8), std::pair(0, 3), std::pair(8, 0)}) {
    const SearchResult found = searchCoarseFlow({first, moved(first, u, v), {}, {}}, 8, 1);
    EXPECT_GT(shareOf(found.forward, static_cast<float>(u), static_cast<float>(v), 12), 0.99) << u << " " << v;
    EXPECT_GT(shareOf(found.backward, static_cast<float>(-u), static_cast<float>(-v), 12), 0.99) << u << " " << v;
  }
}

TEST(CoarseSearch, NeitherGainNorOffsetMisleads) {
  const cv::Mat4f first = grains(kSize, 1);
  const cv::Mat4f second(0.6 * moved(first, 5, -2) + cv::Scalar::all(0.2));
  EXPECT_GT(shareOf(searchCoarseFlow({first, second, {}, {}}, 6, 1).forward, 5, -2, 12), 0.99);
}

// Left and right, up and down are treated alike: mirrored images give the mirrored flow, even in noise that hides most
// of the motion.
TEST(CoarseSearch, MirroredImagesGiveTheMirroredFlow) {
  const cv::Mat4f first = grains(kSize, 1);
  const cv::Mat4f second(0.5 * moved(first, 3, 1) + 0.5 * grains(kSize, 5));
  const FlowPlanes flow = searchCoarseFlow({first, second, {}, {}}, 5, 1).forward;
  for (const int axis : {0, 1}) {
    cv::Mat a, b;
    cv::flip(first, a, axis);
    cv::flip(second, b, axis);
    const FlowPlanes other = searchCoarseFlow({a, b, {}, {}}, 5, 1).forward;
    int same = 0;
    for (int y = 0; y < kSize.height; ++y)
      for (int x = 0; x < kSize.width; ++x) {
        const int mx = axis == 1 ? kSize.width - 1 - x : x, my = axis == 0 ? kSize.height - 1 - y : y;
        const float su = axis == 1 ? -1.f : 1.f, sv = axis == 0 ? -1.f : 1.f;
        same +=
            std::hypot(flow.u.row(y)[x] - su * other.u.row(my)[mx], flow.v.row(y)[x] - sv * other.v.row(my)[mx]) < 0.5f;
      }
    EXPECT_GT(same, 0.97 * kSize.area()) << axis;
  }
}

TEST(CoarseSearch, MasksAndThreadsDoNotMatterToWhatIsSeen) {
  const cv::Mat4f first = grains(kSize, 1), second = moved(first, 4, 2);
  cv::Mat1b valid(kSize, uchar{1});
  valid(cv::Rect(30, 20, 12, 12)) = 0;
  Level level{first, second, valid, {}};
  const FlowPlanes one = searchCoarseFlow(level, 6, 1).forward, three = searchCoarseFlow(level, 6, 3).forward;
  EXPECT_GT(shareOf(one, 4, 2, 12), 0.9);
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x) EXPECT_EQ(one.u.row(y)[x], three.u.row(y)[x]);
}

// Where nothing matches, no motion is not a match: it is that of the surroundings.
TEST(CoarseSearch, TheMotionAroundFillsWhatShowsNothing) {
  const cv::Mat4f first = grains(kSize, 1), second = moved(first, 4, 2);
  cv::Mat1b first_valid(kSize, uchar{1}), second_valid(kSize, uchar{1});
  first_valid(cv::Rect(32, 20, 24, 24)) = 0;
  second_valid(cv::Rect(36, 22, 24, 24)) = 0;
  const SearchResult found = searchCoarseFlow({first, second, first_valid, second_valid}, 6, 1);
  for (int y = 26; y < 38; ++y)
    for (int x = 40; x < 48; ++x) {
      EXPECT_NEAR(found.forward.u.row(y)[x], 4, 0.3) << x << " " << y;
      EXPECT_NEAR(found.forward.v.row(y)[x], 2, 0.3) << x << " " << y;
      EXPECT_NEAR(found.backward.u.row(y)[x], -4, 0.3) << x << " " << y;
    }
}

}  // namespace
}  // namespace cortshift_flow
