// A machine that has no room left for something large: the program's operator new comes here.
#pragma once

#include <atomic>
#include <cstddef>

namespace failing_memory {

constexpr std::size_t kLarge = 100000;  // bytes
constexpr long kUnlimited = -1;

extern std::atomic<long> pieces;  ///< large ones that are still given; then each is refused

}  // namespace failing_memory
