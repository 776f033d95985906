#include "cortshift_tracking/field/pictures.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "matching/flow_targets.hpp"

namespace cortshift_tracking {
namespace {

constexpr int kPictureSide = 1024;  // of the longer side of the map [px]
constexpr int kStrip = 56;          // height of the legend under it [px]
const cv::Scalar kPaper(28, 28, 28), kInk(235, 235, 235), kBlank(60, 60, 60);

/// Grey 0...255 stretched between the 1st and 99th percentile of what the mask covers.
cv::Mat stretchedGrey(const cv::Mat& colour, const cv::Mat& mask) {
  cv::Mat grey;
  cv::cvtColor(colour, grey, cv::COLOR_BGR2GRAY);
  std::vector<float> values;
  for (int row = 0; row < grey.rows; row += 2)
    for (int column = 0; column < grey.cols; column += 2)
      if (mask.at<uchar>(row, column) != 0) values.push_back(grey.at<float>(row, column));
  if (values.empty()) return cv::Mat::zeros(grey.size(), CV_8UC1);
  const auto percentile = [&](double part) {
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(part * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return *at;
  };
  const double low = percentile(0.01), high = std::max(low + 1e-3, static_cast<double>(percentile(0.99)));
  cv::Mat bytes;
  grey.convertTo(bytes, CV_8U, 255 / (high - low), -255 * low / (high - low));
  bytes.setTo(0, mask == 0);
  return bytes;
}

double pictureScale(cv::Size size) { return static_cast<double>(kPictureSide) / std::max(size.width, size.height); }

/// Turns a grid image upright and to the size of a picture.
cv::Mat upright(const cv::Mat& grid_image, int interpolation) {
  cv::Mat flipped, scaled;
  cv::flip(grid_image, flipped, 0);
  const double scale = pictureScale(grid_image.size());
  cv::resize(flipped, scaled, {}, scale, scale, scale < 1 ? static_cast<int>(cv::INTER_AREA) : interpolation);
  return scaled;
}

void write(cv::Mat& picture, const std::string& text, cv::Point at, const cv::Scalar& colour) {
  cv::putText(picture, text, at, cv::FONT_HERSHEY_SIMPLEX, 0.6, colour, 1, cv::LINE_AA);
}

/// Puts a strip under the picture with a bar of 10 mm (or 1 mm in a small field) at its right end.
cv::Mat withStrip(const cv::Mat& picture, double millimetres_per_pixel) {
  cv::Mat canvas(picture.rows + kStrip, picture.cols, CV_8UC3, kPaper);
  picture.copyTo(canvas(cv::Rect(0, 0, picture.cols, picture.rows)));
  const double length = picture.cols * millimetres_per_pixel > 25 ? 10 : 1;
  const int pixels = static_cast<int>(std::lround(length / millimetres_per_pixel)), y = picture.rows + kStrip / 2 - 8;
  const int right = picture.cols - 16;
  cv::line(canvas, {right - pixels, y}, {right, y}, kInk, 2);
  for (const int x : {right - pixels, right}) cv::line(canvas, {x, y - 5}, {x, y + 5}, kInk, 2);
  write(canvas, length > 1 ? "10 mm" : "1 mm", {right - pixels / 2 - 28, y + 26}, kInk);
  return canvas;
}

/// A white line around the brain in a picture of the grid, or of more below it. @returns what the legend says of it
std::string drawBrain(cv::Mat& picture, const DisplacementField& field) {
  if (field.brain.empty()) return "";
  std::vector<std::vector<cv::Point>> contours;
  cv::findContours(upright(field.brain, cv::INTER_LINEAR) >= 128, contours, cv::RETR_LIST, cv::CHAIN_APPROX_NONE);
  cv::drawContours(picture, contours, -1, {0, 0, 0}, 4, cv::LINE_8);  // so that it is seen on light colours too
  cv::drawContours(picture, contours, -1, {255, 255, 255}, 2, cv::LINE_AA);
  return "; white: brain";
}

cv::Mat overlay(const ShiftResult& result, const cv::Mat& later_colour, const cv::Mat& later_mask,
                const std::string& title) {
  const cv::Mat red = stretchedGrey(result.earlier.colour, result.earlier.mask),
                green = stretchedGrey(later_colour, later_mask), blue = cv::Mat::zeros(red.size(), CV_8UC1);
  cv::Mat merged;
  cv::merge(std::vector<cv::Mat>{blue, green, red}, merged);
  const double mm = 1e3 * result.field.frame.resolution / pictureScale(merged.size());
  cv::Mat canvas = withStrip(upright(merged, cv::INTER_CUBIC), mm);
  const int y = canvas.rows - kStrip + 34;
  write(canvas, "earlier", {16, y}, {80, 80, 255});
  write(canvas, "later", {100, y}, {80, 255, 80});
  write(canvas, title + drawBrain(canvas, result.field), {170, y}, kInk);
  return canvas;
}

cv::Mat validMask(const DisplacementField& field) {
  cv::Mat first;
  cv::extractChannel(field.displacement_pmr, first, 0);
  return first == first;  // false for NaN
}

/// One number of each displacement [m]: CV_32FC1, NaN where there is none.
cv::Mat valuesOf(const DisplacementField& field, const std::function<double(const Eigen::Vector3d&)>& value) {
  cv::Mat values(field.displacement_pmr.size(), CV_32FC1);
  for (int row = 0; row < values.rows; ++row)
    for (int column = 0; column < values.cols; ++column) {
      const cv::Vec3f& d = field.displacement_pmr.at<cv::Vec3f>(row, column);
      values.at<float>(row, column) = static_cast<float>(value({d[0], d[1], d[2]}));
    }
  return values;
}

cv::Mat magnitudes(const DisplacementField& field) {
  return valuesOf(field, [](const Eigen::Vector3d& d) { return d.norm(); });
}

cv::Mat along(const DisplacementField& field, const Eigen::Vector3d& direction_pmr) {
  return valuesOf(field, [&](const Eigen::Vector3d& d) { return d.dot(direction_pmr); });
}

double scaleEndOf(const cv::Mat& values) {
  std::vector<double> sizes;
  for (auto it = values.begin<float>(); it != values.end<float>(); ++it)
    if (!std::isnan(*it)) sizes.push_back(std::abs(*it));
  if (sizes.empty()) return 0.0001;
  const auto at = sizes.begin() + static_cast<std::ptrdiff_t>(0.99 * static_cast<double>(sizes.size() - 1));
  std::nth_element(sizes.begin(), at, sizes.end());
  const double largest = std::max(*at, 0.0001), power = std::pow(10, std::floor(std::log10(largest) + 1e-9));
  for (const double step : {1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0})
    if (largest <= step * power * (1 + 1e-6)) return step * power;
  return 10 * power;
}

/// Blue at -1, white at 0, red at 1.
cv::Vec3b signedColour(double value) {
  const double t = std::clamp(value, -1.0, 1.0);
  const cv::Vec3d end = t < 0 ? cv::Vec3d(176, 60, 20) : cv::Vec3d(30, 20, 178), white(245, 245, 245);
  const double share = std::sqrt(std::abs(t));  // small values can be distinguished from zero
  const cv::Vec3d mixed = (1 - share) * white + share * end;
  return {cv::saturate_cast<uchar>(mixed[0]), cv::saturate_cast<uchar>(mixed[1]), cv::saturate_cast<uchar>(mixed[2])};
}

/// A map of values [m] with a colour bar in mm: from 0, or from minus the end of the scale where they have a sign.
cv::Mat colourMap(const DisplacementField& field, const cv::Mat& values, bool with_sign, const std::string& title) {
  const double end = scaleEndOf(values);
  const auto colourAt = [&](double value) { return with_sign ? signedColour(value / end) : scaleColour(value / end); };
  cv::Mat coloured(values.size(), CV_8UC3, kBlank);
  for (int row = 0; row < coloured.rows; ++row)
    for (int column = 0; column < coloured.cols; ++column) {
      const float value = values.at<float>(row, column);
      if (!std::isnan(value)) coloured.at<cv::Vec3b>(row, column) = colourAt(value);
    }
  const double mm = 1e3 * field.frame.resolution / pictureScale(field.frame.size);
  cv::Mat map = withStrip(upright(coloured, cv::INTER_NEAREST), mm);

  // The bar stands in the strip, from the left to the middle.
  const int left = 24, top = map.rows - kStrip + 8, width = map.cols / 2, height = 16;
  const double begin = with_sign ? -end : 0;
  for (int x = 0; x < width; ++x)
    cv::line(map, {left + x, top}, {left + x, top + height},
             cv::Scalar(colourAt(begin + (end - begin) * x / (width - 1))));
  constexpr int kTicks = 4;
  for (int tick = 0; tick <= kTicks; ++tick) {
    char text[32];
    std::snprintf(text, sizeof text, tick == kTicks ? "%.4g mm" : "%.4g",
                  1e3 * (begin + (end - begin) * tick / kTicks));
    const int x = left + width * tick / kTicks;
    cv::line(map, {x, top + height}, {x, top + height + 4}, kInk, 1);
    write(map, text, {x - 12, top + height + 24}, kInk);
  }
  write(map, title + drawBrain(map, field), {left + width + 70, top + 16}, kInk);
  return map;
}

}  // namespace

cv::Vec3b scaleColour(double value) {
  static const cv::Mat table = [] {
    cv::Mat ramp(1, 256, CV_8UC1), colours;
    for (int i = 0; i < 256; ++i) ramp.at<uchar>(0, i) = static_cast<uchar>(i);
    cv::applyColorMap(ramp, colours, cv::COLORMAP_TURBO);
    return colours;
  }();
  return table.at<cv::Vec3b>(0, static_cast<int>(std::lround(255 * std::clamp(value, 0.0, 1.0))));
}

double scaleEnd(const DisplacementField& field) { return scaleEndOf(magnitudes(field)); }

cv::Mat brainOutline(const ShiftResult& result) {
  cv::Mat bytes;
  result.earlier.colour.convertTo(bytes, CV_8UC3, 255);
  const double mm = 1e3 * result.field.frame.resolution / pictureScale(bytes.size());
  cv::Mat picture = upright(bytes, cv::INTER_CUBIC);
  drawBrain(picture, result.field);
  cv::Mat canvas = withStrip(picture, mm);
  write(canvas, "brain: " + result.summary.outline, {16, canvas.rows - kStrip + 34}, kInk);
  return canvas;
}

cv::Mat overlayBefore(const ShiftResult& result) {
  return overlay(result, result.later.colour, result.later.mask, "before compensation");
}

cv::Mat overlayAfter(const ShiftResult& result) {
  const cv::Mat map = flowTargets(result.flow);
  cv::Mat colour, mask;
  cv::remap(result.later.colour, colour, map, {}, cv::INTER_CUBIC);
  cv::remap(result.later.mask, mask, map, {}, cv::INTER_NEAREST);
  cv::Mat canvas = overlay(result, colour, mask, "after compensation; blue line: trusted");
  std::vector<std::vector<cv::Point>> outlines;
  cv::findContours(upright(validMask(result.field), cv::INTER_NEAREST) > 127, outlines, cv::RETR_CCOMP,
                   cv::CHAIN_APPROX_NONE);
  for (std::size_t i = 0; i < outlines.size(); ++i)
    if (cv::contourArea(outlines[i]) > 40) cv::drawContours(canvas, outlines, static_cast<int>(i), {255, 160, 60}, 1);
  return canvas;
}

cv::Mat magnitudeMap(const DisplacementField& field) { return colourMap(field, magnitudes(field), false, "|d|"); }

cv::Mat gravityMap(const DisplacementField& field, const Eigen::Vector3d& gravity_pmr) {
  return colourMap(field, along(field, gravity_pmr), true, "along gravity");
}

cv::Mat normalMap(const DisplacementField& field, const Eigen::Vector3d& first_normal_pmr) {
  return colourMap(field, along(field, first_normal_pmr), true, "along the normal");
}

cv::Mat lateralMap(const DisplacementField& field, const Eigen::Vector3d& first_normal_pmr) {
  return colourMap(
      field,
      valuesOf(field,
               [&](const Eigen::Vector3d& d) { return (d - d.dot(first_normal_pmr) * first_normal_pmr).norm(); }),
      false, "lateral");
}

}  // namespace cortshift_tracking
