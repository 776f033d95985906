// Rows shared among threads. What a row computes never depends on how the rows are shared, so results have the same
// bits for any number of threads.
#pragma once

#include <algorithm>
#include <opencv2/core.hpp>

// Inner loops are compiled for several instruction sets and the widest that the processor has is chosen at run time.
// Multiply-add contraction is off for this library, so all versions give the same bits.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__)
#define CORTSHIFT_VECTORISED __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define CORTSHIFT_VECTORISED
#endif

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
