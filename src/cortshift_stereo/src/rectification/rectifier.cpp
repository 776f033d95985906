#include "cortshift_stereo/rectification/rectifier.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/hal/intrin.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

#include "cortshift_stereo/geometry/lens.hpp"
#include "rectification/colour_mix.hpp"
#include "rectification/fill.hpp"
#include "rectification/highlights.hpp"

namespace cortshift_stereo {
namespace {

constexpr double kBlur = 0.9;  // [px] before resampling: removes detail too fine for cubic convolution

/// Weights that are alike sum whole numbers: the mean of the colours has no rounding but the last one.
cv::Mat mixed(const cv::Mat& bgr, const cv::Vec3f& weights) {
  const float scale = (weights[0] + weights[1] + weights[2]) * (1.0f / 3);
  const cv::Vec3f share = weights / scale;
  cv::Mat grey(bgr.size(), CV_32FC1);
  cv::parallel_for_(cv::Range(0, bgr.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      const uint8_t* from = bgr.ptr<uint8_t>(y);
      float* to = grey.ptr<float>(y);
      for (int x = 0; x < bgr.cols; ++x)
        to[x] = scale * (share[0] * static_cast<float>(from[3 * x]) + share[1] * static_cast<float>(from[3 * x + 1]) +
                         share[2] * static_cast<float>(from[3 * x + 2]));
    }
  });
  return grey;
}

/// Weights of the pixels -1, 0, 1, 2 for a position `t` in 0...1 behind pixel 0: cubic convolution (Keys 1981,
/// a = -1/2), by Horner's rule.
cv::v_float32x4 cubicWeights(float t) {
  const cv::v_float32x4 at = cv::v_setall_f32(t);
  cv::v_float32x4 w = cv::v_muladd(cv::v_float32x4(-0.5f, 1.5f, -1.5f, 0.5f), at, cv::v_float32x4(1, -2.5f, 2, -0.5f));
  w = cv::v_muladd(w, at, cv::v_float32x4(-0.5f, 0, 0.5f, 0));
  return cv::v_muladd(w, at, cv::v_float32x4(0, 1, 0, 0));
}

constexpr float kOne = 1 << 14;  // weights in whole numbers

/// Weights of two rows each, side by side in every lane.
struct RowWeights {
  explicit RowWeights(float t) {
    const cv::v_int32x4 whole = cv::v_round(cubicWeights(t) * cv::v_setall_f32(kOne));
    const cv::v_int32x4 pairs = cv::v_reinterpret_as_s32(cv::v_pack(whole, whole));
    cv::v_int32x4 sorted, same;
    cv::v_zip(pairs, pairs, sorted, same);
    upper = cv::v_reinterpret_as_s16(cv::v_combine_low(sorted, sorted));
    lower = cv::v_reinterpret_as_s16(cv::v_combine_high(sorted, sorted));
  }
  cv::v_int16x8 upper, lower;
};

struct ColumnSums {
  cv::v_float32x4 first, second;
};

/// kOne times the weighted sums of eight neighbouring bytes over four rows.
inline ColumnSums sumColumns(const uint8_t* first, std::size_t step, const RowWeights& weights) {
  const auto row = [first, step](std::size_t k) {
    return cv::v_reinterpret_as_s16(cv::v_load_expand(first + k * step));
  };
  cv::v_int16x8 upper_first, upper_second, lower_first, lower_second;
  cv::v_zip(row(0), row(1), upper_first, upper_second);
  cv::v_zip(row(2), row(3), lower_first, lower_second);
  return {cv::v_cvt_f32(cv::v_dotprod(upper_first, weights.upper) + cv::v_dotprod(lower_first, weights.lower)),
          cv::v_cvt_f32(cv::v_dotprod(upper_second, weights.upper) + cv::v_dotprod(lower_second, weights.lower))};
}

/// Luminance at the positions of `map`, without the 1/32 px grid that cv::remap rounds positions to.
cv::Mat sample(const cv::Mat& image, const cv::Mat& map, const cv::Mat& inside) {
  cv::Mat out(map.size(), CV_32FC1);
  const std::size_t step = image.step1();
  cv::parallel_for_(cv::Range(0, out.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      const auto* at = map.ptr<cv::Vec2f>(y);
      const uint8_t* in = inside.ptr<uint8_t>(y);
      float* to = out.ptr<float>(y);
      for (int x = 0; x < out.cols; ++x) {
        if (!in[x]) {
          to[x] = 0;
          continue;
        }
        const int column = static_cast<int>(at[x][0]), row = static_cast<int>(at[x][1]);
        const cv::v_float32x4 horizontal = cubicWeights(at[x][0] - static_cast<float>(column));
        float vertical[4];
        cv::v_store(vertical, cubicWeights(at[x][1] - static_cast<float>(row)));
        const float* first = image.ptr<float>(row - 1) + column - 1;
        cv::v_float32x4 rows_summed = cv::v_load(first) * cv::v_setall_f32(vertical[0]);
        for (int k = 1; k < 4; ++k)
          rows_summed = cv::v_muladd(cv::v_load(first + static_cast<std::size_t>(k) * step),
                                     cv::v_setall_f32(vertical[k]), rows_summed);
        to[x] = cv::v_reduce_sum(rows_summed * horizontal);
      }
    }
  });
  return out;
}

