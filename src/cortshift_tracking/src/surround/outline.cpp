#include "cortshift_tracking/surround/outline.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "cortshift_flow/text.hpp"
#include "cortshift_tracking/surround/closed_path.hpp"
#include "surround/cells.hpp"
#include "surround/coverings.hpp"

namespace cortshift_tracking {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

constexpr double kCell = 0.0002;        // [m] ten of them over the narrowest cuff of dura
constexpr double kSmooth = 0.0006;      // [m] noise of single heights is not relief
constexpr double kLeastRadius = 0.008;  // [m] of a brain; a burr hole is 14 mm wide
constexpr double kBend = 0.05;          // of one cell from one direction to the next, beside 0.5 of the deepest crease
constexpr float kDeepest = 0.5F;        // [1/mm] beyond that a crease is none the better
constexpr double kSide = 0.001;         // [m] on each side of the line colours are compared
constexpr int kAlong = 5;               // directions that are compared together, 2.5 mm
constexpr float kClear = 1;             // colours that differ by the root of both their variances
constexpr float kNoise = 0.06F;         // of a logarithm: of what is one matter colours differ by as much
constexpr double kColourReach = 0.003;  // [m] from the foot of the step an edge of colour belongs to it
constexpr float kAside = 0.02F;         // of an edge 1 mm beside the foot, beside 1 of the clearest edge
constexpr float kLeastStep = 0.001F;    // [m] dura is 0.3 to 0.8 mm thick, bone 3 to 8 mm
// Of the surface beside the foot: from where to where it is carried on, and where it is compared [m].
constexpr double kInside = -0.006, kInner = -0.001, kOuter = 0.003, kOutside = 0.005;
constexpr float kTogether = 0.0012F;  // [m] relief and colour have the edge at the same place

/// Heights of one part, smoothed. NaN where less than a third of the neighbourhood belongs to it.
cv::Mat smoothed(const cv::Mat& height, const cv::Mat& part, double sigma) {
  cv::Mat value = height.clone(), weight, out;
  value.setTo(0, part == 0);
  part.convertTo(weight, CV_32F, 1.0 / 255);
  cv::GaussianBlur(value, value, cv::Size(), sigma, sigma, cv::BORDER_CONSTANT);
  cv::GaussianBlur(weight, weight, cv::Size(), sigma, sigma, cv::BORDER_CONSTANT);
  cv::divide(value, weight, out);
  out.setTo(kNan, weight < 1.0 / 3);
  return out;
}

/// A closed line about the brain, and in which directions what speaks for it.
struct Line {
  Unrolling place;
  std::vector<float> radius;        ///< in each direction [cells]
  std::vector<float> foot;          ///< of the step, as the relief has it [cells]
  std::vector<bool> seen, stepped;  ///< heights on both sides; higher outside than the brain would be if it went on
  std::vector<bool> clear;          ///< colours differ
};

double shareOf(const std::vector<bool>& these, const std::vector<bool>& of) {
  double both = 0, all = 0;
  for (std::size_t i = 0; i < of.size(); ++i) {
    all += of[i] ? 1 : 0;
    both += of[i] && these[i] ? 1 : 0;
  }
  return all > 0 ? both / all : 0;
}

cv::Point2f middleOf(const cv::Mat& mask) {
  const cv::Moments moments = cv::moments(mask, true);
  return {static_cast<float>(moments.m10 / moments.m00), static_cast<float>(moments.m01 / moments.m00)};
}

std::vector<cv::Point> polygonOf(const Line& line, double scale) {
  std::vector<cv::Point> polygon;
  for (int i = 0; i < kDirections; ++i) {
    Unrolling at = line.place;
    at.base = line.radius;
    at.first = 0;
    polygon.emplace_back(at.at(i, 0) * scale);
  }
  return polygon;
}

cv::Mat within(const Line& line, cv::Size size) {
  constexpr int kFraction = 4;  // bits
  cv::Mat out = cv::Mat::zeros(size, CV_8UC1);
  cv::fillPoly(out, std::vector<std::vector<cv::Point>>{polygonOf(line, 1 << kFraction)}, 255, cv::LINE_8, kFraction);
  return out;
}

/// The closed line of deepest creases, and inside of each the foot of the rise.
Line creaseAround(const cv::Mat& height, const cv::Mat& part, double side) {
  const int span = std::max(1, static_cast<int>(std::lround(2 * kCell / side)));  // of second differences [cells]
  const double to_mm = 1e3 / std::pow(1e3 * span * side, 2);
  Line line;
  line.place.centre = middleOf(part);
  line.place.rows = static_cast<int>(std::hypot(height.cols, height.rows) / 2);
  const int least = static_cast<int>(kLeastRadius / side);
  cv::Mat crease;
  std::vector<int> path;
  for (int pass = 0; pass < 3; ++pass) {
    if (pass > 0) line.place.centre = middleOf(within(line, height.size()));
    const cv::Mat along = line.place.unroll(height);
    crease = cv::Mat(along.size(), CV_32FC1, cv::Scalar(0));
    for (int row = least; row + span < along.rows; ++row)
      for (int column = 0; column < kDirections; ++column) {
        const float bent =
            static_cast<float>(to_mm) * (along.at<float>(row + span, column) - 2 * along.at<float>(row, column) +
                                         along.at<float>(row - span, column));
        if (!std::isnan(bent)) crease.at<float>(row, column) = std::min(std::max(bent, -kDeepest), kDeepest);
      }
    crease.rowRange(0, std::min(least, crease.rows)).setTo(-1);
    path = bestClosedPath(crease, static_cast<float>(kBend));
    line.radius.assign(path.begin(), path.end());
  }
  for (int column = 0; column < kDirections; ++column) {
    int foot = path[static_cast<std::size_t>(column)];
    const float half = crease.at<float>(foot, column) / 2;
    while (half > 0 && foot > least && crease.at<float>(foot - 1, column) > half) --foot;
    line.foot.push_back(static_cast<float>(foot));
  }
  // Single creases run together with the brain's own; the foot is a smooth line.
  constexpr int kWindow = 11;
  std::vector<float> level(line.foot.size());
  for (int column = 0; column < kDirections; ++column) {
    std::vector<float> near;
    for (int i = -kWindow / 2; i <= kWindow / 2; ++i)
      near.push_back(line.foot[static_cast<std::size_t>((column + i + kDirections) % kDirections)]);
    std::nth_element(near.begin(), near.begin() + kWindow / 2, near.end());
    level[static_cast<std::size_t>(column)] = near[kWindow / 2];
  }
  line.foot = level;
  return line;
}

/// Is what lies outside the foot higher than the surface inside of it would be there?
void findSteps(const cv::Mat& height, double side, Line& line) {
  Unrolling band = line.place;
  band.base = line.foot;
  const auto rowAt = [&](double metres) { return static_cast<int>(std::lround((metres - kInside) / side)); };
  band.first = static_cast<float>(kInside / side);
  band.rows = rowAt(kOutside) + 1;
  const cv::Mat along = band.unroll(height);
  for (int column = 0; column < kDirections; ++column) {
    double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0, outside = 0, far = 0, count = 0;
    for (int row = rowAt(kInside); row <= rowAt(kInner); ++row) {
      const double y = along.at<float>(row, column), x = row;
      if (std::isnan(y)) continue;
      n += 1, sx += x, sy += y, sxx += x * x, sxy += x * y;
    }
    for (int row = rowAt(kOuter); row <= rowAt(kOutside); ++row) {
      const double y = along.at<float>(row, column);
      if (std::isnan(y)) continue;
      outside += y, far += row, count += 1;
    }
    const bool seen = n * side > 0.6 * (kInner - kInside) && count * side > 0.6 * (kOutside - kOuter);
    double step = 0;
    if (seen) {
      const double slope = (n * sxy - sx * sy) / (n * sxx - sx * sx), mean = sy / n;
      step = outside / count - (mean + slope * (far / count - sx / n));
    }
    line.seen.push_back(seen);
    line.stepped.push_back(seen && step > kLeastStep);
  }
}

/// How much colours on both sides of each place differ, beside how much they vary there.
cv::Mat edgesOf(const cv::Mat& colour, const cv::Mat& part, const Unrolling& band, int half) {
  cv::Mat sum;
  std::vector<cv::Mat> bgr;
  cv::split(logarithmOf(colour), bgr);
  const cv::Mat channels[] = {bgr[0] + bgr[1] + bgr[2], 2 * (bgr[2] - bgr[1]), 2 * (bgr[0] - bgr[1])};
  for (cv::Mat channel : channels) {
    channel.setTo(kNan, part == 0);
    const cv::Mat along = band.unroll(channel);
    const cv::Size window(kAlong, half);
    cv::Mat share, ignored;
    const cv::Mat mean = meanAround(along, window, share), square = meanAround(along.mul(along), window, ignored);
    const cv::Mat variance = cv::max(square - mean.mul(mean), 0);
    if (sum.empty()) sum = cv::Mat::zeros(along.size(), CV_32FC1);
    const int apart = (half + 1) / 2;
    for (int row = half; row + half < along.rows; ++row)
      for (int column = 0; column < kDirections; ++column) {
        const int in = row - apart, out = row + apart;
        if (share.at<float>(in, column) < 0.4F || share.at<float>(out, column) < 0.4F) continue;
        const float gap = mean.at<float>(in, column) - mean.at<float>(out, column);
        sum.at<float>(row, column) +=
            gap * gap / (variance.at<float>(in, column) + variance.at<float>(out, column) + 2 * kNoise * kNoise);
      }
  }
  cv::sqrt(sum, sum);
  return sum;
}

/// Draws the line to the edge of colours beside the foot.
void drawToColours(const Cells& cells, const cv::Mat& part, Line& line) {
  Unrolling band = line.place;
  band.base = line.foot;
  band.step = 0.5F;
  const int reach = static_cast<int>(kColourReach / cells.side / static_cast<double>(band.step)),
            half = static_cast<int>(kSide / cells.side / static_cast<double>(band.step));
  band.rows = 2 * (reach + half) + 1;
  band.first = -static_cast<float>(reach + half) * band.step;
  const cv::Mat edges = edgesOf(cells.colour, part, band, half);
  cv::Mat score = cv::min(edges, 3) / 3;
  for (int row = 0; row < score.rows; ++row) {
    const auto aside = static_cast<float>(1e3 * cells.side) * (band.first + static_cast<float>(row) * band.step);
    score.row(row) -= kAside * aside * aside;
  }
  const std::vector<int> path = bestClosedPath(score, static_cast<float>(kBend));
  for (int column = 0; column < kDirections; ++column) {
    const int row = path[static_cast<std::size_t>(column)];
    line.radius[static_cast<std::size_t>(column)] =
        line.foot[static_cast<std::size_t>(column)] + band.first + static_cast<float>(row) * band.step;
    line.clear.push_back(edges.at<float>(row, column) > kClear);
  }
}

/// Bone from the cuff of dura outwards, where it was found to stand up.
cv::Mat boneAround(const Line& line, const cv::Mat& part, double side) {
  Unrolling at = line.place;
  at.base = line.radius;
  cv::Mat bone = cv::Mat::zeros(part.size(), CV_8UC1);
  const cv::Rect inside({0, 0}, part.size());
  for (int column = 0; column < kDirections; ++column) {
    if (!line.stepped[static_cast<std::size_t>(column)]) continue;
    for (double out = kOuter; out <= kOutside; out += side)
      if (const cv::Point cell = at.at(column, static_cast<float>(out / side)); inside.contains(cell))
        bone.at<uchar>(cell) = 255;
  }
  return bone & part;
}

}  // namespace

