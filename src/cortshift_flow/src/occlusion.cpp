#include "occlusion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "fill.hpp"
#include "mismatch.hpp"
#include "parallel.hpp"

namespace cortshift_flow {
namespace {

constexpr float kPreferMoving = 0.03f;  // colour difference that outweighs the preference for the moving side, 0...1
constexpr int kLongestWalk = 96;        // to the nearest visible pixel [px]
constexpr int kSpan = 12;               // over which the flow's slope is taken [px]
constexpr int kBeyond = 4;              // steps into the visible side at which its colour and flow are read [px]

struct Continuation {
  bool found = false;
  float u = 0, v = 0, colour_difference = 0, distance = 0;
};

/// Walks from a hidden pixel until the visible flow begins and continues that flow back to the pixel.
Continuation walk(const cv::Mat4f& smooth_image, const cv::Mat1b& visible, const FlowPlanes& flow, int x, int y,
                  float dx, float dy) {
  const auto inside = [&](int px, int py) { return px >= 0 && py >= 0 && px < visible.cols && py < visible.rows; };
  const auto at = [&](float t, int& px, int& py) {
    px = x + static_cast<int>(std::lround(t * dx));
    py = y + static_cast<int>(std::lround(t * dy));
    return inside(px, py);
  };
  for (int t = 1; t <= kLongestWalk; ++t) {
    int px, py;
    if (!at(static_cast<float>(t), px, py)) return {};
    if (!visible(py, px)) continue;
    // Step away from the boundary, where the flow is least sure, as far as it stays visible.
    int near = t;
    for (int step = 1; step <= kBeyond; ++step) {
      int qx, qy;
      if (!at(static_cast<float>(t + step), qx, qy) || !visible(qy, qx)) break;
      near = t + step;
      px = qx;
      py = qy;
    }
    Continuation c;
    c.found = true;
    c.distance = static_cast<float>(t);
    const cv::Vec4f difference = smooth_image(y, x) - smooth_image(py, px);
    c.colour_difference = std::sqrt(static_cast<float>(difference.dot(difference)));
    const float u = flow.u.row(py)[px], v = flow.v.row(py)[px];
    c.u = u;
    c.v = v;
    int fx, fy;
    if (at(static_cast<float>(near + kSpan), fx, fy) && visible(fy, fx)) {
      const float du = u - flow.u.row(fy)[fx], dv = v - flow.v.row(fy)[fx];
      if (std::hypot(du, dv) < 0.5f * kSpan) {  // a slope, not another boundary
        c.u += du * static_cast<float>(near) / kSpan;
        c.v += dv * static_cast<float>(near) / kSpan;
      }
    }
    return c;
  }
  return {};
}

struct Sides {
  float moving_u, moving_v, resting_u, resting_v, evidence;
};

/// The best continuation among the faster and among the slower ones.
bool weighSides(const std::array<Continuation, 16>& all, Sides& sides) {
  float fastest = -1, slowest = 1e30f;
  for (const Continuation& c : all)
    if (c.found) {
      fastest = std::max(fastest, std::hypot(c.u, c.v));
      slowest = std::min(slowest, std::hypot(c.u, c.v));
    }
  if (fastest < 0) return false;
  const float middle = 0.5f * (fastest + slowest);
  struct Sum {
    float weight = 0, u = 0, v = 0, colour = 1e30f;
  };
  Sum moving, resting;
  for (const Continuation& c : all) {
    if (!c.found) continue;
    Sum& sum = std::hypot(c.u, c.v) >= middle ? moving : resting;
    const float weight = 1 / (c.distance * c.distance);
    sum.weight += weight;
    sum.u += weight * c.u;
    sum.v += weight * c.v;
    sum.colour = std::min(sum.colour, c.colour_difference);
  }
  if (resting.weight == 0) resting = moving;
  sides = {moving.u / moving.weight, moving.v / moving.weight, resting.u / resting.weight, resting.v / resting.weight,
           std::min(moving.colour, 1.f) - std::min(resting.colour, 1.f)};
  return true;
}

}  // namespace

cv::Mat1b coveredBy(const FlowPlanes& backward, const cv::Mat1b& trusted) {
  const int width = backward.u.width(), height = backward.u.height();
  cv::Mat1f weight(height, width, 0.f);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      if (!trusted.empty() && !trusted(y, x)) continue;
      const float px = static_cast<float>(x) + backward.u.row(y)[x], py = static_cast<float>(y) + backward.v.row(y)[x];
      const float bx = std::floor(px), by = std::floor(py);
      if (!(bx >= -1 && by >= -1 && bx < static_cast<float>(width) && by < static_cast<float>(height))) continue;
      const int ix = static_cast<int>(bx), iy = static_cast<int>(by);
      const float fx = px - bx, fy = py - by;
      const auto add = [&](int tx, int ty, float w) {
        if (tx >= 0 && ty >= 0 && tx < width && ty < height) weight(ty, tx) += w;
      };
      add(ix, iy, (1 - fx) * (1 - fy));
      add(ix + 1, iy, fx * (1 - fy));
      add(ix, iy + 1, (1 - fx) * fy);
      add(ix + 1, iy + 1, fx * fy);
    }
  cv::Mat1f smooth;
  cv::boxFilter(weight, smooth, -1, cv::Size(3, 3), cv::Point(-1, -1), true, cv::BORDER_REPLICATE);
  return cv::Mat1b(smooth > 0.35f) / 255;
}

