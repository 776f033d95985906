// The heap of a program that works on images.
#pragma once

#include <malloc.h>

namespace cortshift_stereo {

/// For a program that works on one image after another. Keeps freed memory in the process: the next pair needs as much,
/// and getting it from the system again would cost a tenth of the time.
inline void keepFreedMemory() {
  constexpr int kLargest = 512 << 20;  // bytes
  mallopt(M_MMAP_THRESHOLD, kLargest);
  mallopt(M_TRIM_THRESHOLD, kLargest);
}

/// For a program that keeps images and surfaces for a while, in many threads. Large blocks go back to the system: kept,
/// they leave gaps that the next one does not fit, and the process grows (script/soak tells by how much).
inline void giveFreedMemoryBack() {
  constexpr int kLarge = 1 << 20, kTop = 64 << 20;  // bytes
  constexpr int kArenas = 4;                        // threads come and go with requests; each might have one of its own
  mallopt(M_MMAP_THRESHOLD, kLarge);
  mallopt(M_TRIM_THRESHOLD, kTop);
  mallopt(M_ARENA_MAX, kArenas);
}

}  // namespace cortshift_stereo
