// OpenCV's calibration of one camera and of both, with each lens and some of its terms.
#pragma once

#include <functional>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <string>
#include <vector>

#include "cortshift_stereo/calibration/stereo/stereo_calibration.hpp"

namespace cortshift_stereo {

constexpr int kPaperLens = cv::CALIB_FIX_K2 | cv::CALIB_FIX_K3 | cv::CALIB_ZERO_TANGENT_DIST;  ///< k1
constexpr int kRadialLens = cv::CALIB_FIX_K3 | cv::CALIB_ZERO_TANGENT_DIST;                    ///< k1 k2
constexpr int kTangentialLens = cv::CALIB_FIX_K3;                                              ///< k1 k2 p1 p2

/// Point lists as OpenCV's calibration wants them.
struct PointLists {
  std::vector<std::vector<cv::Point3f>> board;
  std::vector<std::vector<cv::Point2f>> left, right;

  PointLists(const Board& shape, const std::vector<BoardPair>& pairs);
};

/// One camera alone.
struct SingleCamera {
  cv::Matx33d K;
  std::vector<double> D;
  std::vector<cv::Mat> turns, shifts;                                ///< the board's pose per view
  std::vector<double> view_rms;                                      ///< [px]
  double focal_deviation = std::numeric_limits<double>::infinity();  ///< relative
};

/// @param flags  of OpenCV's calibration
SingleCamera calibrateOne(const std::vector<std::vector<cv::Point3f>>& board,
                          const std::vector<std::vector<cv::Point2f>>& seen, const cv::Size& size, int flags);

/// Both cameras with plumb_bob or more, from a start of each. @param flags  of OpenCV's calibration
StereoParameters calibrateBoth(const PointLists& points, const StereoParameters& start, int flags);

/// Fits of one lens with more and more terms.
using JointFit = std::function<StereoParameters(const Board&, const std::vector<BoardPair>&, const StereoParameters&)>;
struct NamedFit {
  std::string name;
  JointFit fit;
};

/// From few to many terms.
std::vector<NamedFit> fitsOf(LensModel lens);

}  // namespace cortshift_stereo
