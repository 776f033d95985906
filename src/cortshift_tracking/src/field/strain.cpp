#include "cortshift_tracking/field/strain.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "cortshift_flow/range.hpp"
#include "cortshift_tracking/error.hpp"
#include "parallel.hpp"

namespace cortshift_tracking {
namespace {

constexpr int kFunctions = 4;        // earlier height; later column, row and height offsets, all in grid units
constexpr double kFewestPart = 0.3;  // of a window that must hold displacements

using Slopes = Eigen::Matrix<double, kFunctions, 2>;  // d function / d (column, row)

/// Sums over windows, as images, that the local fits need.
class LocalFits {
 public:
  LocalFits(const DisplacementField& field, int side) : side_(side) {
    const cv::Size size = field.frame.size;
    weight_ = cv::Mat::zeros(size, CV_64FC1);
    for (cv::Mat& function : functions_) function = cv::Mat::zeros(size, CV_64FC1);
    const Eigen::Isometry3d T_projection_pmr = field.frame.T_pmr_projection.inverse();
    for (int row = 0; row < size.height; ++row)
      for (int column = 0; column < size.width; ++column) {
        const cv::Vec3f& p = field.start_pmr.at<cv::Vec3f>(row, column);
        const cv::Vec3f& d = field.displacement_pmr.at<cv::Vec3f>(row, column);
        if (std::isnan(d[0])) continue;
        const Eigen::Vector3d start = T_projection_pmr * Eigen::Vector3d(p[0], p[1], p[2]) / field.frame.resolution;
        const Eigen::Vector3d motion =
            T_projection_pmr.linear() * Eigen::Vector3d(d[0], d[1], d[2]) / field.frame.resolution;
        weight_.at<double>(row, column) = 1;
        functions_[0].at<double>(row, column) = start[2];
        functions_[1].at<double>(row, column) = motion[0];
        functions_[2].at<double>(row, column) = motion[1];
        functions_[3].at<double>(row, column) = start[2] + motion[2];
      }
    columns_ = cv::Mat(size, CV_64FC1);
    rows_ = cv::Mat(size, CV_64FC1);
    for (int row = 0; row < size.height; ++row)
      for (int column = 0; column < size.width; ++column) {
        columns_.at<double>(row, column) = column;
        rows_.at<double>(row, column) = row;
      }
    const cv::Mat wx = weight_.mul(columns_), wy = weight_.mul(rows_);
    n_ = windowSum(weight_);
    x_ = windowSum(wx);
    y_ = windowSum(wy);
    xx_ = windowSum(wx.mul(columns_));
    xy_ = windowSum(wx.mul(rows_));
    yy_ = windowSum(wy.mul(rows_));
    for (int i = 0; i < kFunctions; ++i) {
      const auto at = static_cast<std::size_t>(i);
      f_[at] = windowSum(functions_[at]);
      xf_[at] = windowSum(functions_[at].mul(columns_));
      yf_[at] = windowSum(functions_[at].mul(rows_));
    }
  }

  bool isValid(int row, int column) const {
    return weight_.at<double>(row, column) != 0 && n_.at<double>(row, column) >= kFewestPart * side_ * side_;
  }

  /// Least squares slopes about the window's centre of mass; false where the points do not span a plane.
  bool slopes(int row, int column, Slopes& out) const {
    const auto at = [&](const cv::Mat& sums) { return sums.at<double>(row, column); };
    const double n = at(n_), mx = at(x_) / n, my = at(y_) / n;
    Eigen::Matrix2d moments;
    moments << at(xx_) - n * mx * mx, at(xy_) - n * mx * my, at(xy_) - n * mx * my, at(yy_) - n * my * my;
    if (!(moments.determinant() > 1e-3 * n * n)) return false;
    const Eigen::Matrix2d inverse = moments.inverse();
    for (int i = 0; i < kFunctions; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const double mean = at(f_[k]) / n;
      const Eigen::Vector2d cross(at(xf_[k]) - n * mx * mean, at(yf_[k]) - n * my * mean);
      out.row(i) = (inverse * cross).transpose();
    }
    return true;
  }

 private:
  cv::Mat windowSum(const cv::Mat& values) const {
    cv::Mat sums;
    cv::boxFilter(values, sums, CV_64F, cv::Size(side_, side_), {-1, -1}, false, cv::BORDER_CONSTANT);
    return sums;
  }

  int side_;
  cv::Mat weight_, columns_, rows_, n_, x_, y_, xx_, xy_, yy_;
  std::array<cv::Mat, kFunctions> functions_, f_, xf_, yf_;
};

/// Square roots of the eigenvalues of G^-1 g, smaller first.
Eigen::Vector2d principalStretches(const Slopes& slopes) {
  Eigen::Matrix<double, 3, 2> earlier, later;
  earlier << 1, 0, 0, 1, slopes(0, 0), slopes(0, 1);
  later << 1 + slopes(1, 0), slopes(1, 1), slopes(2, 0), 1 + slopes(2, 1), slopes(3, 0), slopes(3, 1);
  const Eigen::Matrix2d G = earlier.transpose() * earlier, g = later.transpose() * later;
  const double half_trace = 0.5 * (G.inverse() * g).trace(), determinant = g.determinant() / G.determinant();
  const double spread = std::sqrt(std::max(0.0, half_trace * half_trace - determinant));
  return {std::sqrt(std::max(0.0, half_trace - spread)), std::sqrt(half_trace + spread)};
}

}  // namespace

void StrainSettings::validate() const {
  cortshift_flow::requireRange<TrackingError>("strain_window", window, 0.0005, 0.02);
  cortshift_flow::requireRange<TrackingError>("threads", threads, 0, 256);
}

Strain surfaceStrain(const DisplacementField& field, const StrainSettings& settings) {
  settings.validate();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const cv::Size size = field.frame.size;
  Strain strain{cv::Mat(size, CV_32FC1, cv::Scalar(nan)), cv::Mat(size, CV_32FC1, cv::Scalar(nan))};
  const int side = 2 * std::max(1, static_cast<int>(std::lround(0.5 * settings.window / field.frame.resolution))) + 1;
  const LocalFits fits(field, side);
  parallelRanges(size.height, settings.threads, [&](int first, int last) {
    for (int row = first; row < last; ++row)
      for (int column = 0; column < size.width; ++column) {
        Slopes slopes;
        if (!fits.isValid(row, column) || !fits.slopes(row, column, slopes)) continue;
        const Eigen::Vector2d stretches = principalStretches(slopes);
        strain.minor.at<float>(row, column) = static_cast<float>(stretches[0] - 1);
        strain.major.at<float>(row, column) = static_cast<float>(stretches[1] - 1);
      }
  });
  return strain;
}

}  // namespace cortshift_tracking
