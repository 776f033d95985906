#include "cortshift_stereo/geometry/lens.hpp"

#include <algorithm>
#include <array>
#include <opencv2/calib3d.hpp>

namespace cortshift_stereo {
namespace {

struct Lens {
  LensModel model;
  const char* name;
  const char* terms;
  std::size_t count;
};
constexpr std::array<Lens, 3> kLenses{
    {{LensModel::kPlumbBob, "plumb_bob", "k1 k2 p1 p2 k3", 5},
     {LensModel::kRationalPolynomial, "rational_polynomial", "k1 k2 p1 p2 k3 k4 k5 k6", 8},
     {LensModel::kEquidistant, "equidistant", "k1 k2 k3 k4", 4}}};

const Lens& entryOf(LensModel model) {
  return *std::find_if(kLenses.begin(), kLenses.end(), [&](const Lens& lens) { return lens.model == model; });
}

std::vector<cv::Point2d> undistort(const CameraModel& camera, const std::vector<cv::Point2d>& pixels,
                                   const cv::Matx33d& R, const cv::Matx33d& P) {
  std::vector<cv::Point2d> out;
  if (pixels.empty()) return out;
  if (camera.lens == LensModel::kEquidistant) {
    cv::fisheye::undistortPoints(pixels, out, camera.K, camera.D, R, P);
  } else {
    // OpenCV's default stops after 5 steps of its fixed-point iteration, 0.01 px and more off towards the corners.
    const cv::TermCriteria settled(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 200, 1e-9);
    cv::undistortPoints(pixels, out, camera.K, camera.D, R, P, settled);
  }
  return out;
}

}  // namespace

std::string nameOf(LensModel lens) { return entryOf(lens).name; }

std::string termsOf(LensModel lens) { return entryOf(lens).terms; }

LensModel lensNamed(const std::string& name, const std::string& where) {
  for (const Lens& lens : kLenses)
    if (name == lens.name) return lens.model;
  throw CalibrationError(where + " is '" + name +
                         "'; plumb_bob, rational_polynomial and equidistant are supported: calibrate with one of them");
}

std::vector<double> checkedCoefficients(LensModel lens, std::vector<double> D, const std::string& where) {
  const Lens& entry = entryOf(lens);
  const std::size_t given = D.size();
  const bool perspective = lens != LensModel::kEquidistant;
  // OpenCV fills up to 8, 12 (thin prism) or 14 (tilted sensor) coefficients with zeros.
  const bool opencv_length = perspective && (given == 8 || given == 12 || given == 14);
  if (given > entry.count && opencv_length) {
    const bool zeros =
        std::all_of(D.begin() + static_cast<std::ptrdiff_t>(entry.count), D.end(), [](double d) { return d == 0; });
    if (!zeros && given > 8)
      throw CalibrationError(where + " has " + std::to_string(given) + " values, as of OpenCV's " +
                             (given == 12 ? "thin prism model (s1 s2 s3 s4)" : "tilted sensor model (tau_x tau_y)") +
                             ", which is not supported: calibrate with 5 or 8");
    if (zeros) D.resize(entry.count);
  }
  if (lens == LensModel::kPlumbBob && (given == 0 || given == 4)) D.resize(entry.count, 0.0);
  if (D.size() != entry.count)
    throw CalibrationError(where + " has " + std::to_string(given) + " values; " + entry.name + " has " +
                           std::to_string(entry.count) + ": " + entry.terms);
  return D;
}

std::vector<cv::Point2d> projectPoints(const CameraModel& camera, const std::vector<cv::Point3d>& points,
                                       const cv::Vec3d& turn, const cv::Vec3d& shift) {
  std::vector<cv::Point2d> pixels;
  if (points.empty()) return pixels;
  if (camera.lens == LensModel::kEquidistant)
    cv::fisheye::projectPoints(points, pixels, turn, shift, camera.K, camera.D);
  else
    cv::projectPoints(points, turn, shift, camera.K, camera.D, pixels);
  return pixels;
}

std::vector<cv::Point2d> directionsOf(const CameraModel& camera, const std::vector<cv::Point2d>& pixels) {
  return undistort(camera, pixels, cv::Matx33d::eye(), cv::Matx33d::eye());
}

std::vector<cv::Point2d> rectifyPoints(const CameraModel& camera, const std::vector<cv::Point2d>& pixels) {
  return undistort(camera, pixels, camera.R, camera.P.get_minor<3, 3>(0, 0));
}

cv::Mat rectifyingMap(const CameraModel& camera) {
  const cv::Matx33d P = camera.P.get_minor<3, 3>(0, 0);
  cv::Mat map_x, map_y, map;
  if (camera.lens == LensModel::kEquidistant)
    cv::fisheye::initUndistortRectifyMap(camera.K, camera.D, camera.R, P, camera.size, CV_32FC1, map_x, map_y);
  else
    cv::initUndistortRectifyMap(camera.K, camera.D, camera.R, P, camera.size, CV_32FC1, map_x, map_y);
  cv::merge(std::vector<cv::Mat>{map_x, map_y}, map);
  return map;
}

}  // namespace cortshift_stereo
