#include "cortshift_tracking/surround/tissue.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace cortshift_tracking {
namespace {

constexpr double kSide = 0.002;  // [m] the window in which the images of two stages are compared

uchar is(Tissue tissue) { return static_cast<uchar>(tissue); }

}  // namespace

Pieces piecesOf(const DisplacementField& field) {
  Pieces pieces;
  const int step = std::max(1, static_cast<int>(std::lround(kSide / field.frame.resolution)));
  pieces.side = step * field.frame.resolution;
  const cv::Size grid = field.displacement_pmr.size();
  pieces.size = cv::Size(grid.width / step, grid.height / step);
  for (int row = 0; row < pieces.size.height; ++row)
    for (int column = 0; column < pieces.size.width; ++column) {
      Piece piece;
      piece.place_pmr = piece.motion_pmr = Eigen::Vector3d::Zero();
      piece.cell = {column, row};
      int count = 0;
      double squares = 0;
      double red = 0, green = 0, blue = 0;
      for (int r = row * step; r < (row + 1) * step; ++r)
        for (int c = column * step; c < (column + 1) * step; ++c) {
          const cv::Vec3f& d = field.displacement_pmr.at<cv::Vec3f>(r, c);
          if (std::isnan(d[0])) continue;
          const cv::Vec3f& x = field.start_pmr.at<cv::Vec3f>(r, c);
          const cv::Vec3b& colour = field.colour.at<cv::Vec3b>(r, c);
          piece.place_pmr += Eigen::Vector3d(x[0], x[1], x[2]);
          piece.motion_pmr += Eigen::Vector3d(d[0], d[1], d[2]);
          squares += static_cast<double>(d.dot(d));
          blue += std::log(colour[0] + 1.0);  // black has no colour, and no logarithm
          green += std::log(colour[1] + 1.0);
          red += std::log(colour[2] + 1.0);
          ++count;
        }
      if (2 * count < step * step) continue;
      piece.place_pmr /= count;
      piece.motion_pmr /= count;
      piece.spread = std::max(0.0, squares / count - piece.motion_pmr.squaredNorm());
      piece.redness = static_cast<float>((red - green) / count);
      piece.pinkness = static_cast<float>((red + blue - 2 * green) / count);
      pieces.all.push_back(piece);
    }
  return pieces;
}

Tissue tissueOfColour(float redness, float pinkness) {
  // The light's own colour is known to about a fifth; the phantom's bone, dura and brain have 0.08, 0.19 and 0.25 ...
  // 0.5 of redness and -0.10, 0.13 and 0.2 ... 0.9 of pinkness.
  constexpr float kCloth = -0.15F, kRed = 0.25F, kPink = 0.05F;
  if (redness < kCloth) return Tissue::kCloth;
  return redness < kRed && pinkness < kPink ? Tissue::kPale : Tissue::kFlesh;
}

cv::Mat tissueOf(const Pieces& pieces) {
  cv::Mat tissue(pieces.size, CV_8UC1, cv::Scalar(is(Tissue::kNone)));
  for (const Piece& piece : pieces.all)
    tissue.at<uchar>(piece.cell) = is(tissueOfColour(piece.redness, piece.pinkness));
  return tissue;
}

cv::Mat paleAround(const cv::Mat& tissue) {
  cv::Mat framed, labels;
  cv::copyMakeBorder(tissue != is(Tissue::kFlesh), framed, 1, 1, 1, 1, cv::BORDER_CONSTANT, 255);
  cv::connectedComponents(framed, labels, 4, CV_32S);
  const cv::Mat outside = labels == labels.at<int>(0, 0);
  return outside(cv::Rect(1, 1, tissue.cols, tissue.rows)) & (tissue == is(Tissue::kPale));
}

}  // namespace cortshift_tracking
