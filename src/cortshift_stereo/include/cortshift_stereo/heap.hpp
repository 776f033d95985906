// The heap of a program that works on one image after another.
#pragma once

#include <malloc.h>

namespace cortshift_stereo {

/// Keeps freed memory in the process: the next pair needs as much, and getting it from the system again would cost a
/// tenth of the time.
inline void keepFreedMemory() {
  constexpr int kLargest = 512 << 20;  // bytes
  mallopt(M_MMAP_THRESHOLD, kLargest);
  mallopt(M_TRIM_THRESHOLD, kLargest);
}

}  // namespace cortshift_stereo
