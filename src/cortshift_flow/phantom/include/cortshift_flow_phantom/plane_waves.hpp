#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace cortshift_flow_phantom {

/// Plane waves in random directions, of which gyri, outlines, films and grain are made.
/// Most of a rendered image's time goes into them: all waves of a set are evaluated together, in loops that the
/// compiler turns into vector instructions, with a cosine that is right to 1e-12 for angles up to 1000 turns.
template <std::size_t kCount>
class PlaneWaves {
 public:
  using Values = std::array<double, kCount>;

  /// @param kx, ky [rad/m]; @param phase [rad]
  void set(std::size_t i, double kx, double ky, double phase) {
    kx_[i] = kx;
    ky_[i] = ky;
    phase_[i] = phase;
  }
  static constexpr std::size_t size() { return kCount; }
  const auto& kx() const { return kx_; }
  const auto& ky() const { return ky_; }

  /// cos(kx x + ky y + phase) of each wave. @param x, y [m]
  Values cosines(double x, double y) const { return sinesOfTurns<kCount>(x, y, 0.25); }
  /// sin(kx x + ky y + phase) of each wave. @param x, y [m]
  Values sines(double x, double y) const { return sinesOfTurns<kCount>(x, y, 0); }

  /// Sum of the cosines; of waves with random phases its mean square is half their number.
  double sum(double x, double y) const {
    double total = 0;
    const auto cosines = sinesOfTurns<kWhole>(x, y, 0.25);
    for (std::size_t i = 0; i < kCount; ++i) total += cosines[i];
    return total;
  }

 private:
  static constexpr double kTurn = 6.283185307179586;
  /// With one wave of nothing where that fills the last register, which otherwise takes three steps.
  static constexpr std::size_t kWhole = kCount % 4 == 3 ? kCount + 1 : kCount;

  template <std::size_t kMany>
  std::array<double, kMany> sinesOfTurns(double x, double y, double ahead) const {
    std::array<double, kMany> out;
    for (std::size_t i = 0; i < kMany; ++i)
      out[i] = sineOfTurns((kx_[i] * x + ky_[i] * y + phase_[i]) * (1 / kTurn) + ahead);
    return out;
  }

  /// sin(2 pi t): t is folded into the quarter turn around 0, where nine terms of the series are enough.
  static double sineOfTurns(double t) {
    constexpr double kRound = 6755399441055744.0;  // 1.5 * 2^52: what is added to it is rounded to a whole number
    t -= (t + kRound) - kRound;                    // -0.5...0.5
    t = std::copysign(0.25 - std::abs(0.25 - std::abs(t)), t);
    const double a = kTurn * t, s = a * a;
    double series = 1 / 355687428096000.0;  // 1 / 17!
    for (const double factorial : {1307674368000.0, 6227020800.0, 39916800.0, 362880.0, 5040.0, 120.0, 6.0, 1.0})
      series = 1 / factorial - s * series;
    return a * series;
  }

  alignas(32) std::array<double, kWhole> kx_{}, ky_{}, phase_{};
};

}  // namespace cortshift_flow_phantom
