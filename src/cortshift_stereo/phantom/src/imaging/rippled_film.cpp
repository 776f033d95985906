#include "imaging/rippled_film.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "cortshift_flow_phantom/plane_waves.hpp"
#include "random.hpp"
#include "smooth_step.hpp"

namespace cortshift_stereo_phantom {
namespace {

constexpr double kStep = 0.0001, kHalfExtent = 0.06;  // of the grid [m]
constexpr int kSide = 1201;

}  // namespace

RippledFilm::RippledFilm(const FilmSettings& settings) : settings_(settings), slopes_(kSide, kSide) {
  cortshift_flow_phantom::PlaneWaves<12> waves;
  std::array<Eigen::Vector2d, waves.size()> amplitudes;
  Random random(settings.seed);
  constexpr double kTurn = 6.283185307179586;
  // Each sine has half the square of its amplitude.
  const double amplitude = settings.slope * std::sqrt(2.0 / static_cast<double>(waves.size()));
  for (std::size_t i = 0; i < waves.size(); ++i) {
    const double length = settings.wavelength * std::pow(2, 2 * random.uniform() - 1), k = kTurn / length;
    const double heading = kTurn * random.uniform(), c = std::cos(heading), s = std::sin(heading);
    waves.set(i, k * c, k * s, kTurn * random.uniform());
    amplitudes[i] = {amplitude * c, amplitude * s};
  }
  cv::parallel_for_(cv::Range(0, kSide), [&](const cv::Range& rows) {
    for (int row = rows.start; row < rows.end; ++row)
      for (int column = 0; column < kSide; ++column) {
        const double x = column * kStep - kHalfExtent, y = row * kStep - kHalfExtent;
        const auto rise = waves.cosines(x, y);
        Eigen::Vector2d slope(0, 0);
        for (std::size_t i = 0; i < waves.size(); ++i) slope += rise[i] * amplitudes[i];
        slopes_(row, column) = {static_cast<float>(slope.x()), static_cast<float>(slope.y())};
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
