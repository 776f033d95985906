// Loaded before every program that runs under the sanitizer of races: OpenCV's pool (TBB) is not instrumented, so that
// each loop handed to it looks like a race. Without the pool its loops run where they are called.
#include <opencv2/core/utility.hpp>

namespace {

const struct OneThread {
  OneThread() { cv::setNumThreads(1); }
} only;

}  // namespace
