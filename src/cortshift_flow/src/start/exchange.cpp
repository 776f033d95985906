#include "start/exchange.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "parallel.hpp"
#include "trust/mismatch.hpp"

namespace cortshift_flow {
namespace {

constexpr float kClearlyBetter = 0.8f;  // of the present mismatch
constexpr float kSameFlow = 0.5f;       // a hypothesis closer than this to the present flow is not worth trying [px]
constexpr std::size_t kDirections = 8;
constexpr int kTile = 16;

/// What one thread needs to try hypotheses on one tile.
struct Workspace {
  explicit Workspace(int window)
      : side(kTile + 2 * window),
        u(static_cast<std::size_t>(side * side)),
        v(u.size()),
        mismatch(u.size()),
        columns(static_cast<std::size_t>(side)) {}
  int side;
  std::vector<float> u, v, mismatch, columns;
};

/// Sums a tile's mismatch over windows; `mismatch` covers the tile and a margin of `window`.
void sumWindows(Workspace& w, int window, float* sums) {
  for (int y = 0; y < kTile; ++y) {
    for (int x = 0; x < w.side; ++x) {
      float sum = 0;
      for (int k = 0; k <= 2 * window; ++k) sum += w.mismatch[static_cast<std::size_t>((y + k) * w.side + x)];
      w.columns[static_cast<std::size_t>(x)] = sum;
    }
    for (int x = 0; x < kTile; ++x) {
      float sum = 0;
      for (int k = 0; k <= 2 * window; ++k) sum += w.columns[static_cast<std::size_t>(x + k)];
      sums[y * kTile + x] = sum;
    }
  }
}

/// The flow `offset` away, or what it extrapolates to from twice as far, for part of a row.
void hypothesisRow(const Plane& flow, int x0, int count, int y, const cv::Point& offset, bool linear, float* out) {
  const int width = flow.width(), height = flow.height();
  const float* once = flow.row(std::clamp(y + offset.y, 0, height - 1));
  const float* twice = flow.row(std::clamp(y + 2 * offset.y, 0, height - 1));
  const int reach = 2 * std::abs(offset.x);
  if (x0 >= reach && x0 + count + reach <= width) {
    const float *a = once + x0 + offset.x, *b = twice + x0 + 2 * offset.x;
    if (linear)
      for (int i = 0; i < count; ++i) out[i] = 2 * a[i] - b[i];
    else
      std::copy_n(a, count, out);
    return;
  }
  for (int i = 0; i < count; ++i) {
    const float a = once[std::clamp(x0 + i + offset.x, 0, width - 1)];
    out[i] = linear ? 2 * a - twice[std::clamp(x0 + i + 2 * offset.x, 0, width - 1)] : a;
  }
}

/// Fills in the hypothetical flow of a tile and its margin.
/// @return false where it is what the tile has already
bool fillHypothesis(const FlowPlanes& flow, int x0, int y0, int window, const cv::Point& offset, bool linear,
                    Workspace& w) {
  const int width = flow.u.width(), height = flow.u.height();
  const int from = std::max(0, window - x0), to = std::min(w.side, width - x0 + window);
  float largest = 0;
  for (int j = 0; j < w.side; ++j) {
    const int y = y0 - window + j;
    if (y < 0 || y >= height) continue;
    float *u = &w.u[static_cast<std::size_t>(j * w.side)], *v = &w.v[static_cast<std::size_t>(j * w.side)];
    const int x = x0 - window + from, count = to - from;
    hypothesisRow(flow.u, x, count, y, offset, linear, u + from);
    hypothesisRow(flow.v, x, count, y, offset, linear, v + from);
    const float *present_u = flow.u.row(y) + x, *present_v = flow.v.row(y) + x;
    for (int i = 0; i < count; ++i)
      largest = std::max(largest, std::max(std::abs(u[from + i] - present_u[i]), std::abs(v[from + i] - present_v[i])));
  }
  return largest > kSameFlow;
}

void evaluateHypothesis(const Level& level, int x0, int y0, int window, Workspace& w) {
  const int width = level.first.cols, height = level.first.rows;
  const int from = std::max(0, window - x0), to = std::min(w.side, width - x0 + window);
  std::fill(w.mismatch.begin(), w.mismatch.end(), kUnseen);
  for (int j = 0; j < w.side; ++j) {
    const int y = y0 - window + j;
    if (y < 0 || y >= height) continue;
    const std::size_t row = static_cast<std::size_t>(j * w.side + from);
    mismatchRow(level, x0 - window + from, y, &w.u[row], &w.v[row], &w.mismatch[row], to - from);
  }
}

void exchangeTile(const Level& level, const FlowPlanes& start, int x0, int y0, int window,
                  const std::vector<cv::Point>& offsets, float worth_trying, const cv::Mat1b& fixed, Workspace& w,
                  FlowPlanes& flow) {
  std::array<float, kTile * kTile> best, sums;
  const int rows = std::min(kTile, start.u.height() - y0), columns = std::min(kTile, start.u.width() - x0);
  if (!fixed.empty() && cv::countNonZero(fixed(cv::Rect(x0, y0, columns, rows))) == rows * columns) return;
  fillHypothesis(start, x0, y0, window, {0, 0}, false, w);
  evaluateHypothesis(level, x0, y0, window, w);
  sumWindows(w, window, best.data());
  bool any = false;
  for (int y = 0; y < rows; ++y)
    for (int x = 0; x < columns; ++x) {
      float& present = best[static_cast<std::size_t>(y * kTile + x)];
      if (present < worth_trying || (!fixed.empty() && fixed(y0 + y, x0 + x))) present = 0;
      any = any || present > 0;
    }
  if (!any) return;
  for (std::size_t k = 0; k < offsets.size(); ++k)
    for (const bool linear : {false, true}) {
      // The unchanged flow is tried from near by only: a flow that varies is a different one farther away.
      if (!linear && k >= kDirections) continue;
      if (!fillHypothesis(start, x0, y0, window, offsets[k], linear, w)) continue;
      evaluateHypothesis(level, x0, y0, window, w);
      sumWindows(w, window, sums.data());
      for (int y = 0; y < rows; ++y)
        for (int x = 0; x < columns; ++x) {
          float& present = best[static_cast<std::size_t>(y * kTile + x)];
          const float tried = sums[static_cast<std::size_t>(y * kTile + x)];
          if (tried >= kClearlyBetter * present) continue;
          present = tried;
          const std::size_t i = static_cast<std::size_t>((y + window) * w.side + x + window);
          flow.u.row(y0 + y)[x0 + x] = w.u[i];
          flow.v.row(y0 + y)[x0 + x] = w.v[i];
        }
    }
}

}  // namespace

void exchangeFlow(const Level& level, const std::vector<int>& reaches, int window, float mismatch,
                  const cv::Mat1b& fixed, FlowPlanes& flow, int threads) {
  std::vector<cv::Point> offsets;
  for (const int reach : reaches) {
    const int diagonal = std::max(1, reach * 7 / 10);
    for (const cv::Point& offset : {cv::Point(reach, 0), cv::Point(-reach, 0), cv::Point(0, reach),
                                    cv::Point(0, -reach), cv::Point(diagonal, diagonal), cv::Point(-diagonal, diagonal),
                                    cv::Point(diagonal, -diagonal), cv::Point(-diagonal, -diagonal)})
      offsets.push_back(offset);
  }
  const FlowPlanes start = flow;
  const float worth_trying = mismatch * static_cast<float>((2 * window + 1) * (2 * window + 1));
  const int tile_rows = (start.u.height() + kTile - 1) / kTile;
  cv::parallel_for_(
      cv::Range(0, tile_rows),
      [&](const cv::Range& range) {
        Workspace workspace(window);
        for (int row = range.start; row < range.end; ++row)
          for (int x0 = 0; x0 < start.u.width(); x0 += kTile)
            exchangeTile(level, start, x0, row * kTile, window, offsets, worth_trying, fixed, workspace, flow);
      },
      threads > 1 ? 4 * threads : 1);
}

}  // namespace cortshift_flow