FoundOutline findOutline(const Projection& projection) {
  FoundOutline found;
  const Cells cells = cellsOf(projection, kCell);
  if (cells.seen.empty() ||
      cv::countNonZero(cells.seen) * cells.side * cells.side < CV_PI * kLeastRadius * kLeastRadius)
    return found;
  const Parts parts = partsOf(cells);
  const cv::Mat part = parts.labels == parts.largest;
  const cv::Mat height = smoothed(cells.height, part, kSmooth / cells.side);
  Line line = creaseAround(height, part, cells.side);
  findSteps(height, cells.side, line);
  drawToColours(cells, part, line);

  const std::vector<bool> everywhere(kDirections, true);
  std::vector<bool> together;
  for (std::size_t i = 0; i < line.radius.size(); ++i)
    together.push_back(std::abs(line.radius[i] - line.foot[i]) * static_cast<float>(cells.side) < kTogether);
  found.seen = shareOf(line.seen, everywhere);
  found.stepped = shareOf(line.stepped, line.seen);
  found.clear = shareOf(line.clear, line.seen);
  found.together = shareOf(together, line.seen);

  const cv::Mat region = within(line, cells.seen.size()), under = region & ~standingOut(cells, parts),
                opening = region & cells.seen;
  cv::Mat brain = under & cells.seen;
  brain.setTo(0, bloodlessIn(cells, under, boneAround(line, part, cells.side)));
  const auto onGrid = [&](const cv::Mat& mask) {
    cv::Mat fine, out = cv::Mat::zeros(projection.mask.size(), CV_8UC1);
    cv::resize(mask, fine, cv::Size(mask.cols * cells.step, mask.rows * cells.step), 0, 0, cv::INTER_LINEAR);
    cv::Mat(fine >= 128).copyTo(out(cv::Rect(0, 0, fine.cols, fine.rows)));
    return out;
  };
  found.brain = onGrid(brain);
  found.opening = onGrid(opening);
  return found;
}

std::string doubtOf(const FoundOutline& found, const OutlineLimits& limits) {
  const auto only = [](double share, const char* what) {
    return cortshift_flow::formatted(what, static_cast<int>(std::lround(100 * share)));
  };
  if (found.seen < limits.seen)
    return only(found.seen, "an edge of the craniotomy is in view on only %d %% of the way around");
  if (found.stepped < limits.stepped)
    return only(found.stepped, "bone stands up around the brain on only %d %% of the way around");
  if (found.clear < limits.clear)
    return only(found.clear, "colours differ at the edge of bone on only %d %% of the way around");
  if (found.together < limits.together)
    return only(found.together, "relief and colours agree on an edge on only %d %% of the way around");
  return {};
}

Outline proposeOutline(const Projection& projection) {
  const FoundOutline found = findOutline(projection);
  if (found.brain.empty()) return {{}, {}, "not known: the view is too small"};
  const std::string doubt = doubtOf(found);
  if (!doubt.empty()) return {{}, {}, "not known: " + doubt};
  return {found.brain, found.opening, "proposed by relief and colour"};
}

}  // namespace cortshift_tracking
