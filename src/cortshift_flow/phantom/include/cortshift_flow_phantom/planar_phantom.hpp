// The digital phantom of Ji et al. 2014, section 2.6: a cortex seen from above that is stretched under the rim of a
// craniotomy (Eq. 6-7), or shrinks (Eq. 8), with the exact flow between its two images.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

namespace cortshift_flow_phantom {

enum class Motion {
  kOutward,  ///< Eq. (6): radial stretch inside the craniotomy; the surround stays where it is
  kInward,   ///< Eq. (8): the same two images in the other order
  kSmooth,   ///< a smooth, non-radial field over the whole image, no craniotomy
};

/// What is seen outside the craniotomy.
enum class Surround {
  kDrape,       ///< a bluish drape, unlike the tissue
  kTissue,      ///< the same tissue, standing still: only its motion tells it from the inside
  kOverlaid,    ///< the drape, which the stretched tissue spreads over: all tissue is seen in both images
  kContinuing,  ///< the same tissue, moving on by Eq. (6): the whole image is deformed and nothing is hidden
};

struct PlanarPhantomSettings {
  cv::Size size{1024, 768};  ///< [px]
  std::uint32_t seed = 1;
  Motion motion = Motion::kOutward;
  Surround surround = Surround::kDrape;
  double pixel_size = 0.0001;     ///< [m]
  double rim_radius = 342;        ///< of the craniotomy at a height of 768 px; scales with the shorter side [px]
  double largest_motion = 37;     ///< at the rim, or of the smooth field; scales likewise [px]
  bool featureless_patch = true;  ///< a saturated disc of 27 px radius that moves with the tissue
  double noise = 0;               ///< standard deviation, of both images [1/255]
  double gain = 1, offset = 0;    ///< of the second image; intensities 0...1
  double vignette = 0;            ///< fall of the second image's brightness towards the corners, 0...1
  double blood = 0;               ///< share of the craniotomy that blood hides in the second image, 0...1
  int quadrature = 4;             ///< Gauss points per pixel side over which the texture is integrated: 1...4 or 6
  bool eight_bit = true;          ///< CV_8UC3; otherwise CV_32FC3, 0...1, not quantised
};

struct PlanarPhantom {
  cv::Mat first, second;  ///< H x W, CV_8UC3 or CV_32FC3, blue green red
  cv::Mat truth;          ///< CV_32FC2, flow of each pixel of the first image [px]
  cv::Mat craniotomy;     ///< CV_8UC1, 255 inside, in the first image
  cv::Mat core;           ///< CV_8UC1, the craniotomy without a 40 px rim band, the patch and the blood
  cv::Mat patch;          ///< CV_8UC1, the featureless patch in the first image
  cv::Mat blood;          ///< CV_8UC1, pixels of the first image whose match is under blood
  cv::Mat rim_distance;   ///< CV_32FC1, distance inwards from the rim [px]
};

/// @throws std::invalid_argument naming the setting that is out of range.
PlanarPhantom makePlanarPhantom(const PlanarPhantomSettings& settings);

}  // namespace cortshift_flow_phantom
