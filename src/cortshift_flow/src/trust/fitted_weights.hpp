// Written by script/fit_trust flow; do not edit. Fitted on the set "fit" of benchmark/trust_pairs.py: 63 pairs.
// Digest of the numbers: 4bda656d9b5a2f10
#pragma once

#include "trust/evidence.hpp"

namespace cortshift_flow {

/// The logit changes by `slope` per unit of the cue, and by `bends` more above each of `knots`.
struct CueWeights {
  float slope, knots[2], bends[2];
};

struct FittedWeights {
  float constant;
  CueWeights cues[kCues];
};

/// By FitKind.
constexpr FittedWeights kFittedWeights[] = {
    {5.1604f,
     {
         {0.267f, {-3.081f, -1.104f}, {-0.3304f, 1.079f}},       // fit_error
         {0.3356f, {-3.009f, -1.012f}, {0.3891f, -0.3874f}},     // near_step
         {0.3226f, {-3.843f, -1.331f}, {-0.005021f, -0.3257f}},  // wide_step
         {0.594f, {-2.612f, -0.8052f}, {-0.1849f, -0.7381f}},    // steps_around
         {0.06909f, {-2.608f, -1.741f}, {0.8861f, -4.902f}},     // near_noise
         {-0.03688f, {-2.905f, -1.887f}, {1.252f, -1.174f}},     // wide_noise
         {-0.2477f, {0.5286f, 1.615f}, {-0.5212f, 0.01446f}},    // residual
         {0.7203f, {-1.292f, 0.04045f}, {0.5471f, -2.934f}},     // residual_shift
         {0.7903f, {-2.134f, 0.2745f}, {0.186f, -1.721f}},       // return
         {0.6352f, {-1.886f, -0.2445f}, {0.4667f, -0.8483f}},    // models
         {0.31f, {-4.423f, -2.037f}, {-0.07425f, -0.05917f}},    // bend
         {-0.1042f, {0.f, 0.108f}, {-0.1042f, -0.6346f}},        // hidden
     }},
    {-0.34691f,
     {
         {-0.2464f, {-1.387f, -0.2756f}, {0.1788f, -0.1464f}},    // fit_error
         {0.2246f, {-3.466f, -1.388f}, {0.1007f, -0.006623f}},    // near_step
         {-0.0041f, {-4.097f, -1.709f}, {0.0803f, 0.001635f}},    // wide_step
         {0.4617f, {-3.082f, -0.9939f}, {-0.5313f, 0.023f}},      // steps_around
         {0.2027f, {-2.633f, -1.811f}, {1.032f, -1.835f}},        // near_noise
         {-0.432f, {-2.924f, -1.934f}, {0.7486f, -1.052f}},       // wide_noise
         {2.575f, {0.496f, 1.66f}, {-2.881f, 0.5871f}},           // residual
         {0.4285f, {-1.361f, 0.04954f}, {0.5855f, -2.442f}},      // residual_shift
         {0.03901f, {-3.187f, -0.7348f}, {0.4169f, -0.007104f}},  // return
         {1.155f, {-2.036f, 0.463f}, {0.4875f, -2.229f}},         // models
         {-0.05544f, {-1.582f, -0.1234f}, {0.2913f, -0.8634f}},   // bend
         {0.2907f, {0.f, 0.1664f}, {0.2907f, 1.556f}},            // hidden
     }},
    {3.6123f,
     {
         {0.2612f, {-3.08f, -1.095f}, {-0.1903f, 0.4989f}},   // fit_error
         {0.2225f, {-3.014f, -1.018f}, {0.386f, -0.308f}},    // near_step
         {0.3076f, {-3.842f, -1.331f}, {0.1086f, -0.5694f}},  // wide_step
         {0.6359f, {-2.612f, -0.8088f}, {0.1271f, -1.076f}},  // steps_around
         {0.05248f, {-2.614f, -1.745f}, {0.1865f, -3.671f}},  // near_noise
         {0.07077f, {-2.91f, -1.889f}, {1.029f, -0.5181f}},   // wide_noise
         {-0.7936f, {0.5283f, 1.617f}, {0.3712f, -0.291f}},   // residual
         {0.2233f, {-1.295f, 0.03932f}, {0.2265f, -1.936f}},  // residual_shift
         {0.2834f, {-2.003f, 0.5164f}, {0.7764f, -1.56f}},    // return
         {0.2426f, {-2.039f, 0.4514f}, {0.5818f, -1.22f}},    // models
         {0.594f, {-4.419f, -2.009f}, {0.07838f, -0.461f}},   // bend
         {0.7699f, {0.f, 0.108f}, {0.7699f, -1.944f}},        // hidden
     }},
};

}  // namespace cortshift_flow
