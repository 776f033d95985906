// Images of a phantom scene and the truth behind every pixel.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "cortshift_stereo_phantom/phantom_scene.hpp"

namespace cortshift_stereo_phantom {

/// What is seen through the middle of every pixel of a view. Exact: Newton on the analytic surface.
struct ViewTruth {
  cv::Mat material;    ///< CV_64FC2 material coordinates [m]; NaN where no head is seen
  cv::Mat points_pmr;  ///< CV_64FC3 [m]; NaN where nothing is seen
  cv::Mat what;        ///< CV_8UC1 of Material
};

ViewTruth truthOf(const PhantomScene& scene, int stage, const View& view);

/// Noise-free light behind a pinhole, CV_32FC3 blue green red; 1 is full scale (not clipped). Each pixel is the mean of
/// supersampling x supersampling rays. Gain of the stage and vignette are in it.
/// The result does not depend on the number of threads.
/// @param depth  if wanted, CV_32FC1: camera depth [m] through the middle of each pixel, NaN where nothing is seen
cv::Mat renderView(const PhantomScene& scene, int stage, const View& view, int supersampling, cv::Mat* depth = nullptr);

/// Light on the sensor of one camera, CV_32FC3: renderView() through the lens (depth of field, blur), times the
/// camera's gains. The blur belongs to the depth of the pixel that receives it: exact but for a few pixels beside depth
/// edges.
/// @param moved  of a camera that stands otherwise than it should, in its own frame: turned since its calibration, or
///               carried on since the other camera's exposure
cv::Mat sensorLight(const PhantomScene& scene, int stage, Side side,
                    const Eigen::Isometry3d& moved = Eigen::Isometry3d::Identity());

/// From light to pixels: the full well, noise, black level, mosaic, rounding, compression. Repeatable: the same seed,
/// frame and side give the same bits.
class Sensor {
 public:
  explicit Sensor(const ImageSettings& settings);

  /// Light scaled for expose(): CV_16SC3 in 1/64 grey levels.
  static cv::Mat prepare(const cv::Mat& light);

  /// 8-bit image of one frame, CV_8UC3. Takes about a millisecond where the sensor is plain.
  cv::Mat expose(const cv::Mat& prepared, std::uint64_t frame, Side side) const;

 private:
  void addNoise(const cv::Mat& prepared, cv::Mat& image, std::uint64_t frame, Side side) const;

  ImageSettings settings_;
  std::vector<std::int16_t> table_;
  std::vector<float> noise_of_level_;  // share of the table's deviation, by grey level; empty: alike for all
};

/// 8-bit bgr images of both cameras.
struct StereoImages {
  cv::Mat left, right;
};

/// Takes pairs of a scene; renders each state of a stage once and adds fresh noise to every frame. May be called from
/// any thread.
class PhantomPairs {
 public:
  explicit PhantomPairs(std::shared_ptr<const PhantomScene> scene);

  const PhantomScene& scene() const { return *scene_; }

  /// The scene as it stands at the exposure of a pair: another than scene() where the brain pulses.
  std::shared_ptr<const PhantomScene> sceneAt(std::uint64_t frame);

  /// Renders a stage ahead of its first pair; a few seconds. Other stages can be taken meanwhile.
  void prepare(int stage) { prepared(stage, 0); }

  /// @param frame number of the exposure; each has its own noise
  StereoImages take(int stage, std::uint64_t frame);

 private:
  struct Prepared {
    std::once_flag once;
    cv::Mat left, right;
  };
  const Prepared& prepared(int stage, std::uint64_t frame);

  std::shared_ptr<const PhantomScene> scene_;
  Sensor sensor_;
  std::mutex mutex_;
  std::map<std::pair<int, double>, Prepared> stages_;  // by stage and state; nodes of a map stay where they are
  std::map<double, std::shared_ptr<const PhantomScene>> states_;
};

}  // namespace cortshift_stereo_phantom
