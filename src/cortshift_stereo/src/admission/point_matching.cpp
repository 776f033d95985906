// Points of a rectified pair, matched in two dimensions with their standard error.
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "cortshift_stereo/admission/row_agreement.hpp"
#include "rectification/fill.hpp"

namespace cortshift_stereo {
namespace {

constexpr int kHalfWindow = 10;             // [px]
constexpr double kMostError = 0.5;          // [px] of a row, to count as measured
constexpr double kLeastAlike = 0.7;         // correlation of the two windows
constexpr double kMostReturn = 0.3;         // [px] apart after matching there and back, beyond three standard errors
constexpr double kFarthest = 12;            // [px] from where matching started
constexpr std::size_t kFewestMatched = 40;  // twice what a verdict needs
constexpr double kNeighboursShare = 3;      // pixels around share their noise: images are blurred before resampling

struct View {
  cv::Mat_<float> image;
  cv::Mat_<uint8_t> usable;
};

float at(const cv::Mat_<float>& image, float x, float y) {
  const int i = static_cast<int>(x), j = static_cast<int>(y);
  const float u = x - static_cast<float>(i), v = y - static_cast<float>(j);
  const float *above = image[j] + i, *below = image[j + 1] + i;
  return (1 - v) * ((1 - u) * above[0] + u * above[1]) + v * ((1 - u) * below[0] + u * below[1]);
}

struct Found {
  cv::Point2f place;
  double sd_row = std::numeric_limits<double>::infinity();
  double alike = 0;
};

/// How far a pixel of the other image's window lies along the row for one to the right and one down in this image's.
struct Shear {
  float right = 1, down = 0;
};

/// The window around `from` in the other image, beginning at `start`: Gauss-Newton on shift, gain and offset (Lucas and
/// Kanade 1981, with the linear change of brightness of Negahdaripour 1998).
Found track(const View& one, const View& other, cv::Point2f from, cv::Point2f start, int half, const Shear& shear) {
  Found found;
  found.place = start;
  const auto inside = [half](const View& view, const cv::Point2f& p) {
    const auto margin = 1.5f * static_cast<float>(half + 2);  // for the shear
    return p.x > margin && p.y > margin && p.x < static_cast<float>(view.image.cols) - margin &&
           p.y < static_cast<float>(view.image.rows) - margin;
  };
  if (!inside(one, from)) return found;
  constexpr int kIterations = 12;
  constexpr float kSettled = 0.01f;  // [px]
  float gain = 1, offset = 0;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    if (!inside(other, found.place)) return {};
    cv::Matx44d A = cv::Matx44d::zeros();
    cv::Vec4d b(0, 0, 0, 0);
    double squares = 0, sum_one = 0, sum_one2 = 0;
    int count = 0;
    for (int dy = -half; dy <= half; ++dy)
      for (int dx = -half; dx <= half; ++dx) {
        const float x = found.place.x + shear.right * static_cast<float>(dx) + shear.down * static_cast<float>(dy);
        const float y = found.place.y + static_cast<float>(dy);
        const float x1 = from.x + static_cast<float>(dx), y1 = from.y + static_cast<float>(dy);
        if (!one.usable(static_cast<int>(y1 + 0.5f), static_cast<int>(x1 + 0.5f)) ||
            !other.usable(static_cast<int>(y + 0.5f), static_cast<int>(x + 0.5f)))
          continue;
        const float there = at(other.image, x, y), here = at(one.image, x1, y1);
        const float gx = gain * 0.5f * (at(other.image, x + 1, y) - at(other.image, x - 1, y));
        const float gy = gain * 0.5f * (at(other.image, x, y + 1) - at(other.image, x, y - 1));
        const double r = here - gain * there - offset;
        const cv::Vec4d g(gx, gy, there, 1);
        for (int i = 0; i < 4; ++i) {
          for (int j = i; j < 4; ++j) A(i, j) += g[i] * g[j];
          b[i] += g[i] * r;
        }
        squares += r * r;
        sum_one += here;
        sum_one2 += static_cast<double>(here) * here;
        ++count;
      }
    const int whole = (2 * half + 1) * (2 * half + 1);
    if (count < whole / 2) return {};
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < i; ++j) A(i, j) = A(j, i);
    bool regular = false;
    const cv::Matx44d inverse = A.inv(cv::DECOMP_CHOLESKY, &regular);
    if (!regular) return {};
    const cv::Vec4d step = inverse * b;
    const double variance = squares / std::max(1, count - 4);
    found.sd_row = std::sqrt(kNeighboursShare * variance * inverse(1, 1));
    const double spread_one = sum_one2 / count - sum_one * sum_one / (static_cast<double>(count) * count);
    found.alike = std::sqrt(std::max(0.0, 1 - squares / count / std::max(1e-9, spread_one)));
    const double length = std::hypot(step[0], step[1]);
    const double shorten = length > 2 ? 2 / length : 1;
    found.place += cv::Point2f(static_cast<float>(shorten * step[0]), static_cast<float>(shorten * step[1]));
    gain = std::clamp(gain + static_cast<float>(step[2]), 0.2f, 5.0f);
    offset += static_cast<float>(step[3]);
    if (length < kSettled) return found;
  }
  found.sd_row = std::numeric_limits<double>::infinity();
  return found;
}

