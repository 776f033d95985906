#include "refinement/thin_plate.hpp"

#include <vector>

namespace cortshift_stereo {
namespace {

/// Second differences at an inner cell of a row-continuous grid.
struct Differences {
  float xx, yy, xy;
};

inline Differences differences(const float* c, int width) {
  return {c[-1] - 2 * c[0] + c[1], c[-width] - 2 * c[0] + c[width],
          0.25f * (c[-width - 1] - c[-width + 1] - c[width - 1] + c[width + 1])};
}

/// to = H' bending H from, with H the stack of the second differences (xy twice).
class Bending {
 public:
  explicit Bending(const cv::Mat& weights)
      : weights_(weights), xx_(weights.size(), 0.0f), yy_(weights.size(), 0.0f), xy_(weights.size(), 0.0f) {}

  /// Diagonal of the operator.
  cv::Mat_<float> diagonal() const {
    cv::Mat_<float> out(weights_.size(), 0.0f);
    for (int y = 1; y < weights_.rows - 1; ++y)
      for (int x = 1; x < weights_.cols - 1; ++x) {
        const float w = weights_.at<float>(y, x);
        out(y, x) += 8 * w;
        for (const int s : {-1, 1}) {
          out(y, x + s) += w;
          out(y + s, x) += w;
          out(y + s, x - 1) += 0.125f * w;
          out(y + s, x + 1) += 0.125f * w;
        }
      }
    return out;
  }

  void apply(const cv::Mat_<float>& from, cv::Mat_<float>& to) {
    cv::parallel_for_(
        cv::Range(1, from.rows - 1), [&](const cv::Range& rows) { bend(rows, from); }, kStripes);
    cv::parallel_for_(
        cv::Range(0, from.rows), [&](const cv::Range& rows) { unbend(rows, to); }, kStripes);
  }

 private:
  static constexpr double kStripes = 4;

  void bend(const cv::Range& rows, const cv::Mat_<float>& from) {
    const int width = from.cols;
    for (int y = rows.start; y < rows.end; ++y) {
      const float *c = from[y], *w = weights_.ptr<float>(y);
      float *xx = xx_[y], *yy = yy_[y], *xy = xy_[y];
      for (int x = 1; x < width - 1; ++x) {
        const Differences d = differences(c + x, width);
        xx[x] = w[x] * d.xx;
        yy[x] = w[x] * d.yy;
        xy[x] = 0.5f * w[x] * d.xy;  // 2 (xy counts twice) times 1/4 (1/2 from d.xy, 1/2 from its transpose)
      }
    }
  }

  void unbend(const cv::Range& rows, cv::Mat_<float>& to) const {
    const int width = to.cols, height = to.rows;
    // The rims of xx_, yy_ and xy_ stay 0, so the transpose only has to leave out what lies outside the grid.
    for (int y = rows.start; y < rows.end; ++y) {
      float* out = to[y];
      const float *xx = xx_[y], *yy = yy_[y];
      const float *yy_up = yy_[y > 0 ? y - 1 : 0], *yy_down = yy_[y + 1 < height ? y + 1 : y];
      const float *xy_up = xy_[y > 0 ? y - 1 : 0], *xy_down = xy_[y + 1 < height ? y + 1 : y];
      for (int x = 1; x < width - 1; ++x)
        out[x] = xx[x - 1] - 2 * xx[x] + xx[x + 1] + yy_up[x] - 2 * yy[x] + yy_down[x] + xy_up[x - 1] - xy_up[x + 1] -
                 xy_down[x - 1] + xy_down[x + 1];
      out[0] = xx[1] + yy_up[0] - 2 * yy[0] + yy_down[0] - xy_up[1] + xy_down[1];
      out[width - 1] = xx[width - 2] + xy_up[width - 2] - xy_down[width - 2];
    }
  }

  cv::Mat weights_;
  cv::Mat_<float> xx_, yy_, xy_;
};

}  // namespace

cv::Mat squaredBending(const cv::Mat& values) {
  CV_Assert(values.type() == CV_32FC1 && values.isContinuous());
  cv::Mat_<float> out(values.size(), 0.0f);
  for (int y = 1; y < values.rows - 1; ++y)
    for (int x = 1; x < values.cols - 1; ++x) {
      const Differences d = differences(values.ptr<float>(y) + x, values.cols);
      out(y, x) = d.xx * d.xx + d.yy * d.yy + 2 * d.xy * d.xy;
    }
  return std::move(out);
}

cv::Mat solveThinPlate(const cv::Mat& information, const cv::Mat& gradient, const cv::Mat& bending, const cv::Mat& base,
                       int steps) {
  const cv::Size size = information.size();
  CV_Assert(size.width >= 3 && size.height >= 3 && base.isContinuous());
  Bending plate(bending);
  cv::Mat_<float> x(size, 0.0f), applied(size), residual(size);
  plate.apply(base, applied);
  residual = -gradient - applied;
  const cv::Mat_<float> diagonal = plate.diagonal() + information + 1e-12f;
  cv::Mat_<float> preconditioned = residual / diagonal;
  cv::Mat_<float> direction = preconditioned.clone();
  double energy = residual.dot(preconditioned);
  for (int step = 0; step < steps && energy > 0; ++step) {
    plate.apply(direction, applied);
    applied += information.mul(direction);
    const double length = energy / direction.dot(applied);
    x += length * direction;
    residual -= length * applied;
    preconditioned = residual / diagonal;
    const double next = residual.dot(preconditioned);
    direction = preconditioned + next / energy * direction;
    energy = next;
  }
  return std::move(x);
}

}  // namespace cortshift_stereo
