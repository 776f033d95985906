// Good pairs under everything that a microscope does to them, and bad ones that must not pass unnoticed.
#pragma once

#include <array>
#include <functional>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "phantom_pair.hpp"

namespace cortshift_stereo_test {

using cortshift_stereo_phantom::ImageSettings;
using cortshift_stereo_phantom::PhantomCase;
using cortshift_stereo_phantom::Side;
using cortshift_stereo_phantom::StereoImages;

/// A pair to judge, with the truth of what its left camera sees.
struct PairTrial {
  std::string kind;
  const PhantomPair& truth;
  StereoImages images;
};
using Judge = std::function<void(const PairTrial&)>;

inline StereoImages exposed(const cv::Mat& left, const cv::Mat& right, const ImageSettings& image,
                            std::uint64_t frame) {
  using namespace cortshift_stereo_phantom;
  const Sensor sensor(image);
  return {sensor.expose(Sensor::prepare(left), frame, Side::kLeft),
          sensor.expose(Sensor::prepare(right), frame, Side::kRight)};
}

/// A stage as its case has it and through noisier and coarser sensors: four pairs.
inline void goodPairs(const PhantomPair& pair, const Judge& judge) {
  const ImageSettings as_is = pair.scene().description().image;
  ImageSettings noisy = as_is, jpeg = as_is, coarse = as_is;
  noisy.noise = coarse.noise = 4.0 / 255;
  jpeg.jpeg = coarse.jpeg = 85;
  coarse.bayer = true;
  std::uint64_t frame = 0;
  for (const auto& [kind, image] : {std::pair("as it is", as_is), std::pair("noise 4", noisy),
                                    std::pair("JPEG 85", jpeg), std::pair("noise 4, mosaic, JPEG 85", coarse)})
    judge({kind, pair, exposed(pair.light(0), pair.light(1), image, frame++)});
}

/// Rows of the raw image lower by `rows`.
inline cv::Mat rowsDown(const cv::Mat& image, int rows) {
  cv::Mat out;
  cv::copyMakeBorder(image.rowRange(0, image.rows - rows), out, rows, 0, 0, 0, cv::BORDER_REPLICATE);
  return out;
}

/// Five pairs of a stage that are none. `variety` counts stages on, so that sides and axes take turns.
inline void badPairs(const PhantomPair& pair, int stage, int variety, const Judge& judge) {
  using namespace cortshift_stereo_phantom;
  const PhantomScene& scene = pair.scene();
  const ImageSettings& image = scene.description().image;
  const cv::Mat &left = pair.light(0), &right = pair.light(1);
  const StereoImages good = exposed(left, right, image, 1);
  judge({"swapped", pair, {good.right, good.left}});

  const int other_stage = (stage + 1) % scene.stageCount();
  if (other_stage != stage)
    judge({"of two stages", pair, exposed(left, sensorLight(scene, other_stage, Side::kRight), image, 1)});

  constexpr double kTurn = 0.00873;  // 0.5 deg
  const double sign = variety % 2 == 0 ? 1 : -1;
  if (variety % 4 == 3) {
    judge({"right camera 8 px lower", pair, exposed(left, rowsDown(right, 8), image, 1)});
  } else {
    Eigen::Isometry3d turned = Eigen::Isometry3d::Identity();
    const std::array<const char*, 3> names = {"right camera turned by 0.5 deg about x",
                                              "right camera turned by 0.5 deg about z",
                                              "right camera turned by 0.5 deg about y"};
    const std::array<Eigen::Vector3d, 3> axes = {Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitZ(),
                                                 Eigen::Vector3d::UnitY()};
    const auto axis = static_cast<std::size_t>(variety % 4);
    turned.rotate(Eigen::AngleAxisd(sign * kTurn, axes[axis]));
    judge({names[axis], pair, exposed(left, sensorLight(scene, stage, Side::kRight, turned), image, 1)});
  }

  // 1 mm: 30 ms late while the microscope drifts by 3 cm/s.
  Eigen::Isometry3d moved = Eigen::Isometry3d::Identity();
  const double heading = 0.6 + 0.35 * (variety % 6);
  moved.translate(0.001 * Eigen::Vector3d(std::cos(heading), sign * std::sin(heading), 0));
  judge({"moved between the exposures", pair, exposed(left, sensorLight(scene, stage, Side::kRight, moved), image, 1)});

  constexpr double kBlur = 6;  // [px]
  cv::Mat blurred;
  cv::GaussianBlur(variety % 2 == 0 ? left : right, blurred, {}, kBlur, 0, cv::BORDER_REFLECT);
  judge({variety % 2 == 0 ? "left image blurred" : "right image blurred", pair,
         variety % 2 == 0 ? exposed(blurred, right, image, 1) : exposed(left, blurred, image, 1)});
}

}  // namespace cortshift_stereo_test
