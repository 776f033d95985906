// A phantom pair with the truth in the rectified left image, for tests and benchmarks.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "cortshift_stereo/geometry/camera_model.hpp"
#include "cortshift_stereo_phantom/phantom_renderer.hpp"

namespace cortshift_stereo_test {

/// Median and 95th percentile of |height error| [m] over the craniotomy, and the share of it with a point.
struct HeightErrors {
  double median = 0;
  double p95 = 0;
  double valid_share = 0;
};

inline double quantile(std::vector<float> values, double share) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// What is done to the light on its way to the pixels.
struct Exposure {
  double noise = 0;       ///< standard deviation, of full scale
  double right_gain = 1;  ///< of the right camera over the left
  std::uint64_t frame = 0;
};

/// One stage of a case, rendered once and exposed as often as wanted.
class PhantomPair {
 public:
  PhantomPair(const cortshift_stereo_phantom::PhantomCase& description, int stage)
      : scene_(std::make_shared<cortshift_stereo_phantom::PhantomScene>(description)) {
    using namespace cortshift_stereo_phantom;
    for (const Side side : {Side::kLeft, Side::kRight})
      light_[side == Side::kRight] = sensorLight(*scene_, stage, side);
    const View view = scene_->rectified(stage, Side::kLeft);
    const ViewTruth truth = truthOf(*scene_, stage, view);
    depth_.create(view.size, CV_32FC1);
    craniotomy_.create(view.size, CV_8UC1);
    const Eigen::Isometry3d T_camera_pmr = view.T_pmr_camera.inverse();
    for (int y = 0; y < view.size.height; ++y)
      for (int x = 0; x < view.size.width; ++x) {
        const auto& p = truth.points_pmr.at<cv::Vec3d>(y, x);
        depth_.at<float>(y, x) = static_cast<float>((T_camera_pmr * Eigen::Vector3d(p[0], p[1], p[2])).z());
        const bool brain = truth.what.at<uint8_t>(y, x) == static_cast<uint8_t>(Material::kBrain);
        craniotomy_.at<uint8_t>(y, x) = brain && std::isfinite(depth_.at<float>(y, x)) ? 255 : 0;
      }
  }

  const cortshift_stereo::StereoModel& model() const { return scene_->stereoHead().model; }
  const cortshift_stereo_phantom::PhantomScene& scene() const { return *scene_; }
  /// CV_32FC3, on the sensor of the left (0) or right (1) camera.
  const cv::Mat& light(int side) const { return light_[side]; }

  cortshift_stereo_phantom::StereoImages take(const Exposure& exposure) const {
    using namespace cortshift_stereo_phantom;
    ImageSettings image = scene_->description().image;
    image.noise = exposure.noise;
    image.noise_seed = 1;
    const Sensor sensor(image);
    return {sensor.expose(Sensor::prepare(light_[0]), exposure.frame, Side::kLeft),
            sensor.expose(Sensor::prepare(light_[1] * exposure.right_gain), exposure.frame, Side::kRight)};
  }

  /// CV_32FC1 [m] along the rectified z axis; NaN where nothing is seen.
  const cv::Mat& depth() const { return depth_; }
  /// CV_8UC1, 255 on brain.
  const cv::Mat& craniotomy() const { return craniotomy_; }

  /// CV_32FC1 [m], NaN where there is no point: depth of a disparity minus the true one.
  cv::Mat heightError(const cv::Mat& disparity) const {
    cv::Mat error(disparity.size(), CV_32FC1);
    for (int y = 0; y < disparity.rows; ++y)
      for (int x = 0; x < disparity.cols; ++x)
        error.at<float>(y, x) = static_cast<float>(
            cortshift_stereo::depthOfDisparity(model(), disparity.at<float>(y, x)) - depth_.at<float>(y, x));
    return error;
  }

  HeightErrors heightErrors(const cv::Mat& disparity) const {
    const cv::Mat error = heightError(disparity);
    std::vector<float> errors;
    for (int y = 0; y < error.rows; ++y)
      for (int x = 0; x < error.cols; ++x)
        if (craniotomy_.at<uint8_t>(y, x) && std::isfinite(error.at<float>(y, x)))
          errors.push_back(std::abs(error.at<float>(y, x)));
    return {quantile(errors, 0.5), quantile(errors, 0.95),
            static_cast<double>(errors.size()) / cv::countNonZero(craniotomy_)};
  }

 private:
  std::shared_ptr<cortshift_stereo_phantom::PhantomScene> scene_;
  cv::Mat light_[2];
  cv::Mat depth_;
  cv::Mat craniotomy_;
};

}  // namespace cortshift_stereo_test
