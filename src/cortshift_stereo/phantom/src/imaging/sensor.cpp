#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "cortshift_stereo_phantom/phantom_renderer.hpp"
#include "random.hpp"

namespace cortshift_stereo_phantom {
namespace {

constexpr int kSubLevels = 64;  // steps of a prepared image per grey level
constexpr std::size_t kTableSize = 1U << 20;

/// One colour per pixel, red in the first, and the others interpolated again.
cv::Mat throughMosaic(const cv::Mat& bgr) {
  cv::Mat mosaic(bgr.size(), CV_8UC1), out;
  for (int y = 0; y < bgr.rows; ++y)
    for (int x = 0; x < bgr.cols; ++x) mosaic.at<uchar>(y, x) = bgr.at<cv::Vec3b>(y, x)[2 - (x & 1) - (y & 1)];
  cv::demosaicing(mosaic, out, cv::COLOR_BayerBG2BGR);  // OpenCV names a mosaic by its second row
  return out;
}

cv::Mat compressed(const cv::Mat& image, int quality) {
  std::vector<uchar> bytes;
  cv::imencode(".jpg", image, bytes, {cv::IMWRITE_JPEG_QUALITY, quality});
  return cv::imdecode(bytes, cv::IMREAD_COLOR);
}

}  // namespace

Sensor::Sensor(const ImageSettings& settings) : settings_(settings) {
  const double most = std::hypot(settings.noise, settings.shot_noise);
  if (most <= 0) return;
  // A long table of normal deviates; every row of every frame starts at its own place in it.
  Random random(settings.noise_seed);
  constexpr int kLongestRow = 3 * 8192;
  table_.resize(kTableSize + kLongestRow);
  for (std::size_t i = 0; i < kTableSize; i += 2) {
    const double radius = std::sqrt(-2 * std::log(1 - random.uniform())), angle = 6.283185307179586 * random.uniform();
    for (const std::size_t k : {std::size_t{0}, std::size_t{1}}) {
      const double deviate = radius * (k == 0 ? std::cos(angle) : std::sin(angle));
      table_[i + k] =
          static_cast<std::int16_t>(std::lround(std::clamp(deviate * most * 255 * kSubLevels, -15e3, 15e3)));
    }
  }
  std::copy(table_.begin(), table_.begin() + kLongestRow, table_.begin() + kTableSize);
  if (settings.shot_noise <= 0) return;
  for (int level = 0; level < 256; ++level)
    noise_of_level_.push_back(
        static_cast<float>(std::hypot(settings.noise, settings.shot_noise * std::sqrt(level / 255.0)) / most));
}

cv::Mat Sensor::prepare(const cv::Mat& light) {
  cv::Mat prepared;
  cv::min(light, 1.0, prepared);  // the well is full
  prepared.convertTo(prepared, CV_16SC3, 255.0 * kSubLevels);
  return prepared;
}

void Sensor::addNoise(const cv::Mat& prepared, cv::Mat& image, std::uint64_t frame, Side side) const {
  const int values = 3 * prepared.cols;
  const double black_level = side == Side::kLeft ? settings_.left.black_level : settings_.right.black_level;
  const int black = static_cast<int>(std::lround(255 * kSubLevels * black_level));
  Random random(settings_.noise_seed ^ mixBits(2 * frame + (side == Side::kRight ? 1 : 0)));
  for (int row = 0; row < prepared.rows; ++row) {
    const std::int16_t* in = prepared.ptr<std::int16_t>(row);
    uchar* out = image.ptr<uchar>(row);
    const std::int16_t* noise = table_.empty() ? nullptr : &table_[random.bits() % kTableSize];
    for (int i = 0; i < values; ++i) {
      int deviation = noise != nullptr ? noise[i] : 0;
      if (!noise_of_level_.empty())
        deviation = static_cast<int>(
            std::lround(static_cast<float>(deviation) * noise_of_level_[static_cast<std::size_t>(in[i] / kSubLevels)]));
      const int level = (in[i] + deviation + black + kSubLevels / 2) >> 6;
      out[i] = static_cast<uchar>(std::clamp(level, 0, 255));
    }
  }
}

cv::Mat Sensor::expose(const cv::Mat& prepared, std::uint64_t frame, Side side) const {
  cv::Mat image(prepared.size(), CV_8UC3);
  addNoise(prepared, image, frame, side);
  if (settings_.bayer) image = throughMosaic(image);
  if (settings_.jpeg > 0) image = compressed(image, settings_.jpeg);
  return image;
}

}  // namespace cortshift_stereo_phantom
