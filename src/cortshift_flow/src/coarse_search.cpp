#include "coarse_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "fill.hpp"
#include "parallel.hpp"

namespace cortshift_flow {
namespace {

constexpr double kHighPassSigma = 1;  // [px of the level]
constexpr float kFlat = 0.002f;       // contrast below which there is no texture, 0...1
constexpr float kFlatWindow = 0.1f;   // the same for the root mean square of a window of saturated contrast
constexpr float kAgreement = 1.5f;    // forward and backward displacements may differ by this [px of the level]

/// High-passed channels as padded planes; zero outside the image and where it is not valid, so that such pixels add
/// nothing to a correlation.
struct Features {
  std::array<cv::Mat1f, 3> channel;
  cv::Mat1f inverse_norm;  // of the window about each pixel; 0 where it is featureless
};

/// Limits strong contrast, so that one strong edge (the rim, a large vessel) does not outvote the texture about it.
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

Features makeFeatures(const cv::Mat4f& image, const cv::Mat1b& valid, int pad, int window) {
  cv::Mat low;
  cv::GaussianBlur(image, low, cv::Size(), kHighPassSigma);
  cv::Mat high = image - low;
  if (!valid.empty()) high.setTo(0, valid == 0);
  saturate(high);
  std::array<cv::Mat, 4> planes;
  cv::split(high, planes.data());
  Features features;
  cv::Mat energy = planes[0].mul(planes[0]) + planes[1].mul(planes[1]) + planes[2].mul(planes[2]);
  const int side = 2 * window + 1;
  cv::boxFilter(energy, energy, -1, cv::Size(side, side), cv::Point(-1, -1), true, cv::BORDER_CONSTANT);
  cv::Mat1f norm(energy.size());
  for (int y = 0; y < norm.rows; ++y)
    for (int x = 0; x < norm.cols; ++x) {
      const float mean_square = energy.at<float>(y, x);
      norm(y, x) = mean_square > kFlatWindow * kFlatWindow ? 1 / std::sqrt(mean_square) : 0.f;
    }
  const auto padded = [pad](const cv::Mat& plane) {
    cv::Mat out;
    cv::copyMakeBorder(plane, out, pad, pad, pad, pad, cv::BORDER_CONSTANT, cv::Scalar(0));
    return cv::Mat1f(out);
  };
  for (std::size_t c = 0; c < 3; ++c) features.channel[c] = padded(planes[c]);
  features.inverse_norm = padded(norm);
  return features;
}

CORTSHIFT_VECTORISED
void addProducts(const float* const* a, const float* const* b, float* sum, int count) {
  const float *a0 = a[0], *a1 = a[1], *a2 = a[2], *b0 = b[0], *b1 = b[1], *b2 = b[2];
#pragma GCC ivdep
  for (int x = 0; x < count; ++x) sum[x] = a0[x] * b0[x] + a1[x] * b1[x] + a2[x] * b2[x];
}

CORTSHIFT_VECTORISED
void slideDown(float* column_sums, const float* entering, const float* leaving, int count) {
#pragma GCC ivdep
  for (int x = 0; x < count; ++x) column_sums[x] += entering[x] - leaving[x];
}

/// Scores one row against one displacement and keeps the better.
CORTSHIFT_VECTORISED
void keepBetter(const float* column_sums, int window, const float* norm_a, const float* norm_b, float du, float dv,
                float* best, float* u, float* v, int count) {
#pragma GCC ivdep
  for (int x = 0; x < count; ++x) {
    float sum = 0;
    for (int k = -window; k <= window; ++k) sum += column_sums[x + k];
    const float score = sum * norm_a[x] * norm_b[x];
    const bool better = score > best[x];
    best[x] = better ? score : best[x];
    u[x] = better ? du : u[x];
    v[x] = better ? dv : v[x];
  }
}

/// Searches rows begin...end for all displacements; bands of rows are independent of one another.
void searchBand(const Features& from, const Features& to, int pad, const CoarseSearch& settings, int begin, int end,
                cv::Mat1f& best, FlowPlanes& flow) {
  const int width = flow.u.width(), window = settings.window;
  const int reach = width + 2 * window;
  const int rows = end - begin + 2 * window;
  cv::Mat1f products(rows, reach);
  std::vector<float> zero(static_cast<std::size_t>(reach), 0.f), sums(static_cast<std::size_t>(reach));
  for (int dv = -settings.radius; dv <= settings.radius; ++dv)
    for (int du = -settings.radius; du <= settings.radius; ++du) {
      for (int r = 0; r < rows; ++r) {
        const int y = begin - window + r + pad;
        std::array<const float*, 3> a{}, b{};
        for (std::size_t c = 0; c < 3; ++c) {
          a[c] = from.channel[c].ptr<float>(y) + pad - window;
          b[c] = to.channel[c].ptr<float>(y + dv) + pad - window + du;
        }
        addProducts(a.data(), b.data(), products.ptr<float>(r), reach);
      }
      std::fill(sums.begin(), sums.end(), 0.f);
      for (int r = 0; r < 2 * window; ++r) slideDown(sums.data(), products.ptr<float>(r), zero.data(), reach);
      for (int y = begin; y < end; ++y) {
        slideDown(sums.data(), products.ptr<float>(y - begin + 2 * window),
                  y == begin ? zero.data() : products.ptr<float>(y - begin - 1), reach);
        keepBetter(sums.data() + window, window, from.inverse_norm.ptr<float>(y + pad) + pad,
                   to.inverse_norm.ptr<float>(y + dv + pad) + pad + du, static_cast<float>(du), static_cast<float>(dv),
                   best.ptr<float>(y), flow.u.row(y), flow.v.row(y), width);
      }
    }
}

FlowPlanes search(const Features& from, const Features& to, int pad, const CoarseSearch& settings, cv::Size size,
                  cv::Mat1f& best, int threads) {
  FlowPlanes flow{Plane(size), Plane(size)};
  best = cv::Mat1f(size, 0.f);
  // Fixed bands: running sums give the same bits whoever computes them.
  constexpr int kBand = 24;
  const int bands = (size.height + kBand - 1) / kBand;
  cv::parallel_for_(
      cv::Range(0, bands),
      [&](const cv::Range& range) {
        for (int i = range.start; i < range.end; ++i)
          searchBand(from, to, pad, settings, kBand * i, std::min(kBand * (i + 1), size.height), best, flow);
      },
      threads);
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

SearchResult searchCoarseFlow(const Level& level, const CoarseSearch& settings, int threads) {
  const int pad = settings.radius + settings.window + 1;
  const Features first = makeFeatures(level.first, level.first_valid, pad, settings.window);
  const Features second = makeFeatures(level.second, level.second_valid, pad, settings.window);
  cv::Mat1f score_forward, score_backward;
  SearchResult result;
  const cv::Size size = level.first.size();
  result.forward = search(first, second, pad, settings, size, score_forward, threads);
  result.backward = search(second, first, pad, settings, size, score_backward, threads);
  const cv::Mat1f good_forward = agreeing(result.forward, result.backward, score_forward);
  const cv::Mat1f good_backward = agreeing(result.backward, result.forward, score_backward);
  fillUnknown(result.forward, good_forward);
  fillUnknown(result.backward, good_backward);
  return result;
}

}  // namespace cortshift_flow
