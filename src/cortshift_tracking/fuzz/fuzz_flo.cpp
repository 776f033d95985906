// .flo files.
#include <stdexcept>

#include "bytes_as_file.hpp"
#include "cortshift_flow/flo_file.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const BytesAsFile file(data, size);
  try {
    cortshift_flow::readFlo(file.path());
  } catch (const std::runtime_error&) {
  }
  return 0;
}
