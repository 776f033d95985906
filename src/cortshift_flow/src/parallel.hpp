// Rows shared among threads. What a row computes never depends on how the rows are shared, so results have the same
// bits for any number of threads.
#pragma once

#include <algorithm>
#include <opencv2/core.hpp>

#include "cortshift_flow/vectorised.hpp"

namespace cortshift_flow {

/// Runs body(first, last) over pieces of [0, rows).
template <typename Body>
void forRows(int rows, int threads, const Body& body) {
  constexpr int kFewRows = 48;  // less is not worth waking a thread
  const int pieces = std::min(threads, rows / kFewRows);
  if (pieces <= 1) {
    body(0, rows);
    return;
  }
  cv::parallel_for_(
      cv::Range(0, pieces),
      [&](const cv::Range& range) {
        for (int i = range.start; i < range.end; ++i) body(rows * i / pieces, rows * (i + 1) / pieces);
      },
      pieces);
}

}  // namespace cortshift_flow
