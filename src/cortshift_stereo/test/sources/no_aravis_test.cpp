// A build without Aravis, in which no_aravis_camera.cpp is compiled.
#include <gmock/gmock.h>

#include "sources/aravis/aravis_camera.hpp"

namespace cortshift_stereo {
namespace {

TEST(NoAravis, SaysWhatIsMissingAndWhatToDo) {
  try {
    const AravisCamera camera("left", {}, {}, [](CameraFrame) {});
    FAIL() << "a camera without Aravis";
  } catch (const SourceError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("left camera: source aravis is not in this build"));
    EXPECT_THAT(error.what(), testing::HasSubstr("libaravis-dev"));
  }
}

}  // namespace
}  // namespace cortshift_stereo
