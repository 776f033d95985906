// Written by script/fit_trust shift; do not edit. Fitted on the set "fit" of benchmark/shift_trust.py: 216 shifts.
// Digest of the numbers: 4b64adb51a7b8a53
#pragma once

namespace cortshift_tracking {

constexpr int kSlopes = 3;

/// The logit that a vector is wrong rises by slopes[i] per unit of the cue between knots[i] and knots[i + 1].
struct CueWeights {
  float knots[kSlopes + 1], slopes[kSlopes];
};

constexpr float kMatchConstant = -13.33f;
constexpr CueWeights kMatchWeights[] = {
    {{-12.66f, -10.6f, -9.032f, -7.53f}, {0.6572f, 0.9557f, 0.8317f}},   // flow_error
    {{0.01059f, 0.3589f, 0.9284f, 1.197f}, {1.983f, 2.446f, 7.64f}},     // correlation
    {{-6.689f, -5.133f, -3.276f, -1.723f}, {2.226f, 0.763f, 0.669f}},    // residual
    {{-7.645f, -4.504f, -2.947f, -0.6752f}, {0.f, 0.1754f, 0.3496f}},    // hue
    {{-14.06f, -12.17f, -10.94f, -9.389f}, {0.4816f, 0.8623f, 1.068f}},  // bend
    {{-13.77f, -10.28f, -8.291f, -4.611f}, {0.337f, 0.5916f, 0.4429f}},  // aperture
};
constexpr float kHeightConstant = -7.139f;
constexpr CueWeights kRoughnessWeights = {{-11.65f, -10.07f, -8.994f, -7.767f}, {0.9897f, 2.653f, 1.868f}};
constexpr float kExpectedTooLittle = 1.214f;  // times what surfaces expect: in three of four cases no more is found

}  // namespace cortshift_tracking
