// A wavy, textured sheet in front of two verging, distorting cameras: images and truth from closed formulas, small
// enough to be made anew in every test.
#pragma once

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "cortshift_stereo/geometry/camera_model.hpp"

namespace cortshift_stereo_test {

struct AnalyticScene {
  // What a test may vary.
  cv::Size size{320, 240};
  double focal = 1200;                  ///< [px]
  double baseline = 0.025;              ///< [m]
  double depth = 0.300;                 ///< [m] of the sheet on the optical axis
  cv::Vec2d slope{0.15, -0.10};         ///< dz/dx, dz/dy of the sheet
  double wave = 0.001;                  ///< [m] amplitude of the relief, 15 mm long
  double vergence = 0.04;               ///< [rad] each camera turns inwards
  bool equal_principal_points = false;  ///< rectified cx of left and right
  double noise = 0;                     ///< [grey levels]
  double right_gain = 1;
  double right_offset = 0;  ///< [grey levels]
  double contrast = 1;
  double blur = 0;          ///< [px] standard deviation of defocus
  int right_rows_down = 0;  ///< [px] vertical misalignment of the right image

  cortshift_stereo::StereoModel model() const {
    cortshift_stereo::StereoModel m;
    const double offset = equal_principal_points ? 0 : focal * baseline / depth;  // a sheet at `depth` has disparity 0
    m.left = camera(vergence, {-0.2, 0.05, 0, 0, 0}, size.width / 2.0 - offset / 2, 0);
    m.right = camera(-vergence, {-0.18, 0, 0.001, 0, 0}, size.width / 2.0 + offset / 2, -focal * baseline);
    if (equal_principal_points) m.left.P(0, 2) = m.right.P(0, 2) = size.width / 2.0;
    return m;
  }

  /// CV_32FC1 [m]: depth of the sheet along the ray of each rectified left pixel.
  cv::Mat trueDepth() const {
    const cortshift_stereo::StereoModel m = model();
    cv::Mat z(size, CV_32FC1);
    for (int y = 0; y < size.height; ++y)
      for (int x = 0; x < size.width; ++x) {
        const cv::Matx34d& P = m.left.P;
        const cv::Vec3d ray((x - P(0, 2)) / P(0, 0), (y - P(1, 2)) / P(1, 1), 1);
        z.at<float>(y, x) = static_cast<float>(hit({0, 0, 0}, ray)[2]);
      }
    return z;
  }

  cv::Mat left() const { return finish(render(model().left, {0, 0, 0}), 1, 0, 1); }
  cv::Mat right() const {
    cv::Mat image = finish(render(model().right, {baseline, 0, 0}), right_gain, right_offset, 2);
    if (right_rows_down == 0) return image;
    cv::Mat moved;
    cv::copyMakeBorder(image.rowRange(0, image.rows - right_rows_down), moved, right_rows_down, 0, 0, 0,
                       cv::BORDER_REPLICATE);
    return moved;
  }

 private:
  cortshift_stereo::CameraModel camera(double turn, const std::vector<double>& D, double cx, double Tx) const {
    cortshift_stereo::CameraModel c;
    c.size = size;
    c.K = cv::Matx33d(focal, 0, size.width / 2.0 + 3, 0, focal, size.height / 2.0 - 2, 0, 0, 1);
    c.D = D;
    c.R = cv::Matx33d(std::cos(turn), 0, std::sin(turn), 0, 1, 0, -std::sin(turn), 0, std::cos(turn));
    c.P = cv::Matx34d(focal, 0, cx, Tx, 0, focal, size.height / 2.0, 0, 0, 0, 1, 0);
    return c;
  }

  double height(double x, double y) const {
    constexpr double kWaves = 2 * CV_PI / 0.015;
    return depth + slope[0] * x + slope[1] * y + wave * std::sin(kWaves * x) * std::cos(kWaves * y);
  }

  /// Where a ray (rectified left axes) meets the sheet; the iteration contracts by slope times ray inclination.
  cv::Vec3d hit(const cv::Vec3d& origin, const cv::Vec3d& ray) const {
    double t = depth;
    for (int i = 0; i < 60; ++i) t = (height(origin[0] + t * ray[0], origin[1] + t * ray[1]) - origin[2]) / ray[2];
    return origin + t * ray;
  }

  cv::Mat render(const cortshift_stereo::CameraModel& c, const cv::Vec3d& origin) const {
    cv::RNG random(11);
    struct Ripple {
      cv::Vec2d k;
      double phase;
      cv::Vec3d colour;
    };
    std::vector<Ripple> ripples;
    const double pixel = depth / focal;  // on the sheet [m]
    for (int i = 0; i < 60; ++i) {
      const double length = pixel * 4 * std::pow(16.0, i / 59.0), angle = random.uniform(0.0, CV_PI);
      ripples.push_back({cv::Vec2d(std::cos(angle), std::sin(angle)) * (2 * CV_PI / length),
                         random.uniform(0.0, 2 * CV_PI),
                         {5, random.uniform(4.0, 8.0), 6}});
    }
    std::vector<cv::Point2d> pixels, rays;
    for (int y = 0; y < size.height; ++y)
      for (int x = 0; x < size.width; ++x) pixels.emplace_back(x, y);
    cv::undistortPoints(pixels, rays, c.K, c.D, cv::noArray(), cv::noArray(),
                        cv::TermCriteria(cv::TermCriteria::COUNT, 50, 0));
    cv::Mat image(size, CV_64FC3);
    cv::parallel_for_(cv::Range(0, size.height), [&](const cv::Range& rows) {
      for (int i = rows.start * size.width; i < rows.end * size.width; ++i) {
        const cv::Point2d& r = rays[static_cast<std::size_t>(i)];
        const cv::Vec3d p = hit(origin, c.R * cv::Vec3d(r.x, r.y, 1));
        cv::Vec3d value(110, 120, 150);
        for (const Ripple& ripple : ripples)
          value += contrast * std::sin(ripple.k[0] * p[0] + ripple.k[1] * p[1] + ripple.phase) * ripple.colour;
        image.at<cv::Vec3d>(i / size.width, i % size.width) = value;
      }
    });
    return image;
  }

  cv::Mat finish(const cv::Mat& light, double gain, double offset, uint64_t seed) const {
    cv::Mat values = light * gain + cv::Scalar::all(offset), out;
    if (blur > 0) cv::GaussianBlur(values, values, {}, blur);
    if (noise > 0) {
      cv::Mat grains(size, CV_64FC3);
      cv::RNG random(seed);
      random.fill(grains, cv::RNG::NORMAL, 0, noise);
      values += grains;
    }
    values.convertTo(out, CV_8U);
    return out;
  }
};

}  // namespace cortshift_stereo_test
