// Messages to OpenIGTLink peers, ready to be sent.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <vector>

#include "cortshift_tracking/igtl/mesh.hpp"
#include "cortshift_tracking/igtl/wire.hpp"

namespace cortshift_tracking::igt {

/// Device name (at most 20 characters) and time of the data (ns since 1970) of a message.
struct Label {
  std::string device;
  std::int64_t stamp_ns = 0;
};

/// POLYDATA: points [mm] with cells, and as point data the vectors `displacement` [mm], `confidence` and `rgba`
/// (0...1), as far as the mesh carries them.
Bytes composePolyData(const Label& label, const LinkMesh& mesh);

/// An 8-bit picture. Pixel (row 0, column 0) comes first.
struct Picture {
  int rows = 0;
  int columns = 0;
  int channels = 3;                      ///< 1, or 3: red green blue
  const std::uint8_t* pixels = nullptr;  ///< rows x columns x channels without gaps; must live during the call
};

/// IMAGE of one slice.
/// @param matrix_mm  4 x 4, maps (column, row, 0) of a pixel to the link's space [mm]
Bytes composeImage(const Label& label, const Picture& picture, const Eigen::Matrix4d& matrix_mm, Axes axes);

/// A volume of float32. Voxel (0, 0, 0) comes first, columns run fastest, then rows.
struct Voxels {
  int columns = 0;
  int rows = 0;
  int slices = 0;
  const float* values = nullptr;  ///< columns x rows x slices; must live during the call
};

/// IMAGE of a volume.
/// @param matrix_mm  4 x 4, maps (column, row, slice) of a voxel to the link's space [mm]
Bytes composeVolume(const Label& label, const Voxels& voxels, const Eigen::Matrix4d& matrix_mm, Axes axes);

/// STRING; text beyond 65535 bytes is cut.
Bytes composeString(const Label& label, const std::string& text);

/// NDARRAY with one dimension of float64.
Bytes composeArray(const Label& label, const std::vector<double>& values);

/// STATUS: code 1 is OK.
Bytes composeStatus(const Label& label, int code, const std::string& text);

/// RTS_COMMAND of protocol version 3: answer to the COMMAND with this id; metadata `Status` says SUCCESS or FAIL.
Bytes composeCommandReply(const Label& label, const Command& command, bool success, const std::string& text);

/// STT_TDATA: asks a tracker for TDATA, one every `period_ms`.
Bytes composeStartTracking(const Label& label, int period_ms);

}  // namespace cortshift_tracking::igt
