#include "cortshift_tracking/surround/outline.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "cortshift_flow/text.hpp"
#include "cortshift_tracking/surround/tissue.hpp"

namespace cortshift_tracking {
namespace {

constexpr double kCell = 0.0004;         // [m] coarse enough for a cut of all of it in a fraction of a second
constexpr double kSmooth = 0.002;        // [m] pores and small vessels do not decide what tissue is
constexpr double kInner = 0.006;         // [m] from anything else: beyond any cuff of dura
constexpr double kLeastArea = 0.0003;    // [m^2] of a brain; a burr hole shows 1.5 cm2
constexpr double kLeastBorder = 0.0001;  // [m^2] of bone or cloth, as for the surround
constexpr double kSmallHole = 0.000025;  // [m^2] a glint or a shadow in the brain; more is something that lies on it
// Of what has blood in it, the part that the cut leaves: less is not brain with a cuff of dura around it.
constexpr double kLeastPart = 0.6;

/// Mean colour and share of what is seen in each cell.
struct Cells {
  int step = 1;
  cv::Mat colour;  ///< CV_32FC3 0...1
  cv::Mat seen;    ///< CV_8UC1
};

Cells cellsOf(const Projection& projection) {
  Cells cells;
  cells.step = std::max(1, static_cast<int>(std::lround(kCell / projection.resolution)));
  const cv::Size size(projection.mask.cols / cells.step, projection.mask.rows / cells.step);
  if (size.empty()) return cells;
  const cv::Rect whole(0, 0, size.width * cells.step, size.height * cells.step);
  cv::Mat share, sum;
  projection.mask(whole).convertTo(share, CV_32F, 1.0 / 255);
  cv::resize(share, share, size, 0, 0, cv::INTER_AREA);
  cv::resize(projection.colour(whole), sum, size, 0, 0, cv::INTER_AREA);  // 0 outside the mask
  cells.seen = share > 0.5;
  cv::Mat divisor;
  cv::merge(std::vector<cv::Mat>(3, cv::max(share, 0.01F)), divisor);
  cv::divide(sum, divisor, cells.colour);
  return cells;
}

cv::Mat tissueOf(const Cells& cells) {
  const int window = 2 * static_cast<int>(std::lround(kSmooth / kCell / 2)) + 1;
  cv::Mat logarithm, share;
  cv::log(cells.colour + cv::Scalar::all(1.0 / 255), logarithm);  // black has no colour, and no logarithm
  logarithm.setTo(cv::Scalar::all(0), cells.seen == 0);
  cells.seen.convertTo(share, CV_32F, 1.0 / 255);
  cv::boxFilter(logarithm, logarithm, CV_32F, cv::Size(window, window), cv::Point(-1, -1), false, cv::BORDER_CONSTANT);
  cv::boxFilter(share, share, CV_32F, cv::Size(window, window), cv::Point(-1, -1), false, cv::BORDER_CONSTANT);
  cv::Mat tissue(cells.seen.size(), CV_8UC1, cv::Scalar(static_cast<uchar>(Tissue::kNone)));
  for (int row = 0; row < tissue.rows; ++row)
    for (int column = 0; column < tissue.cols; ++column) {
      if (cells.seen.at<uchar>(row, column) == 0) continue;
      const cv::Vec3f mean = logarithm.at<cv::Vec3f>(row, column) / share.at<float>(row, column);
      tissue.at<uchar>(row, column) =
          static_cast<uchar>(tissueOfColour(mean[2] - mean[1], mean[2] + mean[0] - 2 * mean[1]));
    }
  return tissue;
}

/// The largest connected part of a mask.
cv::Mat largestPart(const cv::Mat& mask) {
  cv::Mat labels, statistics, centroids;
  const int count = cv::connectedComponentsWithStats(mask, labels, statistics, centroids, 4, CV_32S);
  int largest = 0;
  for (int label = 1; label < count; ++label)
    if (largest == 0 || statistics.at<int>(label, cv::CC_STAT_AREA) > statistics.at<int>(largest, cv::CC_STAT_AREA))
      largest = label;
  return largest == 0 ? cv::Mat::zeros(mask.size(), CV_8UC1) : cv::Mat(labels == largest);
}

void fillSmallHoles(cv::Mat& mask, int cells) {
  cv::Mat labels, statistics, centroids;
  const int count = cv::connectedComponentsWithStats(mask == 0, labels, statistics, centroids, 8, CV_32S);
  for (int label = 1; label < count; ++label)
    if (statistics.at<int>(label, cv::CC_STAT_AREA) <= cells) mask.setTo(255, labels == label);
}

/// Cuts with a random sequence of its own, so that it neither depends on what was drawn before nor changes it.
void cut(const cv::Mat& picture, cv::Mat& labels) {
  cv::RNG& random = cv::theRNG();
  const std::uint64_t before = random.state;
  random.state = 1;
  cv::Mat background, foreground;
  cv::grabCut(picture, labels, cv::Rect(), background, foreground, 5, cv::GC_INIT_WITH_MASK);
  random.state = before;
}

}  // namespace

Outline proposeOutline(const Projection& projection) {
  const Cells cells = cellsOf(projection);
  if (cells.seen.empty()) return {{}, "not known: the view is too small"};
  const double cell_area = std::pow(cells.step * projection.resolution, 2);
  const auto areaOf = [&](const cv::Mat& mask) { return cell_area * cv::countNonZero(mask); };
  const cv::Mat tissue = tissueOf(cells);
  const cv::Mat flesh = tissue == static_cast<uchar>(Tissue::kFlesh);
  const cv::Mat other = (tissue == static_cast<uchar>(Tissue::kPale)) | (tissue == static_cast<uchar>(Tissue::kCloth));
  if (areaOf(flesh) < kLeastArea) return {{}, "not known: too little in view looks like brain"};
  if (areaOf(other) < kLeastBorder)
    return {{}, "not known: no bone or cloth is in view, so that nothing tells brain from other tissue"};

  cv::Mat framed, depth;
  cv::copyMakeBorder(flesh | (cells.seen == 0), framed, 1, 1, 1, 1, cv::BORDER_CONSTANT, 255);
  cv::distanceTransform(framed, depth, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  depth = depth(cv::Rect(1, 1, flesh.cols, flesh.rows));
  const cv::Mat inner = flesh & (depth * (cells.step * projection.resolution) > kInner);
  if (areaOf(inner) < kLeastArea / 4) return {{}, "not known: what looks like brain is nowhere wide enough"};

  cv::Mat labels(flesh.size(), CV_8UC1, cv::Scalar(cv::GC_BGD));
  labels.setTo(cv::GC_PR_FGD, flesh);
  labels.setTo(cv::GC_FGD, inner);
  cv::Mat picture;
  cells.colour.convertTo(picture, CV_8UC3, 255);
  cut(picture, labels);
  cv::Mat brain = (labels == cv::GC_FGD) | (labels == cv::GC_PR_FGD);
  brain &= cells.seen;
  cv::morphologyEx(brain, brain, cv::MORPH_OPEN, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}));
  brain = largestPart(brain);
  fillSmallHoles(brain, static_cast<int>(kSmallHole / cell_area));
  if (areaOf(brain) < kLeastArea || areaOf(brain) < kLeastPart * areaOf(largestPart(flesh)))
    return {{}, "not known: no clear edge around what looks like brain"};

  Outline outline;
  cv::Mat fine;
  cv::resize(brain, fine, cv::Size(brain.cols * cells.step, brain.rows * cells.step), 0, 0, cv::INTER_LINEAR);
  outline.brain = cv::Mat::zeros(projection.mask.size(), CV_8UC1);
  cv::Mat(fine >= 128).copyTo(outline.brain(cv::Rect(0, 0, fine.cols, fine.rows)));
  outline.text = "proposed by colour and place";
  return outline;
}

}  // namespace cortshift_tracking
