// Organised grids of points as polygon meshes in the link's space.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "cortshift_tracking/igtl/space.hpp"

namespace cortshift_tracking::igt {

/// rows x columns points in pmr [m], row by row; NaN where there is none. An empty list: the grid does not carry it.
struct PointGrid {
  int rows = 0;
  int columns = 0;
  std::vector<Eigen::Vector3f> points_pmr;
  std::vector<Eigen::Vector3f> displacements_pmr;
  std::vector<float> confidence;             ///< 0...1
  std::vector<Eigen::Vector3f> colours_rgb;  ///< red green blue, 0...1
};

/// The grid's valid points with the four-cornered cells between them; lists run over the points.
struct LinkMesh {
  std::vector<Eigen::Vector3f> points_mm;
  std::vector<Eigen::Vector3f> displacements_mm;
  std::vector<float> confidence;
  std::vector<Eigen::Vector3f> colours_rgb;
  std::vector<std::array<std::uint32_t, 4>> cells;  ///< corners in order around the cell
};

/// Takes every `step`-th row and column. A point without position, or without displacement where the grid has
/// displacements, is left out, and so is every cell that would need it.
/// @throws std::invalid_argument if step < 1 or a list does not fit rows x columns.
LinkMesh makeMesh(const PointGrid& grid, int step, const LinkSpace& space);

/// Writes a legacy VTK file (binary PolyData) of the mesh: point data `displacement` [mm], `confidence`, `rgb`.
/// The title says the axes in the form that 3D Slicer reads. Durably: never half there.
/// By hand: libvtk9-dev brings 98 Debian packages (252 MB) for 40 lines.
/// @throws std::runtime_error naming the file and the cause.
void writeVtk(const std::string& path, const std::string& title, const LinkMesh& mesh, Axes axes);

}  // namespace cortshift_tracking::igt
