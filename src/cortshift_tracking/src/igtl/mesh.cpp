#include "cortshift_tracking/igtl/mesh.hpp"

#include <stdexcept>

namespace cortshift_tracking::igt {
namespace {

template <typename T>
void requireSize(const std::vector<T>& list, std::size_t size, const char* what, bool may_be_empty = true) {
  if (list.size() == size || (may_be_empty && list.empty())) return;
  throw std::invalid_argument(std::string(what) + ": " + std::to_string(list.size()) + " entries for a grid of " +
                              std::to_string(size));
}

constexpr std::uint32_t kNoPoint = 0xffffffff;

}  // namespace

LinkMesh makeMesh(const PointGrid& grid, int step, const LinkSpace& space) {
  if (step < 1) throw std::invalid_argument("step " + std::to_string(step) + " is not allowed; allowed is 1 or more");
  if (grid.rows < 0 || grid.columns < 0) throw std::invalid_argument("a grid cannot have a negative size");
  const std::size_t size = static_cast<std::size_t>(grid.rows) * static_cast<std::size_t>(grid.columns);
  requireSize(grid.points_pmr, size, "points", false);
  requireSize(grid.displacements_pmr, size, "displacements");
  requireSize(grid.confidence, size, "confidence");
  requireSize(grid.colours_rgb, size, "colours");

  LinkMesh mesh;
  const auto toLink = [&](const Eigen::Vector3f& vector) -> Eigen::Vector3f {
    return space.vectorToLink(vector.cast<double>()).cast<float>();
  };
  std::vector<std::uint32_t> above, row;  // index of each column's point in the mesh
  for (int r = 0; r < grid.rows; r += step) {
    row.clear();
    for (int c = 0; c < grid.columns; c += step) {
      const std::size_t i =
          static_cast<std::size_t>(r) * static_cast<std::size_t>(grid.columns) + static_cast<std::size_t>(c);
      const bool valid =
          grid.points_pmr[i].allFinite() && (grid.displacements_pmr.empty() || grid.displacements_pmr[i].allFinite());
      row.push_back(valid ? static_cast<std::uint32_t>(mesh.points_mm.size()) : kNoPoint);
      if (!valid) continue;
      mesh.points_mm.push_back(toLink(grid.points_pmr[i]));
      if (!grid.displacements_pmr.empty()) mesh.displacements_mm.push_back(toLink(grid.displacements_pmr[i]));
      if (!grid.confidence.empty()) mesh.confidence.push_back(grid.confidence[i]);
      if (!grid.colours_rgb.empty()) mesh.colours_rgb.push_back(grid.colours_rgb[i]);
    }
    for (std::size_t c = 1; c < row.size() && !above.empty(); ++c)
      if (above[c - 1] != kNoPoint && above[c] != kNoPoint && row[c] != kNoPoint && row[c - 1] != kNoPoint)
        mesh.cells.push_back({above[c - 1], above[c], row[c], row[c - 1]});
    above.swap(row);
  }
  return mesh;
}

}  // namespace cortshift_tracking::igt