float typicalMismatch(const Level& level, const FlowPlanes& flow, int window, int threads) {
  const Plane mean = windowMismatch(level, flow, window, threads);
  std::vector<float> values;
  for (int y = 0; y < mean.height(); y += 2)
    for (int x = 0; x < mean.width(); x += 2) values.push_back(mean.row(y)[x]);
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

cv::Mat1b matched(const Level& level, const FlowPlanes& flow, int window, float mismatch, int threads) {
  const Plane mean = windowMismatch(level, flow, window, threads);
  cv::Mat1b result(mean.size());
  const float limit = std::min(mismatch, 0.9f * kUnseen);
  for (int y = 0; y < mean.height(); ++y)
    for (int x = 0; x < mean.width(); ++x) result(y, x) = mean.row(y)[x] <= limit;
  return result;
}

cv::Mat1b consistent(const FlowPlanes& flow, const FlowPlanes& opposite, float tolerance, int threads) {
  const int width = flow.u.width(), height = flow.u.height();
  cv::Mat1b result(height, width, uchar{0});
  forRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < width; ++x) {
        const float u = flow.u.row(y)[x], v = flow.v.row(y)[x];
        const long tx = std::lround(static_cast<float>(x) + u), ty = std::lround(static_cast<float>(y) + v);
        if (tx < 0 || ty < 0 || tx >= width || ty >= height) continue;
        const float gap_u = u + opposite.u.row(static_cast<int>(ty))[tx];
        const float gap_v = v + opposite.v.row(static_cast<int>(ty))[tx];
        result(y, x) = gap_u * gap_u + gap_v * gap_v <= tolerance * tolerance;
      }
  });
  return result;
}

void continueFlow(const cv::Mat4f& image, const cv::Mat1b& visible, FlowPlanes& flow, int threads) {
  const int width = visible.cols, height = visible.rows;
  cv::Mat smooth_image;
  cv::blur(image, smooth_image, cv::Size(7, 7));
  const cv::Mat4f smooth(smooth_image);
  cv::Mat1f evidence(height, width, 0.f), hidden(height, width, 0.f);
  cv::Mat4f candidates(height, width, cv::Vec4f::all(0));
  cv::Mat1f known(height, width, 1.f);
  forRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < width; ++x) {
        if (visible(y, x)) continue;
        known(y, x) = 0;
        // Continuations vary slowly: one in four is enough, and its neighbours share it.
        if ((x | y) & 1) continue;
        std::array<Continuation, 16> all;
        for (std::size_t k = 0; k < all.size(); ++k) {
          const double angle = 2 * CV_PI * static_cast<double>(k) / static_cast<double>(all.size());
          all[k] = walk(smooth, visible, flow, x, y, static_cast<float>(std::cos(angle)),
                        static_cast<float>(std::sin(angle)));
        }
        Sides sides;
        if (!weighSides(all, sides)) continue;
        candidates(y, x) = cv::Vec4f(sides.moving_u, sides.moving_v, sides.resting_u, sides.resting_v);
        evidence(y, x) = sides.evidence;
        hidden(y, x) = 1;
      }
  });
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if (((x | y) & 1) && !visible(y, x) && hidden(y & ~1, x & ~1) > 0) {
        candidates(y, x) = candidates(y & ~1, x & ~1);
        evidence(y, x) = evidence(y & ~1, x & ~1);
        hidden(y, x) = 1;
      }
  // Neighbours decide together: the evidence of a single pixel is weak.
  const cv::Size vote(15, 15);
  cv::Mat1f evidence_sum, hidden_sum;
  cv::boxFilter(evidence, evidence_sum, -1, vote, cv::Point(-1, -1), false, cv::BORDER_CONSTANT);
  cv::boxFilter(hidden, hidden_sum, -1, vote, cv::Point(-1, -1), false, cv::BORDER_CONSTANT);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      if (hidden(y, x) == 0) continue;
      const bool moving = evidence_sum(y, x) <= kPreferMoving * hidden_sum(y, x);
      const cv::Vec4f& c = candidates(y, x);
      flow.u.row(y)[x] = moving ? c[0] : c[2];
      flow.v.row(y)[x] = moving ? c[1] : c[3];
      known(y, x) = 1;
    }
  if (cv::countNonZero(known) < width * height) fillUnknown(flow, known);
}

}  // namespace cortshift_flow
