#include "surround/resting_scene.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace cortshift_tracking {
namespace {

constexpr double kResolution = 0.0004;
constexpr int kColumns = 200, kRows = 150;

double xOf(int column) { return (column - kColumns / 2) * kResolution; }
double yOf(int row) { return (row - kRows / 2) * kResolution; }

ProjectionFrame frame() {
  ProjectionFrame out;
  out.T_pmr_projection.linear() = Eigen::AngleAxisd(1.1, Eigen::Vector3d(0.4, -0.8, 0.3).normalized()).matrix();
  out.T_pmr_projection.translation() = Eigen::Vector3d(-0.062, 0.031, 0.044);
  out.resolution = kResolution;
  out.size = cv::Size(kColumns, kRows);
  return out;
}

cv::Vec3f local(const Eigen::Vector3d& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

double heightAt(double x, double y) { return -(x * x + y * y) / (2 * 0.075); }

Eigen::Vector3d pointAt(int row, int column) {
  return frame().T_pmr_projection *
         Eigen::Vector3d(column * kResolution, row * kResolution, heightAt(xOf(column), yOf(row)));
}

}  // namespace

Eigen::Vector3d RestingScene::middle_pmr() { return pointAt(kRows / 2, kColumns / 2); }

RestingScene::Matter RestingScene::matterAt(double x, double y) const {
  const double r = std::hypot(x / radius_x, y / radius_y);
  const double outside = (r - 1) * std::min(radius_x, radius_y);
  const Matter matter = outside < 0 ? kBrain : outside < 0.0022 ? kDura : outside < bone ? kBone : kDrape;
  return cover ? cover(x, y, matter) : matter;
}

DisplacementField RestingScene::made(const Eigen::Isometry3d& drift, double with_noise) const {
  const cv::Vec3b colours[] = {{150, 150, 205}, {158, 168, 204}, {158, 189, 204}, {133, 102, 41}, {228, 232, 236}};
  const float nan = std::numeric_limits<float>::quiet_NaN();
  DisplacementField field;
  field.frame = frame();
  field.start_pmr = cv::Mat(field.frame.size, CV_32FC3, cv::Scalar::all(nan));
  field.displacement_pmr = field.start_pmr.clone();
  field.colour = cv::Mat::zeros(field.frame.size, CV_8UC3);
  field.confidence = cv::Mat::zeros(field.frame.size, CV_32FC1);
  cv::RNG random(seed);
  cv::Mat errors(field.frame.size, CV_32FC3);
  random.fill(errors, cv::RNG::NORMAL, 0, 1);
  cv::GaussianBlur(errors, errors, cv::Size(), 2.0);  // [grid points], 0.8 mm: hangs together over about 2 mm
  errors *= with_noise * 2 * std::sqrt(M_PI) * 2.0;   // what the blur took
  for (int row = 0; row < kRows; ++row)
    for (int column = 0; column < kColumns; ++column) {
      const double x = xOf(column), y = yOf(row);
      const Matter matter = matterAt(x, y);
      if (matter == kNothing) continue;
      const double r = std::hypot(x / radius_x, y / radius_y);
      const double inside = std::clamp((1 - r) * std::min(radius_x, radius_y) / 0.012, 0.0, 1.0);
      Eigen::Vector3d d(0, 0, matter == kBrain || matter == kCotton ? -sag * inside * inside * (3 - 2 * inside) : 0);
      if (movement) d += movement(x, y, matter);
      const Eigen::Vector3d start = pointAt(row, column);
      const cv::Vec3f& e = errors.at<cv::Vec3f>(row, column);
      const Eigen::Vector3d end = drift * Eigen::Vector3d(start + field.frame.T_pmr_projection.linear() * d);
      field.start_pmr.at<cv::Vec3f>(row, column) = local(start);
      field.displacement_pmr.at<cv::Vec3f>(row, column) = local(end - start + Eigen::Vector3d(e[0], e[1], e[2]));
      field.colour.at<cv::Vec3b>(row, column) = colours[matter];
      field.confidence.at<float>(row, column) = 0.99F;
    }
  return field;
}

DisplacementField RestingScene::seen(const Eigen::Isometry3d& drift) const { return made(drift, noise); }

cv::Mat RestingScene::truth() const { return made(Eigen::Isometry3d::Identity(), 0).displacement_pmr; }

cv::Mat RestingScene::brain() const {
  cv::Mat mask = cv::Mat::zeros(kRows, kColumns, CV_8UC1);
  for (int row = 0; row < kRows; ++row)
    for (int column = 0; column < kColumns; ++column)
      if (matterAt(xOf(column), yOf(row)) == kBrain) mask.at<uchar>(row, column) = 255;
  return mask;
}

Eigen::Isometry3d RestingScene::drift(unsigned seed, double translation, double rotation) {
  cv::RNG random(seed);
  const auto direction = [&] {
    return Eigen::Vector3d(random.gaussian(1), random.gaussian(1), random.gaussian(1)).normalized();
  };
  const Eigen::Vector3d way = translation * direction();
  return Eigen::Translation3d(middle_pmr() + way) * Eigen::AngleAxisd(rotation, direction()) *
         Eigen::Translation3d(-middle_pmr());
}

ErrorsAgainst errorsOnBrain(const cv::Mat& displacements, const RestingScene& scene) {
  const cv::Mat truth = scene.truth(), brain = scene.brain();
  std::vector<double> errors;
  double squares = 0;
  for (int row = 0; row < brain.rows; ++row)
    for (int column = 0; column < brain.cols; ++column) {
      const cv::Vec3f& d = displacements.at<cv::Vec3f>(row, column);
      if (brain.at<uchar>(row, column) == 0 || std::isnan(d[0])) continue;
      errors.push_back(cv::norm(d - truth.at<cv::Vec3f>(row, column)));
      squares += errors.back() * errors.back();
    }
  std::sort(errors.begin(), errors.end());
  return {errors[errors.size() / 2], errors[errors.size() * 95 / 100],
          std::sqrt(squares / static_cast<double>(errors.size()))};
}

}  // namespace cortshift_tracking
