#include "cortshift_stereo/small_matrices.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <optional>
#include <string>

namespace cortshift_stereo {
namespace {

TEST(SmallMatrices, StayOnOneThread) {
  std::ifstream maps("/proc/self/maps");
  const std::string loaded((std::istreambuf_iterator<char>(maps)), {});
  const bool openblas = loaded.find("openblas") != std::string::npos;  // or another LAPACK
  EXPECT_EQ(threadsForMatrices(), openblas ? std::make_optional(1) : std::nullopt);
}

}  // namespace
}  // namespace cortshift_stereo
