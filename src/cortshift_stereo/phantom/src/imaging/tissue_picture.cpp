#include "imaging/tissue_picture.hpp"

#include <cmath>
#include <opencv2/imgcodecs.hpp>

namespace cortshift_stereo_phantom {
namespace {

/// Index in 0 ... size - 1 after mirroring at both edges.
int mirrored(int index, int size) {
  const int period = 2 * size;
  const int within = ((index % period) + period) % period;
  return within < size ? within : period - 1 - within;
}

cv::Vec4f cubicWeights(float t) {
  return {t * (-0.5f + t * (1 - 0.5f * t)), 1 + t * t * (-2.5f + 1.5f * t), t * (0.5f + t * (2 - 1.5f * t)),
          t * t * (-0.5f + 0.5f * t)};
}

}  // namespace

TissuePicture::TissuePicture(const PictureSettings& settings)
    : centre_(settings.centre), cosine_(std::cos(settings.turn)), sine_(std::sin(settings.turn)) {
  const cv::Mat picture = cv::imread(settings.file, cv::IMREAD_COLOR);
  if (picture.empty())
    throw PhantomCaseError("head.picture.file = " + settings.file +
                           " cannot be read as a picture; set a path that exists (Debian's photographs: install "
                           "python3-skimage)");
  pixels_per_metre_ = picture.cols / settings.width;
  cv::Mat values;
  picture.convertTo(values, CV_32FC3, settings.gain / 255);
  const cv::Scalar rest = cv::mean(values) * (1 - settings.contrast);
  values_ = cv::Mat(values * settings.contrast + cv::Scalar(rest[0], rest[1], rest[2]));
}

cv::Vec3f TissuePicture::colour(double x, double y) const {
  const double dx = x - centre_.x(), dy = y - centre_.y();
  const double column = pixels_per_metre_ * (cosine_ * dx + sine_ * dy) + 0.5 * (values_.cols - 1);
  const double row = pixels_per_metre_ * (cosine_ * dy - sine_ * dx) + 0.5 * (values_.rows - 1);
  const int first_column = static_cast<int>(std::floor(column)), first_row = static_cast<int>(std::floor(row));
  const cv::Vec4f across = cubicWeights(static_cast<float>(column - first_column));
  const cv::Vec4f down = cubicWeights(static_cast<float>(row - first_row));
  cv::Vec3f sum(0, 0, 0);
  for (int j = 0; j < 4; ++j) {
    const cv::Vec3f* line = values_[mirrored(first_row - 1 + j, values_.rows)];
    cv::Vec3f part(0, 0, 0);
    for (int i = 0; i < 4; ++i) part += across[i] * line[mirrored(first_column - 1 + i, values_.cols)];
    sum += down[j] * part;
  }
  for (float& value : sum.val) value = std::max(0.0f, value);
  return sum;
}

}  // namespace cortshift_stereo_phantom
