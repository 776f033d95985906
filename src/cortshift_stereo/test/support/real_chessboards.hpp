// The 13 real chessboard pairs of Debian's package opencv-doc: 9x6 inner corners, squares of 25 mm, no pair 10.
#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

#include "cortshift_stereo/calibration/board.hpp"

namespace cortshift_stereo {

inline const Board kRealBoard{{9, 6}, 0.025};
inline const std::vector<std::string> kRealViews{"01", "02", "03", "04", "05", "06", "07",
                                                 "08", "09", "11", "12", "13", "14"};

inline std::string realChessboards() {
  const std::string folder = "/usr/share/doc/opencv-doc/examples/data";
  if (!std::filesystem::exists(folder + "/left01.jpg"))
    throw std::runtime_error(folder + "/left01.jpg is missing: install opencv-doc (and let dpkg unpack documentation)");
  return folder;
}

/// Copy the first pairs into another folder, for tests that spoil some.
inline void copyRealChessboards(const std::string& folder, std::size_t count = kRealViews.size()) {
  for (std::size_t i = 0; i < count; ++i)
    for (const std::string side : {"left", "right"}) {
      const std::string name = side + kRealViews[i] + ".jpg";
      std::filesystem::copy_file(realChessboards() + "/" + name, folder + "/" + name);
    }
}

}  // namespace cortshift_stereo
