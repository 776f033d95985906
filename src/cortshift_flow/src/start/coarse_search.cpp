#include "start/coarse_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "parallel.hpp"
#include "start/fill.hpp"

namespace cortshift_flow {
namespace {

constexpr double kHighPassSigma = 1;  // [px of the level]
constexpr float kFlat = 0.002f;       // contrast below which there is no texture, 0...1
constexpr float kFlatWindow = 0.1f;   // the same for the root mean square of a window of saturated contrast
constexpr float kAgreement = 1.5f;    // forward and backward displacements may differ by this [px of the level]
constexpr int kWindow = 2;            // half width of the square windows that are compared [px of the level]
constexpr int kBlock = 16;            // rows are worked on in whole blocks of so many pixels

/// Margin of the padded planes on every side but the right: a displaced window stays inside.
int paddingOf(int radius) { return radius + kWindow; }

int blocksOf(int width) { return (width + kBlock - 1) / kBlock; }

/// High-passed channels as padded planes; zero outside the image and where it is not valid, so that such pixels add
/// nothing to a correlation.
struct Features {
  std::array<cv::Mat1f, 3> channel;
  cv::Mat1f inverse_norm;  // of the window about each pixel; 0 where it is featureless
};

/// Limits strong contrast, so that one strong edge (the rim, a large vessel) does not outweigh the texture around it.
void saturate(cv::Mat& high) {
  std::vector<float> contrast;
  contrast.reserve(high.total());
  for (int y = 0; y < high.rows; ++y)
    for (int x = 0; x < high.cols; ++x) contrast.push_back(static_cast<float>(cv::norm(high.at<cv::Vec4f>(y, x))));
  std::nth_element(contrast.begin(), contrast.begin() + static_cast<std::ptrdiff_t>(contrast.size() / 2),
                   contrast.end());
  const float typical = std::max(contrast[contrast.size() / 2], kFlat);
  for (int y = 0; y < high.rows; ++y)
    for (int x = 0; x < high.cols; ++x) {
      cv::Vec4f& value = high.at<cv::Vec4f>(y, x);
      value *= 1 / std::sqrt(static_cast<float>(value.dot(value)) + typical * typical);
    }
}

Features makeFeatures(const cv::Mat4f& image, const cv::Mat1b& valid, int radius) {
  cv::Mat low;
  cv::GaussianBlur(image, low, cv::Size(), kHighPassSigma);
  cv::Mat high = image - low;
  if (!valid.empty()) high.setTo(0, valid == 0);
  saturate(high);
  std::array<cv::Mat, 4> planes;
  cv::split(high, planes.data());
  Features features;
  cv::Mat energy = planes[0].mul(planes[0]) + planes[1].mul(planes[1]) + planes[2].mul(planes[2]);
  constexpr int side = 2 * kWindow + 1;
  cv::boxFilter(energy, energy, -1, cv::Size(side, side), cv::Point(-1, -1), true, cv::BORDER_CONSTANT);
  cv::Mat1f norm(energy.size());
  for (int y = 0; y < norm.rows; ++y)
    for (int x = 0; x < norm.cols; ++x) {
      const float mean_square = energy.at<float>(y, x);
      norm(y, x) = mean_square > kFlatWindow * kFlatWindow ? 1 / std::sqrt(mean_square) : 0.f;
    }
  const int pad = paddingOf(radius), right = (blocksOf(image.cols) + 1) * kBlock - image.cols + pad;
  const auto padded = [pad, right](const cv::Mat& plane) {
    cv::Mat out;
    cv::copyMakeBorder(plane, out, pad, pad, pad, right, cv::BORDER_CONSTANT, cv::Scalar(0));
    return cv::Mat1f(out);
  };
  for (std::size_t c = 0; c < 3; ++c) features.channel[c] = padded(planes[c]);
  features.inverse_norm = padded(norm);
  return features;
}

/// Best match so far of every pixel of one image, laid out as its padded features.
struct Best {
  explicit Best(cv::Size padded) : score(padded, 0.f), tried(padded, 0) {}
  cv::Mat1f score;
  cv::Mat1i tried;  ///< displacement, as its place in the order in which they are tried
};

struct BestBothWays {
  Best forward, backward;
};

CORTSHIFT_VECTORISED
void multiplyRows(const std::array<const float*, 3>& from, const std::array<const float*, 3>& to, float* products,
                  int blocks) {
  const float *a0 = from[0], *a1 = from[1], *a2 = from[2], *b0 = to[0], *b1 = to[1], *b2 = to[2];
#pragma GCC ivdep
  for (int x = 0; x < blocks * kBlock; ++x) products[x] = a0[x] * b0[x] + a1[x] * b1[x] + a2[x] * b2[x];
}

CORTSHIFT_VECTORISED
void sumColumns(const float* products, std::size_t stride, float* sums, int blocks) {
  static_assert(kWindow == 2);
  const float *p0 = products, *p1 = p0 + stride, *p2 = p1 + stride, *p3 = p2 + stride, *p4 = p3 + stride;
#pragma GCC ivdep
  for (int x = 0; x < blocks * kBlock; ++x) sums[x] = p0[x] + p1[x] + p2[x] + p3[x] + p4[x];
}

/// Correlates the windows of a row with those of the displaced row, and keeps what is better for either image.
CORTSHIFT_VECTORISED
void keepBetter(const float* columns, const float* norm_from, const float* norm_to, int place, float* best_from,
                int* tried_from, float* best_to, int* tried_to, int blocks) {
#pragma GCC ivdep
  for (int x = 0; x < blocks * kBlock; ++x) {
    const float sum = columns[x - 2] + columns[x - 1] + columns[x] + columns[x + 1] + columns[x + 2];
    const float score = sum * norm_from[x] * norm_to[x];
    const bool better_from = score > best_from[x], better_to = score > best_to[x];
    best_from[x] = better_from ? score : best_from[x];
    tried_from[x] = better_from ? place : tried_from[x];
    best_to[x] = better_to ? score : best_to[x];
    tried_to[x] = better_to ? place : tried_to[x];
  }
}

/// Searches the displacements [begin, end), counted row by row from (-radius, -radius).
void searchDisplacements(const Features& first, const Features& second, cv::Size size, int radius, int begin, int end,
                         BestBothWays& best) {
  const int pad = paddingOf(radius), blocks = blocksOf(size.width), side = 2 * radius + 1;
  cv::Mat1f products(size.height + 2 * kWindow, (blocks + 1) * kBlock);
  std::vector<float> columns(static_cast<std::size_t>(products.cols));
  for (int place = begin; place < end; ++place) {
    const int du = place % side - radius, dv = place / side - radius;
    const int top = std::max(0, -dv), bottom = std::min(size.height, size.height - dv);
    for (int y = top - kWindow; y < bottom + kWindow; ++y) {
      std::array<const float*, 3> a{}, b{};
      for (std::size_t c = 0; c < 3; ++c) {
        a[c] = first.channel[c].ptr<float>(y + pad) + pad - kWindow;
        b[c] = second.channel[c].ptr<float>(y + dv + pad) + pad - kWindow + du;
      }
      multiplyRows(a, b, products.ptr<float>(y - top + kWindow), blocks + 1);
    }
    for (int y = top; y < bottom; ++y) {
      sumColumns(products.ptr<float>(y - top), products.step1(), columns.data(), blocks + 1);
      const int from = y + pad, to = y + dv + pad, at = pad, there = pad + du;
      keepBetter(columns.data() + kWindow, first.inverse_norm.ptr<float>(from) + at,
                 second.inverse_norm.ptr<float>(to) + there, place, best.forward.score.ptr<float>(from) + at,
                 best.forward.tried.ptr<int>(from) + at, best.backward.score.ptr<float>(to) + there,
                 best.backward.tried.ptr<int>(to) + there, blocks);
    }
  }
}

void merge(const Best& later, Best& best) {
  const cv::Mat better = later.score > best.score;
  later.score.copyTo(best.score, better);
  later.tried.copyTo(best.tried, better);
}

/// Best displacement of every pixel either way.
BestBothWays search(const Features& first, const Features& second, cv::Size size, int radius, int threads) {
  // A fixed division of the work, merged in a fixed order: the same bits for any number of threads.
  constexpr int kShares = 4;
  const int side = 2 * radius + 1, all = side * side;
  const cv::Size padded = first.inverse_norm.size();
  std::vector<BestBothWays> shares;
  for (int i = 0; i < kShares; ++i) shares.push_back({Best(padded), Best(padded)});  // copies would share memory
  cv::parallel_for_(
      cv::Range(0, kShares),
      [&](const cv::Range& range) {
        for (int i = range.start; i < range.end; ++i)
          searchDisplacements(first, second, size, radius, all * i / kShares, all * (i + 1) / kShares,
                              shares[static_cast<std::size_t>(i)]);
      },
      threads);
  for (std::size_t i = 1; i < shares.size(); ++i) {
    merge(shares[i].forward, shares[0].forward);
    merge(shares[i].backward, shares[0].backward);
  }
  return shares[0];
}

FlowPlanes displacements(const Best& best, cv::Size size, int radius, float sign) {
  const int pad = paddingOf(radius), side = 2 * radius + 1;
  FlowPlanes flow{Plane(size), Plane(size)};
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x) {
      if (best.score(y + pad, x + pad) <= 0) continue;
      const int place = best.tried(y + pad, x + pad);
      flow.u.row(y)[x] = sign * static_cast<float>(place % side - radius);
      flow.v.row(y)[x] = sign * static_cast<float>(place / side - radius);
    }
  return flow;
}

/// 1 where following the flow and the opposite flow leads back.
cv::Mat1f agreeing(const FlowPlanes& flow, const FlowPlanes& opposite, const cv::Mat1f& score) {
  cv::Mat1f weight(score.size(), 0.f);
  for (int y = 0; y < score.rows; ++y)
    for (int x = 0; x < score.cols; ++x) {
      const float u = flow.u.row(y)[x], v = flow.v.row(y)[x];
      const int tx = x + static_cast<int>(u), ty = y + static_cast<int>(v);
      if (score(y, x) <= 0 || tx < 0 || ty < 0 || tx >= score.cols || ty >= score.rows) continue;
      if (std::hypot(u + opposite.u.row(ty)[tx], v + opposite.v.row(ty)[tx]) <= kAgreement) weight(y, x) = 1;
    }
  return weight;
}

}  // namespace

SearchResult searchCoarseFlow(const Level& level, int radius, int threads) {
  const cv::Size size = level.first.size();
  const Features first = makeFeatures(level.first, level.first_valid, radius);
  const Features second = makeFeatures(level.second, level.second_valid, radius);
  const BestBothWays best = search(first, second, size, radius, threads);
  const cv::Rect image(cv::Point(paddingOf(radius), paddingOf(radius)), size);
  SearchResult result{displacements(best.forward, size, radius, 1), displacements(best.backward, size, radius, -1)};
  const cv::Mat1f good_forward = agreeing(result.forward, result.backward, best.forward.score(image));
  const cv::Mat1f good_backward = agreeing(result.backward, result.forward, best.backward.score(image));
  fillUnknown(result.forward, good_forward);
  fillUnknown(result.backward, good_backward);
  return result;
}

}  // namespace cortshift_flow
