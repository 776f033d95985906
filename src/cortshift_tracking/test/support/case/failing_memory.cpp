#include "case/failing_memory.hpp"

#include <cstdlib>
#include <new>

namespace failing_memory {

std::atomic<long> pieces{kUnlimited};

}  // namespace failing_memory

using namespace failing_memory;

void* operator new(std::size_t size) {
  if (size >= kLarge && pieces != kUnlimited && pieces-- <= 0) {
    pieces = 0;
    throw std::bad_alloc();
  }
  if (void* room = std::malloc(size)) return room;
  throw std::bad_alloc();
}

void operator delete(void* room) noexcept { std::free(room); }
void operator delete(void* room, std::size_t) noexcept { std::free(room); }
