#include "imaging/rippled_film.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "random.hpp"
#include "smooth_step.hpp"

namespace cortshift_stereo_phantom {
namespace {

constexpr double kStep = 0.0001, kHalfExtent = 0.06;  // of the grid [m]
constexpr int kSide = 1201;

}  // namespace

RippledFilm::RippledFilm(const FilmSettings& settings) : settings_(settings), slopes_(kSide, kSide) {
  struct Wave {
    double kx, ky, phase, x, y;
  };
  std::array<Wave, 12> waves;
  Random random(settings.seed);
  constexpr double kTurn = 6.283185307179586;
  // Each sine has half the square of its amplitude.
  const double amplitude = settings.slope * std::sqrt(2.0 / static_cast<double>(waves.size()));
  for (Wave& wave : waves) {
    const double length = settings.wavelength * std::pow(2, 2 * random.uniform() - 1), k = kTurn / length;
    const double heading = kTurn * random.uniform(), c = std::cos(heading), s = std::sin(heading);
    wave = {k * c, k * s, kTurn * random.uniform(), amplitude * c, amplitude * s};
  }
  cv::parallel_for_(cv::Range(0, kSide), [&](const cv::Range& rows) {
    for (int row = rows.start; row < rows.end; ++row)
      for (int column = 0; column < kSide; ++column) {
        const double x = column * kStep - kHalfExtent, y = row * kStep - kHalfExtent;
        double sx = 0, sy = 0;
        for (const Wave& wave : waves) {
          const double rise = std::cos(wave.kx * x + wave.ky * y + wave.phase);
          sx += wave.x * rise;
          sy += wave.y * rise;
        }
        slopes_(row, column) = {static_cast<float>(sx), static_cast<float>(sy)};
      }
  });
}

Eigen::Vector2d RippledFilm::slope(double x, double y) const {
  const double column = std::clamp((x + kHalfExtent) / kStep, 0.0, kSide - 1.001);
  const double row = std::clamp((y + kHalfExtent) / kStep, 0.0, kSide - 1.001);
  const int i = static_cast<int>(column), j = static_cast<int>(row);
  const auto u = static_cast<float>(column - i), v = static_cast<float>(row - j);
  const cv::Vec2f s = (1 - v) * ((1 - u) * slopes_(j, i) + u * slopes_(j, i + 1)) +
                      v * ((1 - u) * slopes_(j + 1, i) + u * slopes_(j + 1, i + 1));
  return {s[0], s[1]};
}

double RippledFilm::mirrored(const Eigen::Vector3d& normal, const Eigen::Vector3d& to_lamp,
                             const Eigen::Vector3d& to_eye) const {
  const Eigen::Vector3d half = (to_lamp + to_eye).normalized();
  const double from_lamp = 2 * std::asin(std::min(1.0, normal.cross(half).norm()));  // of the mirrored ray [rad]
  // The outer half of the lamp's radius is its soft rim.
  return settings_.strength * smoothStep(2 * (1 - from_lamp / settings_.lamp_angle));
}

}  // namespace cortshift_stereo_phantom
