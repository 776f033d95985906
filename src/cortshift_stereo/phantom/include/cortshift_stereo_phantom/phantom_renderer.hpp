// Images of a phantom scene and the truth behind every pixel.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <opencv2/core.hpp>

#include "cortshift_stereo_phantom/phantom_scene.hpp"

namespace cortshift_stereo_phantom {

/// What is seen through the middle of every pixel of a view. Exact: Newton on the analytic surface.
struct ViewTruth {
  cv::Mat material;    ///< CV_64FC2 material coordinates [m]; NaN where no head is seen
  cv::Mat points_pmr;  ///< CV_64FC3 [m]; NaN where nothing is seen
  cv::Mat what;        ///< CV_8UC1 of Material
};

ViewTruth truthOf(const PhantomScene& scene, int stage, const View& view);

/// Noise-free light on the sensor, CV_32FC3 blue green red; 1 is full scale (not clipped). Each pixel is the mean of
/// supersampling x supersampling rays. Gain of the stage and vignette are in it.
/// The result does not depend on the number of threads.
cv::Mat renderView(const PhantomScene& scene, int stage, const View& view, int supersampling);

/// Adds sensor noise and quantises. Repeatable: the same seed, frame and side give the same bits.
class Sensor {
 public:
  /// @param noise standard deviation, of full scale
  Sensor(double noise, std::uint32_t seed);

  /// Light scaled for expose(): CV_16SC3 in 1/64 grey levels.
  static cv::Mat prepare(const cv::Mat& light);

  /// 8-bit image of one frame, CV_8UC3. Takes about a millisecond.
  cv::Mat expose(const cv::Mat& prepared, std::uint64_t frame, Side side) const;

 private:
  std::vector<std::int16_t> table_;
  std::uint64_t seed_;
};

/// 8-bit bgr images of both cameras.
struct StereoImages {
  cv::Mat left, right;
};

/// Takes pairs of a scene; renders each stage once and adds fresh noise to every frame. May be called from any thread.
class PhantomPairs {
 public:
  explicit PhantomPairs(std::shared_ptr<const PhantomScene> scene);

  const PhantomScene& scene() const { return *scene_; }

  /// Renders a stage ahead of its first pair; a few seconds. Other stages can be taken meanwhile.
  void prepare(int stage) { prepared(stage); }

  /// @param frame number of the exposure; each has its own noise
  StereoImages take(int stage, std::uint64_t frame);

 private:
  struct Prepared {
    std::once_flag once;
    cv::Mat left, right;
  };
  const Prepared& prepared(int stage);

  std::shared_ptr<const PhantomScene> scene_;
  Sensor sensor_;
  std::mutex mutex_;
  std::map<int, Prepared> stages_;  // nodes of a map stay where they are
};

}  // namespace cortshift_stereo_phantom
