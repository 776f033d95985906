#pragma once

#include <algorithm>
#include <functional>
#include <initializer_list>
#include <opencv2/core/utility.hpp>

namespace cortshift_tracking {

/// Runs work(first, last) on disjoint ranges that together are [0, count). What the ranges are must not matter to the
/// result. @param threads 0: all that OpenCV has
inline void parallelRanges(int count, int threads, const std::function<void(int, int)>& work) {
  const int stripes = threads > 0 ? threads : std::max(1, cv::getNumThreads());
  cv::parallel_for_(
      cv::Range(0, count), [&](const cv::Range& range) { work(range.start, range.end); }, stripes);
}

/// Runs tasks that do not need each other's results. What they run in parallel themselves, they then run alone.
inline void sideBySide(std::initializer_list<std::function<void()>> tasks) {
  parallelRanges(static_cast<int>(tasks.size()), static_cast<int>(tasks.size()), [&](int first, int last) {
    for (int i = first; i < last; ++i) tasks.begin()[i]();
  });
}

}  // namespace cortshift_tracking
