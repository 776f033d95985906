#include "trust/evidence.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "parallel.hpp"
#include "polish/spline_grid.hpp"

namespace cortshift_flow {
namespace {

constexpr int kStep = SplineGrid::kSpacing;
constexpr double kNear = 0.7, kWide = 3;     // standard deviations of the windows [nodes]
constexpr float kRidge = 1;                  // information of the expectation that a step is about 1 px [1 / px^2]
constexpr float kLeast = 1e-3f, kMost = 20;  // that a length counts as [px]

/// Sums over the windows of the B-spline at each node: the normal equations of one step, and what they leave.
struct Sums {
  enum { kXx, kXy, kYy, kXt, kYt, kTt, kSeen, kAll };
  std::array<cv::Mat1f, kAll> of;
};

Sums sumUp(const Judged& judged, int threads) {
  const int width = judged.images.first.cols, height = judged.images.first.rows;
  const cv::Size nodes = SplineGrid::nodes({width, height});
  std::array<Plane, Sums::kAll> reduced;
  for (Plane& plane : reduced) plane.create(height, nodes.width);
  forRows(height, threads, [&](int begin, int end) {
    RowScratch scratch;
    std::array<std::vector<float>, Sums::kAll> row;
    for (auto& values : row) values.resize(static_cast<std::size_t>(width + 16));
    const TensorRow out{row[0].data(), row[1].data(), row[2].data(), row[3].data(), row[4].data(), row[5].data()};
    for (int y = begin; y < end; ++y) {
      lineariseRow(judged.images, y, judged.flow.u.row(y), judged.flow.v.row(y), judged.channel_weights, scratch, out);
      const uchar* regular = judged.regular.ptr(y);
      for (std::size_t x = 0; x < static_cast<std::size_t>(width); ++x) row[Sums::kSeen][x] = regular[x];
      for (std::size_t k = 0; k < Sums::kAll; ++k) reduceRow(row[k].data(), width, reduced[k].row(y), nodes.width);
    }
  });
  Sums sums;
  for (cv::Mat1f& sum : sums.of) sum.create(nodes);
  forRows(nodes.height, threads, [&](int begin, int end) {
    for (int j = begin; j < end; ++j)
      for (std::size_t k = 0; k < Sums::kAll; ++k) reduceColumn(reduced[k], j, sums.of[k].ptr<float>(j));
  });
  return sums;
}

Sums blurred(const Sums& sums, double nodes) {
  Sums wide;
  for (std::size_t k = 0; k < Sums::kAll; ++k)
    cv::GaussianBlur(sums.of[k], wide.of[k], {}, nodes, nodes, cv::BORDER_ISOLATED | cv::BORDER_REPLICATE);
  return wide;
}

float logLength(float value) { return std::log(std::clamp(value, kLeast, kMost)); }

struct Window {
  float step, noise;
};

Window stepOf(const Sums& sums, int j, int i) {
  const float xx = sums.of[Sums::kXx](j, i) + kRidge, xy = sums.of[Sums::kXy](j, i),
              yy = sums.of[Sums::kYy](j, i) + kRidge, xt = sums.of[Sums::kXt](j, i), yt = sums.of[Sums::kYt](j, i);
  const float determinant = std::max(xx * yy - xy * xy, 1e-6f);
  const float u = (yy * xt - xy * yt) / determinant, v = (xx * yt - xy * xt) / determinant;
  const float smaller = 0.5f * (xx + yy - std::sqrt((xx - yy) * (xx - yy) + 4 * xy * xy));
  return {std::hypot(u, v), 1 / std::sqrt(std::max(smaller, kRidge))};
}

float bilinear(const Plane& plane, float x, float y) {
  const int ix = std::clamp(static_cast<int>(x), 0, std::max(0, plane.width() - 2)),
            iy = std::clamp(static_cast<int>(y), 0, std::max(0, plane.height() - 2));
  const float fx = std::clamp(x - static_cast<float>(ix), 0.f, 1.f),
              fy = std::clamp(y - static_cast<float>(iy), 0.f, 1.f);
  const float *above = plane.row(iy) + ix, *below = plane.row(iy + 1) + ix;
  return (1 - fy) * ((1 - fx) * above[0] + fx * above[1]) + fy * ((1 - fx) * below[0] + fx * below[1]);
}

/// Distance from (x, y) to where the flow and then the opposite flow lead.
float returnGap(const Judged& judged, int x, int y) {
  const float u = judged.flow.u.row(y)[x], v = judged.flow.v.row(y)[x];
  const float scale =
      static_cast<float>(judged.backward.u.width()) / static_cast<float>(judged.images.first.cols) > 0.75f ? 1 : 2;
  const float px = (static_cast<float>(x) + u) / scale, py = (static_cast<float>(y) + v) / scale;
  if (!(px >= 0 && py >= 0 && px <= static_cast<float>(judged.backward.u.width() - 1) &&
        py <= static_cast<float>(judged.backward.u.height() - 1)))
    return kMost;
  return std::hypot(u + scale * bilinear(judged.backward.u, px, py), v + scale * bilinear(judged.backward.v, px, py));
}

/// Mean square of the second differences over one node's spacing.
float bendAt(const FlowPlanes& flow, int x, int y) {
  const int width = flow.u.width(), height = flow.u.height();
  const int left = std::max(0, x - kStep), right = std::min(width - 1, x + kStep), up = std::max(0, y - kStep),
            down = std::min(height - 1, y + kStep);
  float sum = 0;
  for (const Plane* p : {&flow.u, &flow.v}) {
    const float *above = p->row(up), *here = p->row(y), *below = p->row(down);
    const float xx = x - left == right - x ? here[left] - 2 * here[x] + here[right] : 0,
                yy = y - up == down - y ? above[x] - 2 * here[x] + below[x] : 0,
                xy = 0.25f * (above[left] - above[right] - below[left] + below[right]);
    sum += xx * xx + yy * yy + 2 * xy * xy;
  }
  return sum;
}

}  // namespace

const std::vector<std::string>& cueNames() {
  static const std::vector<std::string> names = {"fit_error",  "near_step",  "wide_step", "steps_around",
                                                 "near_noise", "wide_noise", "residual",  "residual_shift",
                                                 "return",     "models",     "bend",      "hidden"};
  return names;
}

cv::Mat gatherEvidence(const Judged& judged, int threads) {
  const Sums sums = sumUp(judged, threads), near = blurred(sums, kNear), wide = blurred(sums, kWide);
  const cv::Size size((judged.images.first.cols - 1) / kStep + 1, (judged.images.first.rows - 1) / kStep + 1);
  cv::Mat1f squares(size), bends(size), around, bend;
  cv::Mat evidence(size, CV_32FC(kCues));
  forRows(size.height, threads, [&](int begin, int end) {
    for (int j = begin; j < end; ++j)
      for (int i = 0; i < size.width; ++i) {
        const int x = kStep * i, y = kStep * j;
        const Window close = stepOf(near, j + 1, i + 1), far = stepOf(wide, j + 1, i + 1);
        const float seen = std::max(near.of[Sums::kSeen](j + 1, i + 1), 1e-3f);
        const float left = near.of[Sums::kTt](j + 1, i + 1),
                    slope = near.of[Sums::kXx](j + 1, i + 1) + near.of[Sums::kYy](j + 1, i + 1);
        squares(j, i) = std::min(close.step * close.step, 25.f);
        bends(j, i) = std::min(bendAt(judged.flow, x, y), 25.f);
        float* cue = evidence.ptr<float>(j) + static_cast<std::ptrdiff_t>(i) * kCues;
        cue[kFitError] = logLength(judged.fit_error(y, x));
        cue[kNearStep] = logLength(close.step);
        cue[kWideStep] = logLength(far.step);
        cue[kNearNoise] = logLength(close.noise);
        cue[kWideNoise] = logLength(far.noise);
        cue[kResidual] = logLength(std::sqrt(left / (kStep * kStep)));
        cue[kResidualShift] = logLength(std::sqrt(left / (slope + kRidge)));
        cue[kReturn] = logLength(returnGap(judged, x, y));
        cue[kModels] = logLength(std::hypot(judged.flow.u.row(y)[x] - judged.other.u.row(y)[x],
                                            judged.flow.v.row(y)[x] - judged.other.v.row(y)[x]));
        cue[kHidden] = 1 - std::min(1.f, seen / (kStep * kStep));
      }
  });
  cv::GaussianBlur(squares, around, {}, 2, 2, cv::BORDER_REPLICATE);
  cv::GaussianBlur(bends, bend, {}, 1.5, 1.5, cv::BORDER_REPLICATE);
  for (int j = 0; j < size.height; ++j)
    for (int i = 0; i < size.width; ++i) {
      float* cue = evidence.ptr<float>(j) + static_cast<std::ptrdiff_t>(i) * kCues;
      cue[kStepsAround] = logLength(std::sqrt(around(j, i)));
      cue[kBend] = logLength(std::sqrt(bend(j, i)));
    }
  return evidence;
}

}  // namespace cortshift_flow
