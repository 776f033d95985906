#include "trust/occlusion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "parallel.hpp"

namespace cortshift_flow {
namespace {

constexpr float kPreferMoving = 0.03f;   // colour difference that outweighs the preference for the moving side, 0...1
constexpr int kLongestWalk = 96;         // to the nearest visible pixel [px]
constexpr int kSpan = 24;                // over which the flow's slope is taken [px]
constexpr std::size_t kDirections = 16;  // of walks
constexpr int kGrid = 4;                 // [px]
constexpr int kSpanStep = 4;             // [px]
constexpr int kBeyond = 4;               // steps into the visible side at which its colour and flow are read [px]

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
    // A straight line is fitted to the visible flow ahead, so that noise or one wrong value at the edge is not
    // continued.
    float n = 0, st = 0, stt = 0, su = 0, sv = 0, stu = 0, stv = 0;
    float last_u = flow.u.row(py)[px], last_v = flow.v.row(py)[px];
    const float u0 = last_u, v0 = last_v;
    for (int step = 0; step <= kSpan; step += kSpanStep) {
      int fx, fy;
      if (!at(static_cast<float>(near + step), fx, fy) || !visible(fy, fx)) break;
      const float u = flow.u.row(fy)[fx], v = flow.v.row(fy)[fx];
      if (std::hypot(u - last_u, v - last_v) > 0.5f * kSpanStep) break;  // another boundary, not a slope
      last_u = u;
      last_v = v;
      const auto s = static_cast<float>(step);
      n += 1;
      st += s;
      stt += s * s;
      su += u - u0;
      sv += v - v0;
      stu += s * (u - u0);
      stv += s * (v - v0);
    }
    const float determinant = n * stt - st * st;
    const float slope_u = determinant > 0 ? (n * stu - st * su) / determinant : 0;
    const float slope_v = determinant > 0 ? (n * stv - st * sv) / determinant : 0;
    const auto back = static_cast<float>(near);
    c.u = u0 + (su - slope_u * st) / n - back * slope_u;
    c.v = v0 + (sv - slope_v * st) / n - back * slope_v;
    return c;
  }
  return {};
}

struct Sides {
  float moving_u, moving_v, resting_u, resting_v, evidence;
};

/// The best continuation among the faster and among the slower ones.
bool weighSides(const std::array<Continuation, kDirections>& all, Sides& sides) {
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
    const float weight = 1 / (c.distance * c.distance * c.distance * c.distance);
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

std::array<cv::Point2f, kDirections> compass() {
  std::array<cv::Point2f, kDirections> directions;
  for (std::size_t k = 0; k < kDirections; ++k) {
    const double angle = 2 * CV_PI * static_cast<double>(k) / static_cast<double>(kDirections);
    directions[k] = {static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle))};
  }
  return directions;
}

/// Interpolates a pixel's flow from those of the grid points about it that chose the same side as the nearest did.
void interpolateChoice(const cv::Mat3f& chosen, int x, int y, float& u, float& v) {
  const int i = x / kGrid, j = y / kGrid;
  const float fx = static_cast<float>(x - kGrid * i) / kGrid, fy = static_cast<float>(y - kGrid * j) / kGrid;
  std::array<cv::Vec3f, 4> flows;
  std::array<float, 4> weights{};
  std::size_t nearest = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    const int right = static_cast<int>(k % 2), below = static_cast<int>(k / 2);
    if (i + right >= chosen.cols || j + below >= chosen.rows) continue;
    flows[k] = chosen(j + below, i + right);
    if (flows[k][2] > 0) weights[k] = (right ? fx : 1 - fx) * (below ? fy : 1 - fy);
    if (weights[k] > weights[nearest]) nearest = k;
  }
  float sum = 0, sum_u = 0, sum_v = 0;
  for (std::size_t k = 0; k < 4; ++k)
    if (weights[k] > 0 && flows[k][2] == flows[nearest][2]) {
      sum += weights[k];
      sum_u += weights[k] * flows[k][0];
      sum_v += weights[k] * flows[k][1];
    }
  if (sum <= 0) return;
  u = sum_u / sum;
  v = sum_v / sum;
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

void continueFlow(const cv::Mat4f& image, const cv::Mat1b& visible, Continue side, FlowPlanes& flow, int threads) {
  const int width = visible.cols, height = visible.rows;
  if (cv::countNonZero(visible) == width * height) return;
  cv::Mat smooth_image;
  cv::blur(image, smooth_image, cv::Size(7, 7));
  const cv::Mat4f smooth(smooth_image);

  // Continuations vary slowly: it is enough to compute them at one pixel in sixteen.
  const cv::Size grid((width - 1) / kGrid + 1, (height - 1) / kGrid + 1);
  cv::Mat1f evidence(grid, 0.f), hidden(grid, 0.f);
  cv::Mat4f candidates(grid, cv::Vec4f::all(0));
  const std::array<cv::Point2f, kDirections> directions = compass();
  forRows(grid.height, threads, [&](int begin, int end) {
    for (int j = begin; j < end; ++j)
      for (int i = 0; i < grid.width; ++i) {
        if (visible(kGrid * j, kGrid * i)) continue;
        std::array<Continuation, kDirections> all;
        for (std::size_t k = 0; k < all.size(); ++k)
          all[k] = walk(smooth, visible, flow, kGrid * i, kGrid * j, directions[k].x, directions[k].y);
        Sides sides;
        if (!weighSides(all, sides)) continue;
        candidates(j, i) = cv::Vec4f(sides.moving_u, sides.moving_v, sides.resting_u, sides.resting_v);
        evidence(j, i) = sides.evidence;
        hidden(j, i) = 1;
      }
  });

  // The side is chosen from the sum over neighbours: the evidence of a single point is weak.
  const cv::Size vote(5, 5);
  cv::Mat1f evidence_sum, hidden_sum;
  cv::boxFilter(evidence, evidence_sum, -1, vote, cv::Point(-1, -1), false, cv::BORDER_CONSTANT);
  cv::boxFilter(hidden, hidden_sum, -1, vote, cv::Point(-1, -1), false, cv::BORDER_CONSTANT);
  cv::Mat3f chosen(grid, cv::Vec3f::all(0));  // flow, and 1 for the moving side, 2 for the resting one
  for (int j = 0; j < grid.height; ++j)
    for (int i = 0; i < grid.width; ++i) {
      if (hidden(j, i) == 0) continue;
      const cv::Vec4f& c = candidates(j, i);
      const bool moving = side == Continue::kByColour && evidence_sum(j, i) <= kPreferMoving * hidden_sum(j, i);
      chosen(j, i) = moving ? cv::Vec3f(c[0], c[1], 1) : cv::Vec3f(c[2], c[3], 2);
    }
  forRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < width; ++x)
        if (!visible(y, x)) interpolateChoice(chosen, x, y, flow.u.row(y)[x], flow.v.row(y)[x]);
  });
}

}  // namespace cortshift_flow