/// In each cell of a grid the place that tells most about rows: gyy - gxy^2 / gxx of the structure tensor.
std::vector<cv::Point2f> informativePlaces(const View& left, const cv::Mat& disparity) {
  cv::Mat half, gx, gy, products[3], usable;
  cv::resize(left.image, half, {}, 0.5, 0.5, cv::INTER_AREA);
  cv::resize(left.usable & (disparity == disparity), usable, half.size(), 0, 0, cv::INTER_NEAREST);
  cv::Sobel(half, gx, CV_32F, 1, 0, 3);
  cv::Sobel(half, gy, CV_32F, 0, 1, 3);
  const int window = kHalfWindow + 1;
  const cv::Mat pairs[3][2] = {{gx, gx}, {gx, gy}, {gy, gy}};
  for (int i = 0; i < 3; ++i) cv::boxFilter(pairs[i][0].mul(pairs[i][1]), products[i], CV_32F, {window, window});
  const int cell = std::clamp(half.cols / 24, 8, 24);
  std::vector<cv::Point2f> places;
  for (int top = window; top + window < half.rows; top += cell)
    for (int left_edge = window; left_edge + window < half.cols; left_edge += cell) {
      float best = 0;
      cv::Point at;
      for (int y = top; y < std::min(top + cell, half.rows - window); y += 2)
        for (int x = left_edge; x < std::min(left_edge + cell, half.cols - window); x += 2) {
          if (!usable.at<uint8_t>(y, x)) continue;
          const float xx = products[0].at<float>(y, x), xy = products[1].at<float>(y, x);
          const float tells = products[2].at<float>(y, x) - xy * xy / std::max(1e-6f, xx);
          if (tells > best) {
            best = tells;
            at = {x, y};
          }
        }
      if (best > 0) places.emplace_back(2 * static_cast<float>(at.x) + 0.5f, 2 * static_cast<float>(at.y) + 0.5f);
    }
  return places;
}

/// How the surface's slope shears a window, from the disparity around.
Shear shearAt(const cv::Mat& disparity, const cv::Point2f& at) {
  const cv::Point place(static_cast<int>(at.x), static_cast<int>(at.y));
  const auto slope = [&](const cv::Point& step) {
    const cv::Point before = place - step, after = place + step;
    const cv::Rect inside(0, 0, disparity.cols, disparity.rows);
    if (!inside.contains(before) || !inside.contains(after)) return 0.0f;
    const float rise =
        (disparity.at<float>(after) - disparity.at<float>(before)) / static_cast<float>(2 * (step.x + step.y));
    constexpr float kSteepest = 0.3f;                 // [px / px]; beyond, two surfaces
    return std::abs(rise) < kSteepest ? rise : 0.0f;  // not for NaN
  };
  return {1 - slope({kHalfWindow, 0}), -slope({0, kHalfWindow})};
}

View reduced(const View& view, int factor) {
  View out;
  const cv::Size size(view.image.cols / factor, view.image.rows / factor);
  cv::resize(view.image, out.image, size, 0, 0, cv::INTER_AREA);
  cv::resize(view.usable, out.usable, size, 0, 0, cv::INTER_NEAREST);
  return out;
}

std::vector<MatchedPoint> matchFrom(const RectifiedPair& pair, const cv::Mat& disparity) {
  constexpr int kCoarse = 4;
  const View left{pair.left, pair.left_usable}, right{pair.right, pair.right_usable};
  const View left_coarse = reduced(left, kCoarse), right_coarse = reduced(right, kCoarse);
  const std::vector<cv::Point2f> places = informativePlaces(left, disparity);
  std::vector<MatchedPoint> matched(places.size());
  cv::parallel_for_(cv::Range(0, static_cast<int>(places.size())), [&](const cv::Range& range) {
    for (int i = range.start; i < range.end; ++i) {
      MatchedPoint& point = matched[static_cast<std::size_t>(i)];
      point.sd_row = std::numeric_limits<double>::infinity();
      const cv::Point2f from = places[static_cast<std::size_t>(i)];
      const cv::Point2f start(from.x - disparity.at<float>(static_cast<int>(from.y), static_cast<int>(from.x)), from.y);
      if (!std::isfinite(start.x)) continue;
      const Shear shear = shearAt(disparity, from);
      const auto coarsely = [](const cv::Point2f& p) {
        return (p + cv::Point2f(0.5f, 0.5f)) / kCoarse - cv::Point2f(0.5f, 0.5f);
      };
      const Found coarse = track(left_coarse, right_coarse, coarsely(from), coarsely(start), kHalfWindow / 2, shear);
      cv::Point2f near = start;
      if (coarse.alike > kLeastAlike && cv::norm(coarse.place - coarsely(start)) < kFarthest / kCoarse)
        near += kCoarse * (coarse.place - coarsely(start));
      const Found found = track(left, right, from, near, kHalfWindow, shear);
      if (!(found.sd_row < kMostError) || found.alike < kLeastAlike || cv::norm(found.place - start) > kFarthest)
        continue;
      const Found back =
          track(right, left, found.place, from, kHalfWindow, {1 / shear.right, -shear.down / shear.right});
      if (!(back.sd_row < kMostError) || std::abs(back.place.y - from.y) > kMostReturn + 3 * found.sd_row) continue;
      point = {from, found.place, found.sd_row};
    }
  });
  matched.erase(std::remove_if(matched.begin(), matched.end(),
                               [](const MatchedPoint& point) { return !std::isfinite(point.sd_row); }),
                matched.end());
  return matched;
}

}  // namespace

std::vector<MatchedPoint> matchPoints(const RectifiedPair& pair, const cv::Mat& disparity) {
  std::vector<MatchedPoint> matched = matchFrom(pair, disparity);
  if (matched.size() >= kFewestMatched) return matched;
  // Rows that are off by several pixels leave few disparities; those that there are say where the others may be.
  const cv::Mat known = disparity == disparity;
  if (cv::countNonZero(known) == 0) return matched;
  return matchFrom(pair, fillUnknown(disparity, known));
}

}  // namespace cortshift_stereo
