// A GigE Vision camera in software. Its images hold, in their first eight bytes, when they were exposed (ns since
// 1970): whatever a driver says about an image can be held against that.
//   fake_gige_camera ADDRESS SERIAL [PICTURE]
// PICTURE: a file with the bytes of an image, which is shown as it is at each exposure, and another one as soon as it
// is there.
#include <arv.h>
#include <sys/prctl.h>

#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fstream>

namespace {

void paint(ArvBuffer* buffer, void* picture, guint32, guint32, ArvPixelFormat) {
  const std::int64_t now =
      std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
  // The buffer's own size counts what was received, which is nothing on this side.
  const auto size = static_cast<std::size_t>(arv_buffer_get_image_width(buffer)) *
                    static_cast<std::size_t>(arv_buffer_get_image_height(buffer));
  auto* pixels = static_cast<unsigned char*>(const_cast<void*>(arv_buffer_get_data(buffer, nullptr)));
  std::memset(pixels, 100, size);
  if (picture != nullptr)
    std::ifstream(static_cast<const char*>(picture), std::ios::binary)
        .read(reinterpret_cast<char*>(pixels), static_cast<std::streamsize>(size));
  else if (size >= sizeof now)
    std::memcpy(pixels, &now, sizeof now);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3 && argc != 4) {
    std::fprintf(stderr, "usage: fake_gige_camera ADDRESS SERIAL [PICTURE]\n");
    return 2;
  }
  prctl(PR_SET_PDEATHSIG, SIGKILL);  // a test that is killed leaves no camera behind
  ArvGvFakeCamera* camera = arv_gv_fake_camera_new(argv[1], argv[2]);
  if (camera == nullptr || !arv_gv_fake_camera_is_running(camera)) {
    std::fprintf(stderr, "fake_gige_camera: cannot serve on %s\n", argv[1]);
    return 1;
  }
  ArvFakeCamera* sensor = arv_gv_fake_camera_get_fake_camera(camera);
  arv_fake_camera_set_fill_pattern(sensor, paint, argc == 4 ? argv[3] : nullptr);
  // How often it looks whether it has been triggered: at the default of 25 Hz two cameras would expose 40 ms apart
  // whenever a trigger meets such an instant.
  constexpr double kLooksPerSecond = 100;
  arv_fake_camera_set_trigger_frequency(sensor, kLooksPerSecond);
  for (;;) g_usleep(1000000);
}
