// Cubic convolution (Keys 1981, a = -1/2): third-order accurate, so that no position between pixels is preferred.
#pragma once

namespace cortshift_stereo {

/// Weights of the pixels -1, 0, 1, 2 for a position `t` in 0...1 behind pixel 0.
class CubicWeights {
 public:
  explicit CubicWeights(float t) {
    const float t2 = t * t, t3 = t2 * t;
    w_[0] = -0.5f * t3 + t2 - 0.5f * t;
    w_[1] = 1.5f * t3 - 2.5f * t2 + 1;
    w_[2] = -1.5f * t3 + 2 * t2 + 0.5f * t;
    w_[3] = 0.5f * t3 - 0.5f * t2;
  }
  float operator[](int i) const { return w_[i]; }
  /// @param first  the pixel at -1
  float apply(const float* first) const {
    return w_[0] * first[0] + w_[1] * first[1] + w_[2] * first[2] + w_[3] * first[3];
  }

 private:
  float w_[4];
};

}  // namespace cortshift_stereo
