#include "cortshift_stereo_phantom/phantom_cameras.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

#include "cortshift_stereo/geometry/lens.hpp"

namespace cortshift_stereo_phantom {
namespace {

// The lens models by their formulas, with derivatives, so that their inverse is exact: the truth owes nothing to the
// code that it judges.

using cortshift_stereo::LensModel;

/// The factor on x and y at the squared radius r2, and its derivative by r2.
struct Radial {
  double factor, slope;
};

/// 1 + a r2 + b r2^2 + c r2^3
Radial cubic(double a, double b, double c, double r2) {
  return {1 + r2 * (a + r2 * (b + r2 * c)), a + r2 * (2 * b + r2 * 3 * c)};
}

Radial equidistantRadial(const std::array<double, 8>& k, double r2) {
  constexpr double kParaxial = 1e-8;
  if (r2 < kParaxial) return {1 + (k[0] - 1.0 / 3) * r2, k[0] - 1.0 / 3};
  const double r = std::sqrt(r2), angle = std::atan(r), a2 = angle * angle;
  const double seen = angle * (1 + a2 * (k[0] + a2 * (k[1] + a2 * (k[2] + a2 * k[3]))));
  const double growth = 1 + a2 * (3 * k[0] + a2 * (5 * k[1] + a2 * (7 * k[2] + a2 * 9 * k[3])));
  return {seen / r, (growth / (1 + r2) - seen / r) / (2 * r2)};
}

Radial radialOf(LensModel lens, const std::array<double, 8>& k, double r2) {
  if (lens == LensModel::kEquidistant) return equidistantRadial(k, r2);
  const Radial above = cubic(k[0], k[1], k[4], r2), below = cubic(k[5], k[6], k[7], r2);
  return {above.factor / below.factor,
          (above.slope * below.factor - above.factor * below.slope) / (below.factor * below.factor)};
}

/// Distorted coordinates and their derivatives by the undistorted ones.
Eigen::Vector2d distortBy(LensModel lens, const std::array<double, 8>& k, const Eigen::Vector2d& p,
                          Eigen::Matrix2d* derivative) {
  const double x = p.x(), y = p.y(), r2 = x * x + y * y;
  const auto [factor, slope] = radialOf(lens, k, r2);
  const bool tangential = lens != LensModel::kEquidistant;
  const double p1 = tangential ? k[2] : 0, p2 = tangential ? k[3] : 0;
  if (derivative != nullptr) {
    const double cross = 2 * slope * x * y + 2 * p1 * x + 2 * p2 * y;
    *derivative << factor + 2 * slope * x * x + 2 * p1 * y + 6 * p2 * x, cross, cross,
        factor + 2 * slope * y * y + 6 * p1 * y + 2 * p2 * x;
  }
  return {x * factor + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * factor + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
}

std::array<double, 8> eight(const std::vector<double>& D) {
  std::array<double, 8> k{};
  std::copy(D.begin(), D.end(), k.begin());
  return k;
}

/// Where a direction (x, y, 1) is seen in the plane z = 1 behind the lens.
Eigen::Vector2d distort(LensModel lens, const std::vector<double>& D, const Eigen::Vector2d& direction) {
  return distortBy(lens, eight(D), direction, nullptr);
}

/// The direction that is seen there, to 1e-15.
Eigen::Vector2d undistort(LensModel lens, const std::vector<double>& D, const Eigen::Vector2d& seen) {
  const std::array<double, 8> k = eight(D);
  Eigen::Vector2d p = seen;
  for (int i = 0; i < 20; ++i) {
    Eigen::Matrix2d derivative;
    const Eigen::Vector2d error = distortBy(lens, k, p, &derivative) - seen;
    p -= derivative.inverse() * error;
    if (error.squaredNorm() < 1e-30) break;
  }
  return p;
}

cv::Matx33d toCv(const Eigen::Matrix3d& m) {
  return {m(0, 0), m(0, 1), m(0, 2), m(1, 0), m(1, 1), m(1, 2), m(2, 0), m(2, 1), m(2, 2)};
}

Eigen::Matrix3d toEigen(const cv::Matx33d& m) {
  Eigen::Matrix3d out;
  out << m(0, 0), m(0, 1), m(0, 2), m(1, 0), m(1, 1), m(1, 2), m(2, 0), m(2, 1), m(2, 2);
  return out;
}

Eigen::Matrix3d rotationVector(const Eigen::Vector3d& v) {
  const double angle = v.norm();
  if (angle == 0) return Eigen::Matrix3d::Identity();
  return Eigen::AngleAxisd(angle, v / angle).toRotationMatrix();
}

cortshift_stereo::CameraModel rawCamera(const CameraSettings& settings, double focal, const Eigen::Vector2d& offset,
                                        const std::vector<double>& distortion) {
  cortshift_stereo::CameraModel camera;
  camera.size = settings.size;
  camera.K = {focal, 0,     0.5 * (settings.size.width - 1) + offset.x(),
              0,     focal, 0.5 * (settings.size.height - 1) + offset.y(),
              0,     0,     1};
  camera.lens = settings.lens;
  camera.D = cortshift_stereo::checkedCoefficients(camera.lens, distortion, "cameras: distortion");
  return camera;
}

View placedView(const cortshift_stereo::CameraModel& camera, const LightSettings& light,
                const Eigen::Isometry3d& T_pmr_head) {
  View view;
  view.size = camera.size;
  view.lamp_pmr = T_pmr_head * light.position_head;
  return view;
}

/// Rectified direction that the middle of the raw image looks along.
Eigen::Vector2d rectifiedMiddle(const cortshift_stereo::CameraModel& camera) {
  const Eigen::Vector2d middle((0.5 * (camera.size.width - 1) - camera.K(0, 2)) / camera.K(0, 0),
                               (0.5 * (camera.size.height - 1) - camera.K(1, 2)) / camera.K(1, 1));
  const Eigen::Vector3d ray = toEigen(camera.R) * undistort(camera.lens, camera.D, middle).homogeneous();
  return ray.hnormalized();
}

}  // namespace

Eigen::Vector2d View::direction(double u, double v) const {
  return undistort(lens, D, {(u - K(0, 2)) / K(0, 0), (v - K(1, 2)) / K(1, 1)});
}

std::optional<Eigen::Vector2d> View::project(const Eigen::Vector3d& point_pmr) const {
  const Eigen::Vector3d p = T_pmr_camera.inverse() * point_pmr;
  if (p.z() <= 0) return std::nullopt;
  const Eigen::Vector2d d = distort(lens, D, p.hnormalized());
  return Eigen::Vector2d(K(0, 0) * d.x() + K(0, 2), K(1, 1) * d.y() + K(1, 2));
}

StereoHead makeStereoHead(const CameraSettings& settings) {
  StereoHead head;
  const double vergence = std::atan2(0.5 * settings.baseline, settings.working_distance);
  const Eigen::Vector3d half(0.5 * settings.baseline, 0, 0);
  head.T_head_left = Eigen::Translation3d(-half) * Eigen::AngleAxisd(vergence, Eigen::Vector3d::UnitY());
  head.T_head_right = Eigen::Translation3d(half) * Eigen::AngleAxisd(-vergence, Eigen::Vector3d::UnitY()) *
                      Eigen::Isometry3d(rotationVector(settings.right_misalignment));

  const double focal = settings.size.width * settings.working_distance / settings.field_of_view;
  head.model.left = rawCamera(settings, focal, settings.left_principal_offset, settings.left_distortion);
  head.model.right = rawCamera(settings, focal * settings.right_focal_ratio, settings.right_principal_offset,
                               settings.right_distortion);

  // Rectified axes in the head: x along the baseline, z as near as can be to both optical axes.
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX();
  const Eigen::Vector3d ahead = head.T_head_left.linear().col(2) + head.T_head_right.linear().col(2);
  const Eigen::Vector3d y = ahead.cross(x).normalized();
  Eigen::Matrix3d R_rectified_head;
  R_rectified_head << x.transpose(), y.transpose(), x.cross(y).transpose();
  head.model.left.R = toCv(R_rectified_head * head.T_head_left.linear());
  head.model.right.R = toCv(R_rectified_head * head.T_head_right.linear());

  const double f = 0.5 * focal * (1 + settings.right_focal_ratio);
  const Eigen::Vector2d left = rectifiedMiddle(head.model.left), right = rectifiedMiddle(head.model.right);
  const double cx = 0.5 * (settings.size.width - 1), cy = 0.5 * (settings.size.height - 1);
  const double common_cy = cy - f * 0.5 * (left.y() + right.y());
  head.model.left.P = {f, 0, cx - f * left.x(), 0, 0, f, common_cy, 0, 0, 0, 1, 0};
  head.model.right.P = {f, 0, cx - f * right.x(), -f * settings.baseline, 0, f, common_cy, 0, 0, 0, 1, 0};
  return head;
}

StereoHead atSetting(const StereoHead& reference, const CameraSettings& settings, double magnification,
                     double focal_length) {
  StereoHead head = reference;
  if (!settings.zoom) return head;
  const ZoomSettings& zoom = *settings.zoom;
  const double m = magnification / zoom.magnification, f = focal_length / zoom.focal_length;
  const double scale = m * std::pow(f, -zoom.focal_power) * (1 + zoom.breathing * (m - 1) * (m - 1));
  const Eigen::Vector2d drift = (m - 1) * zoom.drift_zoom + (f - 1) * zoom.drift_focus;
  for (const Side side : {Side::kLeft, Side::kRight}) {
    auto& camera = side == Side::kLeft ? head.model.left : head.model.right;
    const double sign = side == Side::kLeft ? 1 : -1;
    camera.K(0, 0) *= scale;
    camera.K(1, 1) *= scale;
    camera.K(0, 2) += sign * drift.x();
    camera.K(1, 2) += sign * drift.y();
    camera.D[0] += (m - 1) * zoom.distortion.x() + (f - 1) * zoom.distortion.y();
    Eigen::Isometry3d& T_head_camera = side == Side::kLeft ? head.T_head_left : head.T_head_right;
    T_head_camera = T_head_camera * Eigen::Translation3d(0, 0, (m - 1) * zoom.pupil_travel);
  }
  return head;
}

Eigen::Isometry3d placeHead(const PlacementSettings& placement) {
  // Without tilt and roll the head looks down on the brain: x as the brain's, y and z against it.
  const Eigen::Matrix3d down = Eigen::Vector3d(1, -1, -1).asDiagonal();
  Eigen::Isometry3d T_brain_head = Eigen::Isometry3d::Identity();
  T_brain_head.linear() = (Eigen::AngleAxisd(placement.tilt.x(), Eigen::Vector3d::UnitX()) *
                           Eigen::AngleAxisd(placement.tilt.y(), Eigen::Vector3d::UnitY()))
                              .toRotationMatrix() *
                          down * Eigen::AngleAxisd(placement.roll, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Eigen::Vector3d target(placement.target.x(), placement.target.y(), 0);
  T_brain_head.translation() = target - placement.distance * T_brain_head.linear().col(2);
  return T_brain_head;
}

View rawView(const StereoHead& head, const LightSettings& light, Side side, const Eigen::Isometry3d& T_pmr_head) {
  const auto& camera = side == Side::kLeft ? head.model.left : head.model.right;
  View view = placedView(camera, light, T_pmr_head);
  view.K = camera.K;
  view.lens = camera.lens;
  view.D = camera.D;
  view.T_pmr_camera = T_pmr_head * (side == Side::kLeft ? head.T_head_left : head.T_head_right);
  return view;
}

View rectifiedView(const StereoHead& head, const LightSettings& light, Side side, const Eigen::Isometry3d& T_pmr_head) {
  const auto& camera = side == Side::kLeft ? head.model.left : head.model.right;
  View view = placedView(camera, light, T_pmr_head);
  view.K = camera.P.get_minor<3, 3>(0, 0);
  view.T_pmr_camera = T_pmr_head * (side == Side::kLeft ? head.T_head_left : head.T_head_right);
  view.T_pmr_camera.linear() = view.T_pmr_camera.linear() * toEigen(camera.R).transpose();
  return view;
}

}  // namespace cortshift_stereo_phantom
