#include "cortshift_tracking/igtl/request.hpp"

#include <gtest/gtest.h>

namespace cortshift_tracking::igt {
namespace {

TEST(Request, CaptureStage) {
  const Request request = parseRequest("capture_stage dura_open  before the cut");
  EXPECT_EQ(request.kind, Request::Kind::kCaptureStage);
  EXPECT_EQ(request.key, "dura_open");
  EXPECT_EQ(request.note, "before the cut");
  EXPECT_EQ(parseRequest("capture_stage k").note, "");
}

TEST(Request, ComputeShift) {
  const Request request = parseRequest("compute_shift a b");
  EXPECT_EQ(request.kind, Request::Kind::kComputeShift);
  EXPECT_EQ(request.from_key, "a");
  EXPECT_EQ(request.to_key, "b");
}

TEST(Request, CommandNameAndContent) {
  EXPECT_EQ(joinRequest("capture_stage", "k"), "capture_stage k");
  EXPECT_EQ(joinRequest("capture_stage", "capture_stage k"), "capture_stage k");
  EXPECT_EQ(joinRequest("Slicer_1", "capture_stage k"), "capture_stage k");
}

TEST(Request, RefusesTheRest) {
  for (const char* text : {"", "capture_stage", "capture_stage ../etc", "capture_stage a/b", "compute_shift a",
                           "compute_shift a b c", "rm -rf", "capture_stage k\nx", "CAPTURE_STAGE k"})
    EXPECT_THROW(parseRequest(text), std::invalid_argument) << text;
  EXPECT_THROW(parseRequest("capture_stage " + std::string(65, 'k')), std::invalid_argument);
  EXPECT_THROW(parseRequest("capture_stage k " + std::string(2000, 'x')), std::invalid_argument);
}

}  // namespace
}  // namespace cortshift_tracking::igt
