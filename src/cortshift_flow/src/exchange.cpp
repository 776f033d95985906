#include "exchange.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "mismatch.hpp"
#include "parallel.hpp"

namespace cortshift_flow {
namespace {

constexpr float kClearlyBetter = 0.8f;   // of the present mismatch
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

/// The flow `offset` away, or what it extrapolates to from twice as far.
float hypothesis(const Plane& flow, int x, int y, const cv::Point& offset, bool linear) {
  const int width = flow.width(), height = flow.height();
  const auto at = [&](int factor) {
    return flow.row(std::clamp(y + factor * offset.y, 0, height - 1))[std::clamp(x + factor * offset.x, 0, width - 1)];
  };
  return linear ? 2 * at(1) - at(2) : at(1);
}

void fillHypothesis(const FlowPlanes& flow, int x0, int y0, int window, const cv::Point& offset, bool linear,
                    const Level& level, Workspace& w) {
  const int width = flow.u.width(), height = flow.u.height();
  for (int j = 0; j < w.side; ++j) {
    const int y = y0 - window + j;
    float *u = &w.u[static_cast<std::size_t>(j * w.side)], *v = &w.v[static_cast<std::size_t>(j * w.side)],
          *mismatch = &w.mismatch[static_cast<std::size_t>(j * w.side)];
    std::fill(mismatch, mismatch + w.side, kUnseen);
    if (y < 0 || y >= height) continue;
    const int from = std::max(0, window - x0), to = std::min(w.side, width - x0 + window);
    for (int i = from; i < to; ++i) {
      u[i] = hypothesis(flow.u, x0 - window + i, y, offset, linear);
      v[i] = hypothesis(flow.v, x0 - window + i, y, offset, linear);
    }
    mismatchRow(level, x0 - window + from, y, u + from, v + from, mismatch + from, to - from);
  }
}

void exchangeTile(const Level& level, const FlowPlanes& start, int x0, int y0, int window,
                  const std::vector<cv::Point>& offsets, float worth_trying, Workspace& w, FlowPlanes& flow) {
  std::array<float, kTile * kTile> best, sums;
  fillHypothesis(start, x0, y0, window, {0, 0}, false, level, w);
  sumWindows(w, window, best.data());
  if (*std::max_element(best.begin(), best.end()) < worth_trying) return;
  const int rows = std::min(kTile, start.u.height() - y0), columns = std::min(kTile, start.u.width() - x0);
  for (const cv::Point& offset : offsets)
    for (const bool linear : {false, true}) {
      fillHypothesis(start, x0, y0, window, offset, linear, level, w);
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

void exchangeFlow(const Level& level, const std::vector<int>& reaches, int window, float mismatch, FlowPlanes& flow,
                  int threads) {
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
            exchangeTile(level, start, x0, row * kTile, window, offsets, worth_trying, workspace, flow);
      },
      threads > 1 ? 4 * threads : 1);
}

}  // namespace cortshift_flow
