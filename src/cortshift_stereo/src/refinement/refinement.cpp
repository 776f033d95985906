#include "cortshift_stereo/refinement/refinement.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "cortshift_flow/confidence.hpp"
#include "rectification/fill.hpp"
#include "refinement/cells.hpp"
#include "refinement/data_term.hpp"
#include "refinement/thin_plate.hpp"

namespace cortshift_stereo {
namespace {

// Chosen on phantoms with and without noise; the same at every site.
constexpr double kSmoothness = 2e3;         // mu [px^2]: weight of bending against data
constexpr double kTypicalBending = 0.0021;  // [px / px^2] above it psi grows only slowly
constexpr double kCorrelatedPixels = 10;    // neighbours share their noise: images are blurred before resampling
constexpr double kPhotometricReach = 24;    // [px] over which gain and offset vary
constexpr double kTrustInStart = 0.05;      // [1/px^2] per pixel: keeps the start where there is no texture
constexpr int kFinestCell = 4;              // [px]
constexpr int kSteps = 14;

constexpr double kHalfConfidence = 0.1;  // [px] deviation

/// Stiffness of each cell: mu, and less where the surface bends more than tissue does between its folds. There it falls
/// with the square of the bending, so that the bottom of a narrow fold is not flattened.
cv::Mat bendingWeights(const cv::Mat& cells, int cell) {
  const double typical = kTypicalBending * cell * cell;
  const cv::Mat bending = squaredBending(cells);
  const cv::Mat softer = (1 + bending / (typical * typical)).mul(1 + bending);
  return kSmoothness / (static_cast<double>(cell) * cell) / softer;
}

/// Expected error of each cell [px]. The posterior deviation of a stiff sheet that is fitted to data falls with the
/// information of the data and with the stiffness; the scale was fitted to phantoms, where it holds within a factor of
/// two from 0.01 to 0.5 px.
cv::Mat deviationOfCells(const cv::Mat& information, const cv::Mat& stiffness) {
  constexpr double kScale = 1.6;
  constexpr double kLeastStiffness = 1;  // at an edge of depth only the data count
  cv::Mat deviation;
  const cv::Mat stiff = cv::max(blurCells(stiffness, 0.7), kLeastStiffness);
  cv::pow(blurCells(information, 1.0).mul(stiff) + 1e-9, -0.5, deviation);
  return kScale * deviation;
}

}  // namespace

RefinedDisparity refineDisparity(const RectifiedPair& pair, const cv::Mat& start) {
  CV_Assert(start.type() == CV_32FC1 && start.size() == pair.left.size());
  const cv::Size size = start.size();
  const cv::Mat known = start == start;
  const DataTerm data(pair, known & pair.left_usable);
  RefinedDisparity out;
  cv::Mat& d = out.disparity;
  d = smoothBelowAPixel(fillUnknown(start, known));
  const cv::Mat begin = d.clone();
  cv::Mat gain, last_information, last_stiffness;
  struct Level {
    int cell, rounds;
  };
  for (const Level& level : {Level{2 * kFinestCell, 2}, Level{kFinestCell, 2}}) {
    const int cell = level.cell;
    const double reach = kPhotometricReach / cell;
    cv::Mat cells = meanOfCells(d, cell), surface = surfaceThrough(cells, size, cell);
    const cv::Mat start_cells = last_information.empty() ? cells.clone() : meanOfCells(begin, cell);
    const cv::Mat trust_in_start = kTrustInStart * cell * cell * shareOfCells(known, cell);
    const double noise = data.noise(d);
    if (gain.empty())
      gain = cv::Mat(cells.size(), CV_32FC1, cv::Scalar(1));
    else
      cv::resize(gain, gain, cells.size(), 0, 0, cv::INTER_LINEAR);
    for (int round = 0; round < level.rounds; ++round) {
      const bool last = cell == kFinestCell && round + 1 == level.rounds;
      const int row_step = last ? 1 : 2;  // every second row is enough before the last step
      const CellSums sums = data.sum(d, surface, gain, noise, cell, row_step);
      const cv::Mat offset = blurCells(sums.wr, reach) / (blurCells(sums.w, reach) + 1e-9f);
      const cv::Mat right = blurCells(sums.right, reach);
      gain = blurCells(sums.left, reach) / (right + 1e-3f);
      gain.setTo(1, right < 1);
      const double share = row_step / kCorrelatedPixels;
      const cv::Mat information = sums.wgg * share + trust_in_start;
      const cv::Mat gradient = (sums.wgr - offset.mul(sums.wg)) * share + trust_in_start.mul(cells - start_cells);
      last_stiffness = bendingWeights(cells, cell);
      const cv::Mat step = solveThinPlate(information, gradient, last_stiffness, cells, kSteps);
      cells += cv::min(cv::max(step, -1.0), 1.0);
      const cv::Mat next = surfaceThrough(cells, size, cell);
      follow(d, surface, next);
      surface = next;
      last_information = information;
    }
  }
  out.deviation = surfaceThrough(deviationOfCells(last_information, last_stiffness), size, kFinestCell).clone();
  return out;
}

double deviationOf(double confidence) { return cortshift_flow::errorOfConfidence(confidence, kHalfConfidence); }

cv::Mat confidenceOf(const cv::Mat& deviation) {
  CV_Assert(deviation.type() == CV_32FC1);
  cv::Mat confidence(deviation.size(), CV_32FC1);
  cv::parallel_for_(cv::Range(0, deviation.rows), [&](const cv::Range& rows) {
    constexpr auto kScale = static_cast<float>(1 / (kHalfConfidence * kHalfConfidence));
    for (int y = rows.start; y < rows.end; ++y) {
      const float* from = deviation.ptr<float>(y);
      float* to = confidence.ptr<float>(y);
      for (int x = 0; x < deviation.cols; ++x) {
        const float value = cortshift_flow::confidenceOfSquares(kScale * from[x] * from[x]);
        to[x] = value > 0 ? value : 0;  // for NaN too
      }
    }
  });
  return confidence;
}

}  // namespace cortshift_stereo
