// In the place of aravis_camera.cpp where Aravis 0.8 is not installed, as on Ubuntu 20.04: all else works, and this
// source says so.
#include "sources/aravis/aravis_camera.hpp"

namespace cortshift_stereo {

class AravisCamera::Implementation {};

AravisCamera::AravisCamera(const std::string& name, const AravisCameraSettings&, const AravisSettings&,
                           std::function<void(CameraFrame)>) {
  throw SourceError(
      name + " camera: source aravis is not in this build, for which Aravis 0.8 was not found; install it " +
      "(libaravis-dev, libusb-1.0-0-dev, zlib1g-dev on Debian 12) and build again, or choose another source");
}
AravisCamera::~AravisCamera() = default;
void AravisCamera::softwareTrigger() {}
void AravisCamera::reconnect(const std::string&) {}
CameraState AravisCamera::state() const { return {}; }

}  // namespace cortshift_stereo
