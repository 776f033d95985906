#include <cmath>
#include <cstring>

#include "cortshift_stereo/durable_file.hpp"
#include "cortshift_tracking/igtl/mesh.hpp"

namespace cortshift_tracking::igt {
namespace {

/// Legacy VTK stores numbers with the most significant byte first.
void put(std::string& out, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) out.push_back(static_cast<char>(value >> shift & 0xff));
}

void put(std::string& out, float value) {
  std::uint32_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  put(out, bits);
}

void put(std::string& out, const std::vector<Eigen::Vector3f>& vectors) {
  for (const Eigen::Vector3f& v : vectors)
    for (int i = 0; i < 3; ++i) put(out, v[i]);
}

}  // namespace

void writeVtk(const std::string& path, const std::string& title, const LinkMesh& mesh, Axes axes) {
  const std::string points = std::to_string(mesh.points_mm.size());
  const std::string cells = std::to_string(mesh.cells.size());
  std::string out = "# vtk DataFile Version 3.0\n" + title + "; mm; SPACE=" + (axes == Axes::kRas ? "RAS" : "LPS") +
                    "\nBINARY\nDATASET POLYDATA\nPOINTS " + points + " float\n";
  put(out, mesh.points_mm);
  out += "\nPOLYGONS " + cells + " " + std::to_string(mesh.cells.size() * 5) + "\n";
  for (const auto& cell : mesh.cells) {
    put(out, std::uint32_t{4});
    for (const std::uint32_t corner : cell) put(out, corner);
  }
  out += "\nPOINT_DATA " + points + "\n";
  if (!mesh.confidence.empty()) {
    out += "SCALARS confidence float 1\nLOOKUP_TABLE default\n";
    for (const float value : mesh.confidence) put(out, value);
    out += "\n";
  }
  if (!mesh.displacements_mm.empty()) {
    out += "VECTORS displacement float\n";
    put(out, mesh.displacements_mm);
    out += "\n";
  }
  if (!mesh.colours_rgb.empty()) {
    out += "COLOR_SCALARS rgb 3\n";
    for (const Eigen::Vector3f& colour : mesh.colours_rgb)
      for (int i = 0; i < 3; ++i) out.push_back(static_cast<char>(std::lround(255 * colour[i])));
    out += "\n";
  }
  cortshift_stereo::replaceDurably(path, out.data(), out.size());
}

}  // namespace cortshift_tracking::igt
