#include "cortshift_tracking/surround/uncertainty.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "cortshift_flow/flow.hpp"
#include "cortshift_stereo/refinement/refinement.hpp"
#include "matching/flow_targets.hpp"
#include "parallel.hpp"

namespace cortshift_tracking {
namespace {

constexpr double kWorkingDistance = 0.3;  // [m] of a surgical microscope, where the camera's place is not known
constexpr double kMost = 0.01;            // [m] the search for a match does not reach further

bool isVector(const DisplacementField& field, int row, int column) {
  return !std::isnan(field.displacement_pmr.at<cv::Vec3f>(row, column)[0]);
}

Eigen::Vector3d startAt(const DisplacementField& field, int row, int column) {
  const cv::Vec3f& x = field.start_pmr.at<cv::Vec3f>(row, column);
  return {x[0], x[1], x[2]};
}

}  // namespace

double pixelOfDisparity(const Projection& projection, double spacing, const ProjectionFrame& frame,
                        const std::optional<PlacedCamera>& camera, double baseline) {
  double distance = kWorkingDistance;
  if (camera) {
    const Eigen::Vector3d middle(frame.resolution * frame.size.width / 2, frame.resolution * frame.size.height / 2,
                                 cv::mean(projection.height, projection.mask)[0]);
    distance = (frame.T_pmr_projection * middle - camera->T_pmr_camera.translation()).norm();
  }
  return spacing * distance / baseline;
}

cv::Mat heightErrorsOf(const Measured& measured) {
  cv::Mat later;
  cv::remap(measured.later.confidence, later, flowTargets(measured.flow), {}, cv::INTER_LINEAR, cv::BORDER_CONSTANT, 0);
  cv::Mat errors(later.size(), CV_32FC1);
  parallelRanges(errors.rows, 0, [&](int first_row, int last_row) {
    for (int row = first_row; row < last_row; ++row)
      for (int column = 0; column < errors.cols; ++column) {
        const double first = measured.earlier_pixel *
                             cortshift_stereo::deviationOf(measured.earlier.confidence.at<float>(row, column)),
                     second = measured.later_pixel * cortshift_stereo::deviationOf(later.at<float>(row, column));
        errors.at<float>(row, column) = static_cast<float>(std::min(kMost, std::hypot(first, second)));
      }
  });
  return errors;
}

cv::Mat ownErrorsOf(const Measured& measured, const cv::Mat& height_errors) {
  cv::Mat own(height_errors.size(), CV_32FC1);
  parallelRanges(own.rows, 0, [&](int first, int last) {
    for (int row = first; row < last; ++row)
      for (int column = 0; column < own.cols; ++column) {
        const double match = measured.earlier.resolution *
                             cortshift_flow::predictedError(measured.flow_confidence.at<float>(row, column)),
                     height = static_cast<double>(height_errors.at<float>(row, column));
        own.at<float>(row, column) = static_cast<float>(std::min(kMost, std::hypot(height, match)));
      }
  });
  return own;
}

cv::Mat uncertaintyOf(const DisplacementField& field, const cv::Mat& own, const Surround& surround) {
  cv::Mat uncertainty(field.displacement_pmr.size(), CV_32FC1, cv::Scalar(std::numeric_limits<float>::quiet_NaN()));
  parallelRanges(uncertainty.rows, 0, [&](int first, int last) {
    for (int row = first; row < last; ++row)
      for (int column = 0; column < uncertainty.cols; ++column) {
        if (!isVector(field, row, column)) continue;
        const double common = sdAt(surround.covariance, surround.centre, startAt(field, row, column));
        uncertainty.at<float>(row, column) = static_cast<float>(std::hypot(own.at<float>(row, column), common));
      }
  });
  return uncertainty;
}

void addBudget(Summary& summary, const DisplacementField& field, const cv::Mat& own, const Surround& surround) {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  double squares = 0, count = 0;
  for (int row = 0; row < field.displacement_pmr.rows; ++row)
    for (int column = 0; column < field.displacement_pmr.cols; ++column) {
      if (!isVector(field, row, column) || (!field.brain.empty() && field.brain.at<uchar>(row, column) == 0)) continue;
      centre += startAt(field, row, column);
      squares += std::pow(own.at<float>(row, column), 2);
      ++count;
    }
  if (count == 0) return;
  centre /= count;
  summary.common_sd = sdAt(surround.covariance, surround.centre, centre);
  const bool replaced = surround.finding == SurroundFinding::kAgrees || surround.corrected;
  for (const PoseErrorShare& share : surround.sources)
    summary.budget.push_back({share.source, share.known_from + (replaced ? "; the surround knows it better" : ""),
                              sdAt(share.covariance, surround.centre, centre)});
  if (replaced)
    summary.budget.push_back(
        {"what the surround leaves of these", "measured on what does not move", summary.common_sd});
  summary.budget.push_back(
      {"match and heights", "expected by image matching and reconstruction", std::sqrt(squares / count)});
}

}  // namespace cortshift_tracking
