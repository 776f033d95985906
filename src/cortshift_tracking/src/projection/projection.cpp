#include "cortshift_tracking/projection/projection.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "cortshift_flow/range.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/projection/mesh.hpp"
#include "parallel.hpp"
#include "projection/colour_sampler.hpp"

namespace cortshift_tracking {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

/// Points in grid units: column, row, height / resolution.
cv::Mat toGrid(const cv::Mat& points_pmr, const ProjectionFrame& frame, int threads) {
  const Eigen::Isometry3d T_projection_pmr = frame.T_pmr_projection.inverse();
  const Eigen::Matrix3d A = T_projection_pmr.linear() / frame.resolution;
  const Eigen::Vector3d t = T_projection_pmr.translation() / frame.resolution;
  cv::Mat vertices(points_pmr.size(), CV_32FC3);
  parallelRanges(points_pmr.rows, threads, [&](int first, int last) {
    for (int row = first; row < last; ++row) {
      const auto* in = points_pmr.ptr<cv::Vec3f>(row);
      auto* out = vertices.ptr<cv::Vec3f>(row);
      for (int column = 0; column < points_pmr.cols; ++column) {
        const double x = in[column][0], y = in[column][1], z = in[column][2];
        for (int i = 0; i < 3; ++i) out[column][i] = static_cast<float>(A(i, 0) * x + A(i, 1) * y + A(i, 2) * z + t[i]);
      }
    }
  });
  return vertices;
}

struct Span {
  float low = std::numeric_limits<float>::infinity();
  float high = -std::numeric_limits<float>::infinity();
};

/// What grid rows each image row of vertices reaches.
std::vector<Span> rowSpans(const cv::Mat& vertices) {
  std::vector<Span> spans(static_cast<std::size_t>(vertices.rows));
  for (int row = 0; row < vertices.rows; ++row) {
    const auto* line = vertices.ptr<cv::Vec3f>(row);
    Span& span = spans[static_cast<std::size_t>(row)];
    for (int column = 0; column < vertices.cols; ++column) {
      if (line[column][1] < span.low) span.low = line[column][1];  // false with NaN
      if (line[column][1] > span.high) span.high = line[column][1];
    }
  }
  return spans;
}

/// Whether a quad surely covers no grid point: most do not where pixels are finer than the grid.
bool isBetweenGridPoints(const cv::Vec3f& a, const cv::Vec3f& b, const cv::Vec3f& c, const cv::Vec3f& d) {
  constexpr float kFar = 1e6F;  // [grid units]
  for (int i = 0; i < 2; ++i) {
    const float low = std::min(std::min(a[i], b[i]), std::min(c[i], d[i]));
    const float high = std::max(std::max(a[i], b[i]), std::max(c[i], d[i]));
    if (!(std::abs(high) < kFar)) continue;    // NaN neither: the triangles decide
    const int whole = static_cast<int>(high);  // std::floor takes as long as all the rest
    const int below = static_cast<float>(whole) > high ? whole - 1 : whole;
    if (low > static_cast<float>(below)) return true;
  }
  return false;
}

class Rasteriser {
 public:
  Rasteriser(const cv::Mat& confidence, double fold_tolerance, Projection& out)
      : confidence_(confidence), fold_tolerance_(static_cast<float>(fold_tolerance)), out_(out) {}

  /// Draws every triangle into grid rows [first, last). Each grid point sees the triangles in the same order however
  /// the rows are divided among threads.
  void draw(const std::vector<Span>& spans, int first, int last) {
    const cv::Mat& vertices = out_.vertices;
    for (int row = 0; row + 1 < vertices.rows; ++row) {
      const Span &above = spans[static_cast<std::size_t>(row)], &below = spans[static_cast<std::size_t>(row) + 1];
      if (std::max(above.high, below.high) < static_cast<float>(first) ||
          std::min(above.low, below.low) > static_cast<float>(last - 1))
        continue;
      const auto* upper = vertices.ptr<cv::Vec3f>(row);
      const auto* lower = vertices.ptr<cv::Vec3f>(row + 1);
      for (int column = 0; column + 1 < vertices.cols; ++column) {
        if (isBetweenGridPoints(upper[column], upper[column + 1], lower[column], lower[column + 1])) continue;
        drawTriangle(upper[column], upper[column + 1], lower[column], 0, column, row, first, last);
        drawTriangle(lower[column + 1], lower[column], upper[column + 1], 1, column, row, first, last);
      }
    }
  }