/// Colours at the positions of `map`; black outside.
cv::Mat sampleColour(const cv::Mat& bgr, const cv::Mat& map, const cv::Mat& inside) {
  cv::Mat out(map.size(), CV_8UC3);
  const std::size_t step = bgr.step;
  cv::parallel_for_(cv::Range(0, out.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      const auto* at = map.ptr<cv::Vec2f>(y);
      const uint8_t* in = inside.ptr<uint8_t>(y);
      auto* to = out.ptr<cv::Vec3b>(y);
      for (int x = 0; x < out.cols; ++x) {
        if (!in[x]) {
          to[x] = cv::Vec3b::all(0);
          continue;
        }
        const int column = static_cast<int>(at[x][0]), row = static_cast<int>(at[x][1]);
        float horizontal[4];
        cv::v_store(horizontal, cubicWeights(at[x][0] - static_cast<float>(column)) * cv::v_setall_f32(1 / kOne));
        const RowWeights vertical(at[x][1] - static_cast<float>(row));
        const uint8_t* first = bgr.ptr<uint8_t>(row - 1) + 3 * (column - 1);
        const ColumnSums left = sumColumns(first, step, vertical), right = sumColumns(first + 4, step, vertical);
        // Twelve sums, four pixels of three channels, cut so that each pixel starts a register.
        const cv::v_float32x4 pixels[4] = {left.first, cv::v_extract<3>(left.first, left.second),
                                           cv::v_extract<2>(left.second, right.second),
                                           cv::v_extract<1>(right.second, right.second)};
        cv::v_float32x4 sum = pixels[0] * cv::v_setall_f32(horizontal[0]);
        for (int i = 1; i < 4; ++i) sum = cv::v_muladd(pixels[i], cv::v_setall_f32(horizontal[i]), sum);
        const cv::v_int32x4 rounded = cv::v_round(sum);
        int channels[4];
        cv::v_store(channels, rounded);
        for (int c = 0; c < 3; ++c) to[x][c] = cv::saturate_cast<uint8_t>(channels[c]);
      }
    }
  });
  return out;
}

/// Colour at a place between two pixels of a rectified image's row: the mean over three raw pixels each way,
/// interpolated.
cv::Vec3f colourAt(const cv::Mat& bgr, const cv::Mat& map, int y, float x) {
  const int before = static_cast<int>(x);
  const float share = x - static_cast<float>(before);
  const auto* row_of_map = map.ptr<cv::Vec2f>(y);
  const cv::Vec2f at = (1 - share) * row_of_map[before] + share * row_of_map[before + 1];
  const float left = std::clamp(at[0], 1.0f, static_cast<float>(bgr.cols) - 3.001f);
  const float top = std::clamp(at[1], 1.0f, static_cast<float>(bgr.rows) - 3.001f);
  const int column = static_cast<int>(left), row = static_cast<int>(top);
  const float u = left - static_cast<float>(column), v = top - static_cast<float>(row);
  const float across[4] = {1 - u, 1, 1, u}, down[4] = {1 - v, 1, 1, v};
  cv::Vec3f sum(0, 0, 0);
  for (int j = 0; j < 4; ++j)
    for (int i = 0; i < 4; ++i) sum += across[i] * down[j] * cv::Vec3f(bgr.at<cv::Vec3b>(row - 1 + j, column - 1 + i));
  return sum * (1.0f / 9);
}

}  // namespace

