#include "cortshift_flow_phantom/cortical_texture.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "cortshift_flow/vectorised.hpp"

namespace cortshift_flow_phantom {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kCell = 0.001;             // side of an index cell [m]
constexpr double kStep = 0.0004;            // length of a vessel segment [m]
constexpr double kSmallestRadius = 0.0001;  // [m]
constexpr double kWallSoftness = 0.00004;   // half width of a vessel's edge [m]
constexpr double kSurely = 1 + 1e-9;        // what is further off by this factor is so in spite of rounding
constexpr double kGyralWavelength = 0.021;  // [m]
constexpr double kSulcusWidth = 0.16;       // in units of the gyral field, which spans about -1...1

std::uint64_t mix(std::uint64_t z) {
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

double uniform(std::uint64_t& state) {
  state += 0x9e3779b97f4a7c15ULL;
  return static_cast<double>(mix(state) >> 11) * 0x1.0p-53;
}

double smoothStep(double low, double high, double value) {
  const double t = std::clamp((value - low) / (high - low), 0.0, 1.0);
  return t * t * t * (t * (6.0 * t - 15.0) + 10.0);
}

// Gradient noise with quintic interpolation (twice differentiable), about -0.7...0.7, one lattice cell per unit, in
// octaves from 5 mm down to 0.31 mm: coarse blotches carry the pyramid, fine grain the sub-pixel fit.
constexpr std::array<double, 5> kWeights = {0.9, 0.7, 0.65, 0.6, 0.55};
constexpr std::array<double, 5> kFrequencies = {200, 400, 800, 1600, 3200};  // [1/m]
using Octaves = std::array<double, kWeights.size()>;

/// Where a coordinate lies in the lattice of each octave.
struct LatticePlace {
  explicit LatticePlace(double coordinate) {
    for (std::size_t i = 0; i < kFrequencies.size(); ++i) {
      const double scaled = coordinate * kFrequencies[i];
      below[i] = std::floor(scaled);
      const double t = after[i] = scaled - below[i];
      before[i] = t - 1;
      step[i] = t * t * t * (t * (6.0 * t - 15.0) + 10.0);
    }
  }
  Octaves below, after, before, step;  // node below; distance from it and from the next one; share of the next one
};

cv::Vec3d blend(const cv::Vec3d& under, const cv::Vec3d& over, double opacity) {
  return under * (1.0 - opacity) + over * opacity;
}

}  // namespace

CorticalTexture::CorticalTexture(const Settings& settings)
    : settings_(settings), random_state_(mix(settings.seed + 1ULL)) {
  for (std::size_t i = 0; i < gyral_waves_.size(); ++i) {
    const double direction =
        kPi * (static_cast<double>(i) + uniform(random_state_)) / static_cast<double>(gyral_waves_.size());
    const double wavelength = kGyralWavelength * (0.75 + 0.5 * uniform(random_state_));
    gyral_waves_.set(i, 2 * kPi / wavelength * std::cos(direction), 2 * kPi / wavelength * std::sin(direction),
                     2 * kPi * uniform(random_state_));
  }
  for (std::size_t octave = 0; octave < noise_seeds_.size(); ++octave)
    noise_seeds_[octave] = mix(settings_.seed * 31ULL + octave);
  growVessels();
  indexSegments();
}

CORTSHIFT_VECTORISED
double CorticalTexture::gyralField(double x, double y, double* dx, double* dy) const {
  const double scale = 1.0 / std::sqrt(0.5 * static_cast<double>(gyral_waves_.size()));
  double value = 0, sum_x = 0, sum_y = 0;
  const auto cosines = gyral_waves_.cosines(x, y), sines = gyral_waves_.sines(x, y);
  for (std::size_t i = 0; i < gyral_waves_.size(); ++i) {
    value += cosines[i];
    sum_x -= gyral_waves_.kx()[i] * sines[i];
    sum_y -= gyral_waves_.ky()[i] * sines[i];
  }
  *dx = sum_x * scale;
  *dy = sum_y * scale;
  return value * scale;
}

CORTSHIFT_VECTORISED
double CorticalTexture::gyralValue(double x, double y) const {
  return gyral_waves_.sum(x, y) * (1.0 / std::sqrt(0.5 * static_cast<double>(gyral_waves_.size())));
}

Relief CorticalTexture::relief(double x, double y) const {
  double gx, gy;
  const double g = gyralField(x, y, &gx, &gy);
  // A sulcus runs along each zero line of the gyral field.
  const double valley = std::exp(-g * g / (2 * kSulcusWidth * kSulcusWidth));
  const double slope = settings_.sulcus_depth * valley * g / (kSulcusWidth * kSulcusWidth);
  return {-settings_.sulcus_depth * valley, slope * gx, slope * gy};
}

void CorticalTexture::growVessels() {
  const double extent = settings_.half_extent;
  const double largest = 0.5 * settings_.vein_diameter;
  const int trunks = 9;
  for (int i = 0; i < trunks; ++i) {
    const double side = 2 * kPi * (i + 0.7 * uniform(random_state_)) / trunks;
    const double x = 1.05 * extent * std::cos(side), y = 1.05 * extent * std::sin(side);
    const double heading = side + kPi + 0.5 * (uniform(random_state_) - 0.5);
    const bool vein = i % 2 == 0;
    growVessel(x, y, heading, largest * (vein ? 0.75 + 0.25 * uniform(random_state_) : 0.45), vein, 0);
  }
  // Short pial vessels fill what the trunks leave bare.
  const int twigs = static_cast<int>(4 * extent * extent / (0.0055 * 0.0055));
  for (int i = 0; i < twigs; ++i) {
    const double x = extent * (2 * uniform(random_state_) - 1), y = extent * (2 * uniform(random_state_) - 1);
    growVessel(x, y, 2 * kPi * uniform(random_state_), kSmallestRadius * (1.0 + 0.7 * uniform(random_state_)),
               uniform(random_state_) < 0.4, 4);
  }
}

void CorticalTexture::growVessel(double x, double y, double heading, double radius, bool vein, int generation) {
  const double length = generation == 0 ? 1.5 * settings_.half_extent * (0.7 + 0.6 * uniform(random_state_))
                                        : 45 * radius * (0.6 + uniform(random_state_));
  const int steps = std::max(4, static_cast<int>(length / kStep));
  double turn = 0, until_branch = radius * (6 + 12 * uniform(random_state_));
  const double first_heading = heading;
  const double taper = std::pow(std::max(kSmallestRadius, 0.3 * radius) / radius, 1.0 / steps);
  for (int i = 0; i < steps && radius >= 0.99 * kSmallestRadius; ++i) {
    // A meander about the heading that the vessel set out with, so that it crosses the field and does not curl up.
    turn = 0.9 * turn + 0.05 * (2 * uniform(random_state_) - 1) - 0.004 * std::sin(heading - first_heading);
    heading += turn;
    const double nx = x + kStep * std::cos(heading), ny = y + kStep * std::sin(heading), thinner = radius * taper;
    const double reach = 0.5 * kStep + std::max(radius, thinner) + kWallSoftness;
    segments_.push_back({0.5 * (x + nx), 0.5 * (y + ny), kSurely * reach * reach, x, y, radius, nx, ny, thinner, vein});
    x = nx;
    y = ny;
    radius = thinner;
    until_branch -= kStep;
    if (until_branch < 0 && generation < 5 && radius > 1.3 * kSmallestRadius) {
      const double side = uniform(random_state_) < 0.5 ? -1 : 1;
      growVessel(x, y, heading + side * (0.5 + 0.6 * uniform(random_state_)),
                 std::max(kSmallestRadius, radius * (0.45 + 0.3 * uniform(random_state_))), vein, generation + 1);
      until_branch = radius * (14 + 20 * uniform(random_state_));
    }
  }
}

void CorticalTexture::indexSegments() {
  const double side = 2.4 * settings_.half_extent;
  cells_per_side_ = static_cast<int>(std::ceil(side / kCell));
  cells_.assign(static_cast<std::size_t>(cells_per_side_) * cells_per_side_, {});
  const double origin = -0.5 * side;
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    const Segment& s = segments_[i];
    const double reach = std::max(s.r0, s.r1) + 2 * kWallSoftness;
    const auto cellOf = [&](double v) {
      return std::clamp(static_cast<int>((v - origin) / kCell), 0, cells_per_side_ - 1);
    };
    for (int cy = cellOf(std::min(s.y0, s.y1) - reach); cy <= cellOf(std::max(s.y0, s.y1) + reach); ++cy)
      for (int cx = cellOf(std::min(s.x0, s.x1) - reach); cx <= cellOf(std::max(s.x0, s.x1) + reach); ++cx)
        cells_[static_cast<std::size_t>(cy) * cells_per_side_ + cx].push_back(static_cast<int>(i));
  }
}

