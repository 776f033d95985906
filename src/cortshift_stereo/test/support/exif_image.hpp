// Jpeg files that carry an EXIF orientation, as cameras held upright write them.
#pragma once

#include <cstdint>
#include <vector>

namespace cortshift_stereo_test {

/// The same file with an EXIF segment right after its start.
inline std::vector<std::uint8_t> withOrientation(const std::vector<std::uint8_t>& jpeg, std::uint8_t orientation,
                                                 bool big_endian = true) {
  const std::vector<std::uint8_t> big{'M', 'M', 0, 42, 0, 0, 0,           8, 0, 1, 1, 0x12, 0,
                                      3,   0,   0, 0,  1, 0, orientation, 0, 0, 0, 0, 0,    0};
  const std::vector<std::uint8_t> little{'I', 'I', 42, 0, 8, 0,           0, 0, 1, 0, 0x12, 1, 3,
                                         0,   1,   0,  0, 0, orientation, 0, 0, 0, 0, 0,    0, 0};
  const std::vector<std::uint8_t>& tiff = big_endian ? big : little;
  std::vector<std::uint8_t> out(jpeg.begin(), jpeg.begin() + 2);
  const auto length = static_cast<std::uint8_t>(2 + 6 + tiff.size());
  for (const int byte : {0xff, 0xe1, 0x00, int{length}, int{'E'}, int{'x'}, int{'i'}, int{'f'}, 0, 0})
    out.push_back(static_cast<std::uint8_t>(byte));
  out.insert(out.end(), tiff.begin(), tiff.end());
  out.insert(out.end(), jpeg.begin() + 2, jpeg.end());
  return out;
}

}  // namespace cortshift_stereo_test