Rectifier::Rectifier(const StereoModel& model) : model_(model) {
  model_.validate();
  left_ = makeSide(model_.left, nullptr, {});
  right_ = makeSide(model_.right, nullptr, {});
}

Rectifier::Rectifier(const StereoModel& model, const SettingsFields& fields, const MicroscopeSetting& setting)
    : model_(model) {
  model_.validate();
  if (fields.size() != model_.left.size)
    throw CalibrationError("the deformation fields of the microscope's settings are for images of " +
                           std::to_string(fields.size().width) + "x" + std::to_string(fields.size().height) +
                           ", the stereo calibration is for " + std::to_string(model_.left.size.width) + "x" +
                           std::to_string(model_.left.size.height) + "; calibrate both at one size");
  left_ = makeSide(model_.left, &fields.left, setting);
  right_ = makeSide(model_.right, &fields.right, setting);
}

Rectifier::Side Rectifier::makeSide(const CameraModel& camera, const SettingsWarp* warp,
                                    const MicroscopeSetting& setting) {
  Side side;
  side.calibrated_map = rectifyingMap(camera);
  side.map = warp != nullptr ? warp->compose(side.calibrated_map, setting) : side.calibrated_map;
  finishSide(side);
  return side;
}

void Rectifier::finishSide(Side& side) {
  const cv::Size size = side.map.size();
  side.inside.create(size, CV_8UC1);
  for (int y = 0; y < size.height; ++y) {
    const auto* at = side.map.ptr<cv::Vec2f>(y);
    uint8_t* in = side.inside.ptr<uint8_t>(y);
    for (int x = 0; x < size.width; ++x) {
      const bool whole_kernel = at[x][0] >= 1 && at[x][1] >= 1 && at[x][0] < static_cast<float>(size.width - 2) &&
                                at[x][1] < static_cast<float>(size.height - 2);
      in[x] = whole_kernel ? 255 : 0;
    }
  }
  cv::convertMaps(side.map, cv::noArray(), side.map_near, side.map_share, CV_16SC2);
}

namespace {

/// A smooth map at places between and a little beyond its pixels.
cv::Mat mapAt(const cv::Mat& map, const cv::Matx33d& place_of_pixel) {
  cv::Mat out(map.size(), CV_32FC2);
  cv::parallel_for_(cv::Range(0, out.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y)
      for (int x = 0; x < out.cols; ++x) {
        const cv::Vec3d place = place_of_pixel * cv::Vec3d(x, y, 1);
        const double column = place[0] / place[2], row = place[1] / place[2];
        const int i = std::clamp(static_cast<int>(std::floor(column)), 0, map.cols - 2);
        const int j = std::clamp(static_cast<int>(std::floor(row)), 0, map.rows - 2);
        const auto u = static_cast<float>(column - i), v = static_cast<float>(row - j);
        const auto* above = map.ptr<cv::Vec2f>(j) + i;
        const auto* below = map.ptr<cv::Vec2f>(j + 1) + i;
        out.at<cv::Vec2f>(y, x) =
            (1 - v) * ((1 - u) * above[0] + u * above[1]) + v * ((1 - u) * below[0] + u * below[1]);
      }
  });
  return out;
}

}  // namespace

Rectifier Rectifier::withRightTurned(const cv::Vec3d& turn) const {
  Rectifier turned = *this;
  cv::Matx33d rotation;
  cv::Rodrigues(turn, rotation);
  const cv::Matx33d K = model_.right.P.get_minor<3, 3>(0, 0);
  const cv::Matx33d place_of_pixel = K * rotation * K.inv();
  turned.model_.right.R = rotation.t() * model_.right.R;
  turned.right_.calibrated_map = mapAt(right_.calibrated_map, place_of_pixel);
  turned.right_.map = mapAt(right_.map, place_of_pixel);
  turned.right_.inside = cv::Mat();
  turned.right_.map_near = cv::Mat();
  turned.right_.map_share = cv::Mat();
  finishSide(turned.right_);
  return turned;
}

double Rectifier::leftShare() const {
  return static_cast<double>(cv::countNonZero(left_.inside)) / static_cast<double>(left_.inside.total());
}

