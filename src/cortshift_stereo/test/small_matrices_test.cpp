#include "cortshift_stereo/small_matrices.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <string>

namespace cortshift_stereo {
namespace {

TEST(SmallMatrices, StayOnOneThread) {
  std::ifstream maps("/proc/self/maps");
  const std::string loaded((std::istreambuf_iterator<char>(maps)), {});
  if (loaded.find("openblas") == std::string::npos) GTEST_SKIP() << "another LAPACK than OpenBLAS is installed";
  ASSERT_TRUE(threadsForMatrices());
  EXPECT_EQ(*threadsForMatrices(), 1);
}

}  // namespace
}  // namespace cortshift_stereo
