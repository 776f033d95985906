// Raw stereo images to row-aligned ones, in one resampling.
#pragma once

#include <functional>
#include <opencv2/core.hpp>

#include "cortshift_stereo/camera_model.hpp"

namespace cortshift_stereo {

/// Both images as ideal cameras with parallel axes would have taken them.
struct RectifiedPair {
  cv::Mat left;          ///< CV_32FC1 luminance, 0...255, slightly blurred, sampled to a fraction of a grey level
  cv::Mat right;         ///< the same
  cv::Mat left_sharp;    ///< CV_8UC1 luminance as it comes, for matching by pixels
  cv::Mat right_sharp;   ///< the same
  cv::Mat left_colour;   ///< CV_8UC3 blue green red
  cv::Mat left_usable;   ///< CV_8UC1, 255 where the raw image has a pixel that is not saturated
  cv::Mat right_usable;  ///< the same
};

/// Raw pixel of the calibrated camera to the pixel of the image as taken; identity where it is empty. Compensation
/// for other microscope settings enters here (Ji et al. 2014, section 2.3).
using PixelWarp = std::function<cv::Point2d(const cv::Point2d&)>;

/// Rectification by each camera's own K, D, R and P (the two principal points may differ).
class Rectifier {
 public:
  /// @throws CalibrationError if the model is not valid
  explicit Rectifier(const StereoModel& model, const PixelWarp& left_warp = {}, const PixelWarp& right_warp = {});

  const StereoModel& model() const { return model_; }

  /// @param left, right  CV_8UC3 raw images of the calibrated size
  /// @throws std::invalid_argument otherwise
  RectifiedPair rectify(const cv::Mat& left, const cv::Mat& right) const;

  /// CV_32FC2: raw position [px] of each pixel of a rectified image.
  const cv::Mat& leftMap() const { return left_.map; }
  const cv::Mat& rightMap() const { return right_.map; }

 private:
  struct Side {
    cv::Mat map;       // CV_32FC2 raw position of each rectified pixel [px]; far outside where there is none
    cv::Mat inside;    // CV_8UC1 255 where the whole interpolation kernel lies in the raw image
    cv::Mat map_near;  // CV_16SC2 and CV_16UC1: the same in OpenCV's fixed point, for the colours
    cv::Mat map_share;
  };
  static Side makeSide(const CameraModel& camera, const PixelWarp& warp);
  static cv::Mat usable(const cv::Mat& raw, const Side& side);

  StereoModel model_;
  Side left_;
  Side right_;
};

}  // namespace cortshift_stereo
