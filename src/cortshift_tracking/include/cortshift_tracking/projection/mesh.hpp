// The triangles of an organised surface: each quad of neighbouring pixels is split along the same diagonal.
#pragma once

#include <opencv2/core.hpp>

namespace cortshift_tracking {

/// Distance of neighbouring points, median over the image, in the unit of `points`; 0 if no two neighbours are valid.
/// @param points CV_32FC3, NaN where there is no point
double medianSpacing(const cv::Mat& points);

/// Corners of the two triangles of a quad, as offsets (column, row); the first holds the quad's origin.
struct QuadTriangles {
  static constexpr int kCorners[2][3][2] = {{{0, 0}, {1, 0}, {0, 1}}, {{1, 1}, {0, 1}, {1, 0}}};
};

inline bool isPoint(const cv::Vec3f& p) { return p[0] == p[0] && p[1] == p[1] && p[2] == p[2]; }

/// Whether a triangle is part of the surface: three points, none of its edges longer than `max_edge`.
inline bool isTriangle(const cv::Vec3f& a, const cv::Vec3f& b, const cv::Vec3f& c, float max_edge) {
  const float limit = max_edge * max_edge;  // a NaN corner fails the comparisons
  const cv::Vec3f ab = b - a, bc = c - b, ca = a - c;
  return ab.dot(ab) <= limit && bc.dot(bc) <= limit && ca.dot(ca) <= limit;
}

}  // namespace cortshift_tracking
