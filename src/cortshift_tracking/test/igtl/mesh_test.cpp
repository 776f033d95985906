#include "cortshift_tracking/igtl/mesh.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <limits>

namespace cortshift_tracking::igt {
namespace {

const LinkSpace kSpace(Axes::kRas, Axes::kLps);
const Eigen::Vector3f kNowhere = Eigen::Vector3f::Constant(std::numeric_limits<float>::quiet_NaN());

PointGrid grid(int rows, int columns) {
  PointGrid result;
  result.rows = rows;
  result.columns = columns;
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < columns; ++c) {
      result.points_pmr.emplace_back(0.001F * static_cast<float>(c), 0.002F * static_cast<float>(r), 0.3F);
      result.displacements_pmr.emplace_back(0.001F, 0.0F, 0.004F);
    }
  return result;
}

TEST(Mesh, PointsCellsAndAxes) {
  const LinkMesh mesh = makeMesh(grid(3, 4), 1, kSpace);
  ASSERT_EQ(mesh.points_mm.size(), 12u);
  ASSERT_EQ(mesh.cells.size(), 6u);
  EXPECT_LT((mesh.points_mm[5] - Eigen::Vector3f(-1, -2, 300)).norm(), 1e-4F);
  EXPECT_LT((mesh.displacements_mm[5] - Eigen::Vector3f(-1, 0, 4)).norm(), 1e-5F);
  EXPECT_EQ(mesh.cells[0], (std::array<std::uint32_t, 4>{0, 1, 5, 4}));
}

TEST(Mesh, HolesTakeTheirCellsWithThem) {
  PointGrid holed = grid(3, 3);
  holed.points_pmr[0] = kNowhere;
  EXPECT_EQ(makeMesh(holed, 1, kSpace).points_mm.size(), 8u);
  EXPECT_EQ(makeMesh(holed, 1, kSpace).cells.size(), 3u);
  holed.displacements_pmr[4] = kNowhere;  // the middle one
  const LinkMesh mesh = makeMesh(holed, 1, kSpace);
  EXPECT_EQ(mesh.points_mm.size(), 7u);
  EXPECT_TRUE(mesh.cells.empty());
}

TEST(Mesh, StepThinsOut) {
  const LinkMesh mesh = makeMesh(grid(5, 6), 2, kSpace);
  EXPECT_EQ(mesh.points_mm.size(), 9u);
  EXPECT_EQ(mesh.cells.size(), 4u);
  EXPECT_TRUE(makeMesh(grid(0, 0), 1, kSpace).points_mm.empty());
}

TEST(Mesh, RefusesListsThatDoNotFit) {
  PointGrid wrong = grid(2, 2);
  wrong.displacements_pmr.pop_back();
  EXPECT_THROW(makeMesh(wrong, 1, kSpace), std::invalid_argument);
  EXPECT_THROW(makeMesh(grid(2, 2), 0, kSpace), std::invalid_argument);
}

TEST(VtkFile, IsWholeOrNotThere) {
  const std::string path = ::testing::TempDir() + "igtl_mesh_test.vtk";
  writeVtk(path, "two stages", makeMesh(grid(2, 2), 1, kSpace), Axes::kLps);
  std::ifstream file(path, std::ios::binary);
  const std::string text((std::istreambuf_iterator<char>(file)), {});
  EXPECT_NE(text.find("two stages; mm; SPACE=LPS\nBINARY\nDATASET POLYDATA\nPOINTS 4 float\n"), std::string::npos);
  EXPECT_NE(text.find("POLYGONS 1 5\n"), std::string::npos);
  EXPECT_NE(text.find("VECTORS displacement float\n"), std::string::npos);
  EXPECT_FALSE(std::ifstream(path + ".part"));
  EXPECT_THROW(writeVtk(path + "/below_a_file.vtk", "t", makeMesh(grid(2, 2), 1, kSpace), Axes::kRas),
               std::runtime_error);
  std::remove(path.c_str());
}

}  // namespace
}  // namespace cortshift_tracking::igt
