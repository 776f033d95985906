// The phantoms' waves are what the C library's cosine says, and rise as fast.
#include "cortshift_flow_phantom/plane_waves.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace cortshift_flow_phantom {
namespace {

TEST(PlaneWaves, AreThoseOfTheLibrary) {
  PlaneWaves<7> waves;
  for (std::size_t i = 0; i < waves.size(); ++i) {
    const auto n = static_cast<double>(i);
    waves.set(i, 90000 - 37000 * n, 12 - 5000 * n * n, 3 - 1.1 * n);
  }
  for (int step = -2000; step <= 2000; ++step) {
    const double x = 3.1e-5 * step, y = 2.7e-5 * step * std::cos(step);  // up to 1000 turns on both sides
    const auto cosines = waves.cosines(x, y), sines = waves.sines(x, y);
    double sum = 0;
    for (std::size_t i = 0; i < waves.size(); ++i) {
      const auto n = static_cast<double>(i);
      const double angle = (90000 - 37000 * n) * x + (12 - 5000 * n * n) * y + 3 - 1.1 * n;
      EXPECT_NEAR(cosines[i], std::cos(angle), 4e-12);
      EXPECT_NEAR(sines[i], std::sin(angle), 4e-12);
      sum += std::cos(angle);
    }
    EXPECT_NEAR(waves.sum(x, y), sum, 1e-11);
  }
}

TEST(PlaneWaves, HoldAtWholeAndQuarterTurns) {
  PlaneWaves<1> wave;
  wave.set(0, 2 * M_PI, 0, 0);
  for (int quarter = -9; quarter <= 9; ++quarter) {
    EXPECT_NEAR(wave.cosines(0.25 * quarter, 0)[0], std::cos(M_PI / 2 * quarter), 1e-13);
    EXPECT_NEAR(wave.sines(0.25 * quarter, 0)[0], std::sin(M_PI / 2 * quarter), 1e-13);
  }
}

}  // namespace
}  // namespace cortshift_flow_phantom