 private:
  void drawTriangle(const cv::Vec3f& a, const cv::Vec3f& b, const cv::Vec3f& c, int half, int column, int row,
                    int first, int last) {
    const float low_y = std::min({a[1], b[1], c[1]}), high_y = std::max({a[1], b[1], c[1]});
    if (!(high_y >= static_cast<float>(first)) || !(low_y <= static_cast<float>(last - 1))) return;
    const float low_x = std::min({a[0], b[0], c[0]}), high_x = std::max({a[0], b[0], c[0]});
    if (!(high_x >= 0) || !(low_x <= static_cast<float>(out_.mask.cols - 1))) return;
    const int y0 = std::max(first, static_cast<int>(std::ceil(low_y))),
              y1 = std::min(last - 1, static_cast<int>(std::floor(high_y)));
    const int x0 = std::max(0, static_cast<int>(std::ceil(low_x))),
              x1 = std::min(out_.mask.cols - 1, static_cast<int>(std::floor(high_x)));
    if (y0 > y1 || x0 > x1 || !isTriangle(a, b, c, out_.max_edge)) return;

    const double abx = b[0] - a[0], aby = b[1] - a[1], acx = c[0] - a[0], acy = c[1] - a[1];
    const double area = abx * acy - aby * acx;  // negative: the side that the camera saw faces up
    if (area == 0) return;
    const bool folded_over = area > 0 && std::max({a[2], b[2], c[2]}) - std::min({a[2], b[2], c[2]}) > fold_tolerance_;
    constexpr double kRounding = 1e-6;  // a grid point on the edge of two triangles must be in at least one of them
    for (int y = y0; y <= y1; ++y)
      for (int x = x0; x <= x1; ++x) {
        const double px = x - a[0], py = y - a[1];
        const double wb = (px * acy - py * acx) / area, wc = (abx * py - aby * px) / area;
        if (wb < -kRounding || wc < -kRounding || wb + wc > 1 + kRounding) continue;
        const auto height = static_cast<float>(a[2] + wb * (b[2] - a[2]) + wc * (c[2] - a[2]));
        cover(x, y, height, folded_over, half, column, row, wb, wc);
      }
  }

  void cover(int x, int y, float height, bool folded_over, int half, int column, int row, double wb, double wc) {
    uchar &mask = out_.mask.at<uchar>(y, x), &fold = out_.fold.at<uchar>(y, x);
    float& top = out_.height.at<float>(y, x);
    if (folded_over) fold = 255;
    if (mask != 0) {
      if (std::abs(height - top) > fold_tolerance_) fold = 255;
      if (!(height > top)) return;
    }
    mask = 255;
    top = height;
    const auto& corners = QuadTriangles::kCorners[half];
    const double wa = 1 - wb - wc;
    const auto mix = [&](double a, double b, double c) { return static_cast<float>(wa * a + wb * b + wc * c); };
    out_.source.at<cv::Vec2f>(y, x) = {static_cast<float>(column) + mix(corners[0][0], corners[1][0], corners[2][0]),
                                       static_cast<float>(row) + mix(corners[0][1], corners[1][1], corners[2][1])};
    const auto trust = [&](int i) { return confidence_.at<float>(row + corners[i][1], column + corners[i][0]); };
    out_.confidence.at<float>(y, x) = mix(trust(0), trust(1), trust(2));
  }

  const cv::Mat& confidence_;
  float fold_tolerance_;  // [grid units]
  Projection& out_;
};

void check(const cortshift_stereo::Surface& surface) {
  if (surface.points.empty() || surface.points.type() != CV_32FC3)
    throw TrackingError("the surface has no points; an organised cloud of float32 x y z is needed");
  if (surface.colour.size() != surface.points.size() || surface.colour.type() != CV_8UC3 ||
      surface.confidence.size() != surface.points.size() || surface.confidence.type() != CV_32FC1)
    throw TrackingError("the colour or the confidence of the surface does not fit its points");
}

}  // namespace

void ProjectionSettings::validate() const {
  cortshift_flow::requireRange<TrackingError>("max_edge_ratio", max_edge_ratio, 2.0, 50.0);
  cortshift_flow::requireRange<TrackingError>("fold_tolerance", fold_tolerance, 0.0, 0.01);
  cortshift_flow::requireRange<TrackingError>("threads", threads, 0, 256);
}

Projection project(const cortshift_stereo::Surface& surface_pmr, const ProjectionFrame& frame,
                   const ProjectionSettings& settings) {
  settings.validate();
  check(surface_pmr);
  Projection out;
  out.resolution = frame.resolution;
  out.vertices = toGrid(surface_pmr.points, frame, settings.threads);
  const double spacing = medianSpacing(out.vertices);
  out.max_edge = static_cast<float>(settings.max_edge_ratio * spacing);
  out.mask = cv::Mat::zeros(frame.size, CV_8UC1);
  out.fold = cv::Mat::zeros(frame.size, CV_8UC1);
  out.colour = cv::Mat::zeros(frame.size, CV_32FC3);
  out.confidence = cv::Mat::zeros(frame.size, CV_32FC1);
  out.height = cv::Mat(frame.size, CV_32FC1, cv::Scalar(kNaN));
  out.source = cv::Mat(frame.size, CV_32FC2, cv::Scalar::all(kNaN));
  if (!(spacing > 0)) return out;

  Rasteriser rasteriser(surface_pmr.confidence, settings.fold_tolerance / frame.resolution, out);
  const std::vector<Span> spans = rowSpans(out.vertices);
  parallelRanges(frame.size.height, settings.threads,
                 [&](int first, int last) { rasteriser.draw(spans, first, last); });

  const ColourSampler sampler(surface_pmr.colour, 1 / spacing);
  parallelRanges(frame.size.height, settings.threads, [&](int first, int last) {
    for (int row = first; row < last; ++row) {
      const auto* source = out.source.ptr<cv::Vec2f>(row);
      auto* height = out.height.ptr<float>(row);
      auto* colour = out.colour.ptr<cv::Vec3f>(row);
      const auto* mask = out.mask.ptr<uchar>(row);
      for (int column = 0; column < frame.size.width; ++column) {
        if (mask[column] == 0) continue;
        colour[column] = sampler.at(source[column][0], source[column][1]);
        height[column] *= static_cast<float>(frame.resolution);
      }
    }
  });
  return out;
}

}  // namespace cortshift_tracking
