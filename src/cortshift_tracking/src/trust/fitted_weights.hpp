// Written by script/fit_trust shift; do not edit. Fitted on the set "fit" of benchmark/shift_trust.py: 216 shifts.
// Digest of the numbers: e1037cab52cd4b18
#pragma once

namespace cortshift_tracking {

constexpr int kSlopes = 3;

/// The logit that a vector is wrong rises by slopes[i] per unit of the cue between knots[i] and knots[i + 1].
struct CueWeights {
  float knots[kSlopes + 1], slopes[kSlopes];
};

constexpr float kMatchConstant = -14.46f;
constexpr CueWeights kMatchWeights[] = {
    {{-12.65f, -10.59f, -9.001f, -7.451f}, {0.6621f, 0.9499f, 0.7332f}},  // flow_error
    {{0.01073f, 0.3649f, 0.9313f, 1.208f}, {2.301f, 2.543f, 7.978f}},     // correlation
    {{-6.689f, -5.128f, -3.241f, -1.741f}, {2.445f, 0.809f, 0.548f}},     // residual
    {{-7.664f, -4.496f, -2.921f, -0.481f}, {0.f, 0.1474f, 0.2377f}},      // hue
    {{-14.07f, -12.16f, -10.94f, -9.333f}, {0.8411f, 0.8138f, 0.9189f}},  // bend
    {{-14.14f, -10.63f, -8.576f, -5.158f}, {0.3952f, 0.5719f, 0.4118f}},  // aperture
};
constexpr float kHeightConstant = -7.129f;
constexpr CueWeights kRoughnessWeights = {{-11.66f, -10.07f, -9.001f, -7.773f}, {1.f, 2.618f, 2.019f}};
constexpr float kExpectedTooLittle = 1.212f;  // times what surfaces expect: in three of four cases no more is found

}  // namespace cortshift_tracking
