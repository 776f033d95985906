// What the two images say about the disparities.
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_stereo/refinement/refinement.hpp"

namespace cortshift_stereo {

/// Weighted sums over cells of pixels: residual r, its derivative g, both images.
struct CellSums {
  explicit CellSums(const cv::Size& size) {
    for (cv::Mat_<float>* sum : {&w, &wr, &wg, &wgr, &wgg, &left, &right}) sum->create(size);
  }
  cv::Mat_<float> w, wr, wg, wgr, wgg, left, right;
};

/// Linearised comparison of the left image with the warped right one.
class DataTerm {
 public:
  /// @param known  CV_8UC1, 255 where the left pixel may be used
  DataTerm(const RectifiedPair& pair, const cv::Mat& known) : pair_(pair), known_(known) {}

  /// @param d        CV_32FC1 [px], finite
  /// @param surface  the cells' surface at each pixel; pixels of `d` far from it do not count
  /// @param gain     of the right image, per cell
  /// @param noise    [grey levels] standard deviation of the residual
  /// @param row_step  every how many rows are summed
  CellSums sum(const cv::Mat& d, const cv::Mat& surface, const cv::Mat& gain, double noise, int cell,
               int row_step) const;

  /// Standard deviation of the residual [grey levels], robust, from pixels that are two apart: what varies slowly
  /// (gain, offset, a disparity that is a little wrong) cancels.
  double noise(const cv::Mat& d) const;

 private:
  class Row;
  void warp(int y, const float* d, const float* surface, Row& row) const;
  void add(int y, float noise2, Row& row) const;
  float residual(const cv::Mat& d, int y, int x) const;

  const RectifiedPair& pair_;
  const cv::Mat known_;
};

}  // namespace cortshift_stereo