CORTSHIFT_VECTORISED
double CorticalTexture::tissueNoise(double x, double y) const {
  constexpr double d = 0.7071067811865476;
  static constexpr double kDirections[8][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {d, d}, {-d, d}, {d, -d}, {-d, -d}};
  constexpr std::uint64_t kAlongX = 0x9e3779b97f4a7c15ULL, kAlongY = 0xc2b2ae3d27d4eb4fULL;
  const LatticePlace u(x), v(y);
  // Gradients at the nodes: before and after in x, then the same in the next row.
  std::array<Octaves, 4> gx, gy;
  for (std::size_t i = 0; i < kWeights.size(); ++i) {
    const std::uint64_t hx = static_cast<std::uint64_t>(static_cast<std::int64_t>(u.below[i])) * kAlongX;
    const std::uint64_t hy = static_cast<std::uint64_t>(static_cast<std::int64_t>(v.below[i])) * kAlongY;
    for (std::size_t node = 0; node < gx.size(); ++node) {
      const double* gradient =
          kDirections[mix((hx + node % 2 * kAlongX) ^ (hy + node / 2 * kAlongY) ^ noise_seeds_[i]) >> 61];
      gx[node][i] = gradient[0];
      gy[node][i] = gradient[1];
    }
  }
  Octaves noise;
  for (std::size_t i = 0; i < kWeights.size(); ++i) {
    const double a = gx[0][i] * u.after[i] + gy[0][i] * v.after[i], b = gx[1][i] * u.before[i] + gy[1][i] * v.after[i];
    const double c = gx[2][i] * u.after[i] + gy[2][i] * v.before[i],
                 e = gx[3][i] * u.before[i] + gy[3][i] * v.before[i];
    const double top = a + u.step[i] * (b - a), bottom = c + u.step[i] * (e - c);
    noise[i] = top + v.step[i] * (bottom - top);
  }
  double value = 0;
  for (std::size_t i = 0; i < kWeights.size(); ++i) value += kWeights[i] * noise[i];
  return value;
}

