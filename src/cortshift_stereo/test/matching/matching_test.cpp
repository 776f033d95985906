// The integer part of the disparity where depth has edges.
#include "cortshift_stereo/matching/matching.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

namespace cortshift_stereo {
namespace {

constexpr int kWall = 6, kCard = 22;  // [px] disparities
const cv::Size kSize(400, 240);
const SearchRange kRange(0, 32);

/// A card with a pole beside it, before a wall; both textured, the wall darker.
struct Room {
  Room() {
    const cv::Mat wall_texture = texture(1, 60), card_texture = texture(2, 150);
    cv::Mat card(kSize, CV_8UC1, cv::Scalar(0));
    cv::circle(card, {200, 120}, 70, cv::Scalar(255), cv::FILLED);
    cv::rectangle(card, cv::Rect(310, 20, kPole, 200), cv::Scalar(255), cv::FILLED);
    truth = cv::Mat(kSize, CV_32FC1, cv::Scalar(kWall));
    truth.setTo(kCard, card);
    left = wall_texture.clone();
    card_texture.copyTo(left, card);
    right = moved(wall_texture, kWall);
    moved(card_texture, kCard).copyTo(right, moved(card, kCard));
    // Hidden from the right camera: wall whose partner lies behind the card.
    const cv::Mat hidden = moved(moved(card, kCard), -kWall) & ~card;
    cv::dilate(card, judged, cv::getStructuringElement(cv::MORPH_ELLIPSE, {17, 17}));
    judged.setTo(0, hidden);
  }

  /// Share of the pixels on and around card and pole that a disparity has wrong.
  double wrong(const cv::Mat& disparity) const {
    const cv::Mat off = cv::abs(disparity - truth) > 2;  // not for NaN
    return share(off);
  }
  double known(const cv::Mat& disparity) const { return share(disparity == disparity); }

  static constexpr int kPole = 9;  // [px]
  cv::Mat left, right, truth, judged;

 private:
  static cv::Mat texture(uint64_t seed, double mean) {
    cv::Mat grains(kSize, CV_32FC1), out;
    cv::RNG random(seed);
    random.fill(grains, cv::RNG::NORMAL, 0, 60);
    cv::GaussianBlur(grains, grains, {}, 1.2);
    grains.convertTo(out, CV_8U, 1, mean);
    return out;
  }
  static cv::Mat moved(const cv::Mat& image, int disparity) {
    cv::Mat out;
    cv::warpAffine(image, out, cv::Matx23d(1, 0, -disparity, 0, 1, 0), image.size(), cv::INTER_NEAREST,
                   cv::BORDER_REPLICATE);
    return out;
  }
  double share(const cv::Mat& mask) const {
    return static_cast<double>(cv::countNonZero(mask & judged)) / cv::countNonZero(judged);
  }
};

TEST(Matching, edgesOfDepthAreWhereTheImageHasThem) {
  const Room room;
  const cv::Mat plain = matchSemiGlobal(room.left, room.right, kRange);
  const cv::Mat settled = matchByStructure(room.left, room.right, kRange);
  EXPECT_GT(room.wrong(plain), 0.01) << "blocks reach across the edge, or there is nothing to mend";
  EXPECT_LT(room.wrong(settled), 0.3 * room.wrong(plain));
  EXPECT_GT(room.known(settled), room.known(plain) - 0.01);
}

/// A wall with poles before it, wide enough that a smooth scene is matched at half resolution.
cv::Mat matchedWithPoles(int poles) {
  const cv::Size size(800, 320);
  const auto texture = [&](uint64_t seed) {
    cv::Mat grains(size, CV_32FC1), out;
    cv::RNG random(seed);
    random.fill(grains, cv::RNG::NORMAL, 0, 60);
    cv::GaussianBlur(grains, grains, {}, 2.4);
    grains.convertTo(out, CV_8U, 2, 100);
    return out;
  };
  const cv::Mat wall = texture(3), pole = texture(4);
  cv::Mat left = wall.clone(), right(size, CV_8UC1);
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x)
      right.at<uint8_t>(y, x) = wall.at<uint8_t>(y, std::min(x + kWall, size.width - 1));
  for (int i = 0; i < poles; ++i) {
    const cv::Rect at(60 + 180 * i, 20, 90, 280);
    pole(at).copyTo(left(at));
    pole(at).copyTo(right(at - cv::Point(kCard, 0)));
  }
  return matchByStructure(left, right, kRange);
}

/// Each value stands in a block of 2 x 2, as after a match at half resolution.
bool atHalfResolution(const cv::Mat& disparity) {
  for (int y = 0; y < disparity.rows; y += 2)
    for (int x = 0; x < disparity.cols; x += 2) {
      const float d = disparity.at<float>(y, x);
      for (const float other : {disparity.at<float>(y, x + 1), disparity.at<float>(y + 1, x)})
        if (!(d == other || (std::isnan(d) && std::isnan(other)))) return false;
    }
  return true;
}

// One pole makes steps beside 0.35 % of the pixels of the half image, two 0.7 %; the limit is 0.5 %.
TEST(Matching, aSceneWithManyEdgesIsMatchedAtFullResolution) {
  EXPECT_TRUE(atHalfResolution(matchedWithPoles(0)));
  EXPECT_TRUE(atHalfResolution(matchedWithPoles(1)));
  EXPECT_FALSE(atHalfResolution(matchedWithPoles(2)));
}

}  // namespace
}  // namespace cortshift_stereo
