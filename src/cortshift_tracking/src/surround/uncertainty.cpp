#include "cortshift_tracking/surround/uncertainty.hpp"

#include <cmath>
#include <limits>

namespace cortshift_tracking {
namespace {

// [m] of a right vector: of a normal error 95 % are within 2.8 standard deviations of one of three coordinates, and a
// right vector is right to 0.25 mm. Where the surround shows how much single vectors scatter, that counts.
constexpr double kRight = 0.00025 / 2.8 * 1.732;
constexpr double kWrong = 0.0005;  // [m] of a wrong one: it is wrong from 0.25 mm on, and a few are by millimetres

double ownVariance(double confidence, const Surround& surround) {
  const double right = surround.vector_sd > 0 ? surround.vector_sd : kRight;
  return confidence * right * right + (1 - confidence) * kWrong * kWrong;
}

bool isVector(const DisplacementField& field, int row, int column) {
  return !std::isnan(field.displacement_pmr.at<cv::Vec3f>(row, column)[0]);
}

Eigen::Vector3d startAt(const DisplacementField& field, int row, int column) {
  const cv::Vec3f& x = field.start_pmr.at<cv::Vec3f>(row, column);
  return {x[0], x[1], x[2]};
}

}  // namespace

cv::Mat uncertaintyOf(const DisplacementField& field, const Surround& surround) {
  cv::Mat uncertainty(field.displacement_pmr.size(), CV_32FC1, cv::Scalar(std::numeric_limits<float>::quiet_NaN()));
  for (int row = 0; row < uncertainty.rows; ++row)
    for (int column = 0; column < uncertainty.cols; ++column) {
      if (!isVector(field, row, column)) continue;
      const double common = sdAt(surround.covariance, surround.centre, startAt(field, row, column));
      uncertainty.at<float>(row, column) = static_cast<float>(
          std::sqrt(ownVariance(field.confidence.at<float>(row, column), surround) + common * common));
    }
  return uncertainty;
}

void addBudget(Summary& summary, const DisplacementField& field, const Surround& surround) {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  double own = 0, count = 0;
  for (int row = 0; row < field.displacement_pmr.rows; ++row)
    for (int column = 0; column < field.displacement_pmr.cols; ++column) {
      if (!isVector(field, row, column) || (!field.brain.empty() && field.brain.at<uchar>(row, column) == 0)) continue;
      centre += startAt(field, row, column);
      own += ownVariance(field.confidence.at<float>(row, column), surround);
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
  summary.budget.push_back({"match and heights",
                            surround.vector_sd > 0 ? "measured on what does not move, and confidence" : "confidence",
                            std::sqrt(own / count)});
}

}  // namespace cortshift_tracking
