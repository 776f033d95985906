#include "analytic_scene.hpp"

#include <cmath>
#include <limits>
#include <opencv2/core/utility.hpp>

namespace cortshift_tracking {
namespace {

double height(double a, double b) {
  return -6.0 * (a * a + 0.7 * b * b) + 0.0006 * std::sin(400 * a + 1) * std::cos(350 * b) +
         0.0003 * std::sin(900 * b + 300 * a);
}

}  // namespace

AnalyticScene::Deformation AnalyticScene::atRest() {
  return [](double, double) { return Eigen::Vector3d(0, 0, 0); };
}

Eigen::Vector3d AnalyticScene::position_pmr(double a, double b, const Deformation& deformation) const {
  return T_pmr_scene_ * (Eigen::Vector3d(a, b, height(a, b)) + deformation(a, b));
}

Eigen::Vector2d AnalyticScene::materialAt(const Eigen::Vector3d& point_pmr, const Deformation& deformation) const {
  const Eigen::Vector3d point = T_pmr_scene_.inverse() * point_pmr;
  Eigen::Vector2d material = point.head<2>();
  for (int i = 0; i < 60; ++i) material = point.head<2>() - deformation(material[0], material[1]).head<2>();
  return material;
}

Eigen::Vector3d AnalyticScene::displacement_pmr(const Eigen::Vector3d& point_pmr, const Deformation& from,
                                                const Deformation& to) const {
  const Eigen::Vector2d m = materialAt(point_pmr, from);
  return T_pmr_scene_.linear() * (to(m[0], m[1]) - from(m[0], m[1]));
}

PinholeCamera AnalyticScene::cameraAt(double standoff, double tilt, double shift, double roll, cv::Size size,
                                      double field) const {
  Eigen::Isometry3d T_scene_camera = Eigen::Isometry3d::Identity();
  T_scene_camera.rotate(Eigen::AngleAxisd(M_PI + tilt, Eigen::Vector3d::UnitX()));  // z forward looks down
  T_scene_camera.rotate(Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ()));
  T_scene_camera.pretranslate(Eigen::Vector3d(shift, 0, 0) - standoff * T_scene_camera.linear().col(2));
  return {T_pmr_scene_ * T_scene_camera, size.width * standoff / field, size};
}

cortshift_stereo::Surface AnalyticScene::see(const PinholeCamera& camera, const Deformation& deformation) const {
  const Eigen::Isometry3d T_camera_pmr = camera.T_pmr_camera.inverse();
  const double cx = 0.5 * (camera.size.width - 1), cy = 0.5 * (camera.size.height - 1);
  const auto pixelOf = [&](const Eigen::Vector2d& m) -> Eigen::Vector2d {
    const Eigen::Vector3d p = T_camera_pmr * position_pmr(m[0], m[1], deformation);
    return {camera.focal_px * p[0] / p[2] + cx, camera.focal_px * p[1] / p[2] + cy};
  };
  const auto materialSeenAt = [&](const Eigen::Vector2d& pixel, Eigen::Vector2d m) {
    for (int i = 0; i < 20; ++i) {
      const Eigen::Vector2d at = pixelOf(m);
      if ((pixel - at).norm() < 1e-9) break;
      constexpr double kStep = 1e-7;
      Eigen::Matrix2d J;
      J << (pixelOf(m + Eigen::Vector2d(kStep, 0)) - at) / kStep, (pixelOf(m + Eigen::Vector2d(0, kStep)) - at) / kStep;
      m += J.inverse() * (pixel - at);
    }
    return m;
  };
  cortshift_stereo::Surface surface;
  surface.points.create(camera.size, CV_32FC3);
  surface.colour.create(camera.size, CV_8UC3);
  surface.confidence = cv::Mat(camera.size, CV_32FC1, cv::Scalar(1));
  cv::parallel_for_(cv::Range(0, camera.size.height), [&](const cv::Range& rows) {
    for (int row = rows.start; row < rows.end; ++row) {
      Eigen::Vector2d m(0, 0);
      for (int column = 0; column < camera.size.width; ++column) {
        m = materialSeenAt({column, row}, m);
        const Eigen::Vector3d p = position_pmr(m[0], m[1], deformation);
        surface.points.at<cv::Vec3f>(row, column) =
            cv::Vec3f(static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2]));
        cv::Vec3f light(0, 0, 0);  // of the pixel's area
        for (int part = 0; part < 4; ++part) {
          const Eigen::Vector2d corner(column + 0.25 - 0.5 * (part % 2), row + 0.25 - 0.5 * (part / 2));
          const Eigen::Vector2d n = materialSeenAt(corner, m);
          light += 0.25F * texture_.colour(n[0], n[1]);
        }
        for (int c = 0; c < 3; ++c)
          surface.colour.at<cv::Vec3b>(row, column)[c] = cv::saturate_cast<uchar>(255.0F * light[c]);
      }
    }
  });
  return surface;
}

AnalyticScene standardScene() {
  Eigen::Isometry3d T_pmr_scene = Eigen::Isometry3d::Identity();
  T_pmr_scene.translate(Eigen::Vector3d(-0.062, 0.021, 0.043));
  T_pmr_scene.rotate(Eigen::AngleAxisd(-1.1, Eigen::Vector3d(0.2, 1, 0.3).normalized()));
  return AnalyticScene(T_pmr_scene);
}

AnalyticScene::Deformation sagAndShift(double depth, double lateral) {
  return [=](double a, double b) -> Eigen::Vector3d {
    constexpr double kReach = 0.012;  // [m]
    const double fade = std::exp(-(a * a + b * b) / (2 * kReach * kReach));
    return {lateral * fade, -0.4 * lateral * fade, -depth * fade};
  };
}

}  // namespace cortshift_tracking