bool Rectifier::rectifySide(const cv::Mat& raw, const Side& side, const RectifiedSide& out) {
  const ColourMix plain;
  cv::Mat rounded;
  mixed(raw, plain.left).convertTo(rounded, CV_8U);
  cv::remap(rounded, out.sharp, side.map_near, side.map_share, cv::INTER_LINEAR);
  out.seen = out.usable = side.inside;
  const Highlights highlights = findHighlights(raw);
  if (highlights.glow.empty()) return false;
  const auto without = [&](const cv::Mat& mask) {
    cv::Mat rectified;
    cv::remap(mask, rectified, side.map_near, side.map_share, cv::INTER_NEAREST);
    return cv::Mat(~rectified & side.inside);
  };
  out.seen = without(highlights.saturated);
  out.usable = without(highlights.glow);
  cv::Mat values;
  out.sharp.convertTo(values, CV_32F);
  fillUnknown(values, out.usable | ~side.inside).convertTo(out.sharp, CV_8U);
  return true;
}

RectifiedPair Rectifier::rectifySharp(const cv::Mat& left, const cv::Mat& right) const {
  for (const cv::Mat* image : {&left, &right})
    if (image->type() != CV_8UC3 || image->size() != model_.left.size)
      throw std::invalid_argument("rectify: both images must be 8-bit colour and of the calibrated size " +
                                  std::to_string(model_.left.size.width) + "x" +
                                  std::to_string(model_.left.size.height));
  RectifiedPair out;
  bool left_highlights = false, right_highlights = false;
  cv::parallel_for_(cv::Range(0, 2), [&](const cv::Range& sides) {
    for (int side = sides.start; side < sides.end; ++side)
      if (side == 0)
        left_highlights = rectifySide(left, left_, {out.left_sharp, out.left_seen, out.left_usable});
      else
        right_highlights = rectifySide(right, right_, {out.right_sharp, out.right_seen, out.right_usable});
  });
  out.has_highlights = left_highlights || right_highlights;
  out.left_colour = sampleColour(left, left_.map, left_.inside);
  return out;
}

RectifiedPair Rectifier::rectify(const cv::Mat& left, const cv::Mat& right) const {
  RectifiedPair out = rectifySharp(left, right);
  mixGrey(left, right, ColourMix(), out);
  return out;
}

void Rectifier::mixGrey(const cv::Mat& left, const cv::Mat& right, const ColourMix& mix, RectifiedPair& pair) const {
  cv::parallel_for_(cv::Range(0, 2), [&](const cv::Range& sides) {
    for (int k = sides.start; k < sides.end; ++k) {
      const Side& side = k == 0 ? left_ : right_;
      cv::Mat grey = k == 0 ? mixed(left, mix.left) : mixed(right, mix.right);
      cv::GaussianBlur(grey, grey, {5, 5}, kBlur, 0, cv::BORDER_REPLICATE);
      (k == 0 ? pair.left : pair.right) = sample(grey, side.map, side.inside);
    }
  });
}

void Rectifier::mixGrey(const cv::Mat& left, const cv::Mat& right, const cv::Mat& disparity,
                        RectifiedPair& pair) const {
  constexpr int kStep = 8;  // [px] from place to place
  std::vector<ColourPair> places;
  for (int y = kStep; y < disparity.rows - kStep; y += kStep)
    for (int x = kStep; x < disparity.cols - kStep; x += kStep) {
      const float d = disparity.at<float>(y, x), partner = static_cast<float>(x) - d;
      const bool inside = partner >= 2 && partner < static_cast<float>(disparity.cols - 3);  // not for NaN
      if (!inside || !pair.left_usable.at<uint8_t>(y, x) || !pair.right_usable.at<uint8_t>(y, cvRound(partner)))
        continue;
      const cv::Vec3f left_before = colourAt(left, left_.map, y, static_cast<float>(x - 1)),
                      left_behind = colourAt(left, left_.map, y, static_cast<float>(x + 1));
      const cv::Vec3f right_before = colourAt(right, right_.map, y, partner - 1),
                      right_behind = colourAt(right, right_.map, y, partner + 1);
      places.push_back({{x, y},
                        0.5f * (left_before + left_behind),
                        0.5f * (right_before + right_behind),
                        left_behind - left_before,
                        right_behind - right_before});
    }
  mixGrey(left, right, chooseMix(places), pair);
}

}  // namespace cortshift_stereo
