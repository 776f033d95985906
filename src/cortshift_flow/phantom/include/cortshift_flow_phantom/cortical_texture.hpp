// A procedural cortex: colour of the exposed brain at any material point, analytic and repeatable.
// Both phantoms (planar Eq. 6-8, and the stereo phantom) paint with it.
#pragma once

#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "cortshift_flow_phantom/plane_waves.hpp"

namespace cortshift_flow_phantom {

/// Height of the gyral relief and its derivatives at one material point.
struct Relief {
  double height;  ///< [m]; 0 on the crowns, negative in the sulci
  double dx, dy;  ///< slope
};

class CorticalTexture {
 public:
  struct Settings {
    std::uint32_t seed = 1;
    double half_extent = 0.055;    ///< vessels are grown over [-half_extent, half_extent]^2 [m]
    double sulcus_depth = 0.0012;  ///< [m]
    double vein_diameter = 0.002;  ///< of the largest vessels [m]; branches taper to 0.2 mm
  };

  CorticalTexture() : CorticalTexture(Settings{}) {}
  explicit CorticalTexture(const Settings& settings);

  /// Colour at material point (x, y) [m]: blue, green, red, each 0...1.
  cv::Vec3f colour(double x, double y) const;

  /// The same where relief(x, y) is known already, in about half the time.
  cv::Vec3f colour(double x, double y, const Relief& relief) const;

  /// Half the thickness [m] of the vessel at material point (x, y), taken as a round tube; 0 where there is none.
  double vesselHalfThickness(double x, double y) const;

  /// Gyral relief at (x, y) [m].
  Relief relief(double x, double y) const;

 private:
  struct Segment {
    double middle_x, middle_y, reach_square;  // [m], [m^2]
    double x0, y0, r0, x1, y1, r1;            // ends and radii [m]
    bool vein;

    /// Most segments near a point do not reach it: said without a division.
    bool isFarFrom(double x, double y) const {
      return (x - middle_x) * (x - middle_x) + (y - middle_y) * (y - middle_y) > reach_square;
    }
  };

  void growVessels();
  void growVessel(double x, double y, double heading, double radius, bool vein, int generation);
  void indexSegments();
  double gyralField(double x, double y, double* dx, double* dy) const;
  double gyralValue(double x, double y) const;
  cv::Vec3f paint(double x, double y, double valley) const;
  double tissueNoise(double x, double y) const;

  Settings settings_;
  std::uint64_t random_state_;
  PlaneWaves<9> gyral_waves_;
  std::array<std::uint64_t, 5> noise_seeds_{};  // of the octaves of tissueNoise
  std::vector<Segment> segments_;
  std::vector<std::vector<int>> cells_;  // segments near each cell of a square grid
  int cells_per_side_ = 0;
};

}  // namespace cortshift_flow_phantom
