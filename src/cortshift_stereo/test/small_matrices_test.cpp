#include "cortshift_stereo/small_matrices.hpp"

#include <gtest/gtest.h>

namespace cortshift_stereo {
namespace {

TEST(SmallMatrices, StayOnOneThread) { EXPECT_EQ(threadsForMatrices().value_or(1), 1); }

}  // namespace
}  // namespace cortshift_stereo