double CorticalTexture::vesselHalfThickness(double x, double y) const {
  const double origin = -0.5 * 2.4 * settings_.half_extent;
  const int cx = static_cast<int>(std::floor((x - origin) / kCell)),
            cy = static_cast<int>(std::floor((y - origin) / kCell));
  if (cx < 0 || cy < 0 || cx >= cells_per_side_ || cy >= cells_per_side_) return 0;
  double square = 0;
  for (const int index : cells_[static_cast<std::size_t>(cy) * cells_per_side_ + cx]) {
    const Segment& s = segments_[static_cast<std::size_t>(index)];
    if (s.isFarFrom(x, y)) continue;
    const double ax = s.x1 - s.x0, ay = s.y1 - s.y0;
    const double t = std::clamp(((x - s.x0) * ax + (y - s.y0) * ay) / (ax * ax + ay * ay), 0.0, 1.0);
    const double radius = s.r0 + t * (s.r1 - s.r0), distance = std::hypot(x - s.x0 - t * ax, y - s.y0 - t * ay);
    square = std::max(square, radius * radius - distance * distance);
  }
  return std::sqrt(square);
}

cv::Vec3f CorticalTexture::colour(double x, double y) const {
  const double g = gyralValue(x, y);
  return paint(x, y, std::exp(-g * g / (2 * kSulcusWidth * kSulcusWidth)));
}

cv::Vec3f CorticalTexture::colour(double x, double y, const Relief& relief) const {
  if (settings_.sulcus_depth <= 0) return colour(x, y);
  return paint(x, y, -relief.height / settings_.sulcus_depth);
}

/// @param valley 0 on the crowns, 1 at the bottom of a sulcus
cv::Vec3f CorticalTexture::paint(double x, double y, double valley) const {
  static const cv::Vec3d kCrown(0.56, 0.60, 0.80), kSulcus(0.40, 0.38, 0.62);
  static const cv::Vec3d kVein(0.24, 0.12, 0.33), kArtery(0.16, 0.14, 0.66);

  cv::Vec3d colour = blend(kCrown, kSulcus, 0.55 * valley);
  const double noise = tissueNoise(x, y);
  colour += cv::Vec3d(0.085, 0.085, 0.065) * noise;

  const double origin = -0.5 * 2.4 * settings_.half_extent;
  const int cx = static_cast<int>(std::floor((x - origin) / kCell)),
            cy = static_cast<int>(std::floor((y - origin) / kCell));
  if (cx < 0 || cy < 0 || cx >= cells_per_side_ || cy >= cells_per_side_) return cv::Vec3f(colour);
  double vein = 0, artery = 0, lumen = 0;
  for (const int index : cells_[static_cast<std::size_t>(cy) * cells_per_side_ + cx]) {
    const Segment& s = segments_[static_cast<std::size_t>(index)];
    if (s.isFarFrom(x, y)) continue;
    const double ax = s.x1 - s.x0, ay = s.y1 - s.y0;
    const double t = std::clamp(((x - s.x0) * ax + (y - s.y0) * ay) / (ax * ax + ay * ay), 0.0, 1.0);
    const double radius = s.r0 + t * (s.r1 - s.r0), reach = radius + kWallSoftness;
    const double dx = x - s.x0 - t * ax, dy = y - s.y0 - t * ay;
    if (dx * dx + dy * dy > kSurely * reach * reach) continue;
    const double distance = std::hypot(dx, dy);
    const double opacity = 1.0 - smoothStep(radius - kWallSoftness, radius + kWallSoftness, distance);
    if (opacity <= 0) continue;
    double& kind = s.vein ? vein : artery;
    kind = std::max(kind, opacity * std::min(1.0, 0.35 + radius / 0.0007));
    lumen = std::max(lumen, std::sqrt(std::max(0.0, 1 - distance * distance / (radius * radius))));
  }
  colour = blend(colour, kVein * (0.85 + 0.3 * lumen), 0.9 * vein);
  colour = blend(colour, kArtery * (0.85 + 0.3 * lumen), 0.9 * artery);
  colour += cv::Vec3d(0.02, 0.02, 0.02) * noise * (vein > artery ? vein : artery);
  for (int c = 0; c < 3; ++c) colour[c] = std::clamp(colour[c], 0.0, 1.0);
  return cv::Vec3f(colour);
}

}  // namespace cortshift_flow_phantom
