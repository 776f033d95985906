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

}  // namespace
}  // namespace cortshift_stereo
