#include "sources/aravis/aravis_camera.hpp"

#include <arv.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <condition_variable>
#include <future>
#include <mutex>
#include <thread>

#include "cortshift_flow/range.hpp"
#include "sources/aravis/clock_map.hpp"
#include "sources/aravis/pixel_formats.hpp"

namespace cortshift_stereo {
namespace {

constexpr int kBuffers = 8;
constexpr std::uint64_t kPopMicroseconds = 50000;
constexpr double kMicroseconds = 1e6;

struct Unref {
  void operator()(void* object) const { g_object_unref(object); }
};
template <typename T>
using Object = std::unique_ptr<T, Unref>;

/// Turns GLib's errors into ours.
class Check {
 public:
  explicit Check(std::string camera) : camera_(std::move(camera)) {}
  ~Check() { g_clear_error(&error_); }
  Check(const Check&) = delete;
  Check& operator=(const Check&) = delete;

  GError** slot() { return &error_; }
  void that(const std::string& what) {
    if (error_ == nullptr) return;
    const std::string message = camera_ + " camera: " + what + ": " + error_->message;
    g_clear_error(&error_);
    throw SourceError(message);
  }

 private:
  std::string camera_;
  GError* error_ = nullptr;
};

}  // namespace

void AravisSettings::validate() const {
  for (const auto& [side, camera] : {std::make_pair("left", &left), std::make_pair("right", &right)}) {
    if (camera->device.empty())
      throw std::invalid_argument(std::string("the ") + side +
                                  " camera has no device: give its address or serial number");
    for (const std::string& feature : camera->features)
      if (feature.find('=') == std::string::npos || feature.front() == '=')
        throw std::invalid_argument(std::string("feature '") + feature + "' of the " + side +
                                    " camera is not NAME=VALUE");
  }
  if (left.device == right.device) throw std::invalid_argument("both cameras have the device " + left.device);
  const auto& formats = knownPixelFormats();
  if (std::find(formats.begin(), formats.end(), pixel_format) == formats.end()) bytesOfImage(pixel_format, {1, 1});
  cortshift_flow::requireRange("exposure", exposure, 1e-6, 1.0);
  cortshift_flow::requireRange("gain", gain, -100.0, 1000.0);
  cortshift_flow::requireRange("frame_rate", frame_rate, 0.1, 200.0);
  cortshift_flow::requireRange("sync_tolerance", sync_tolerance, 1e-6, 0.1);
  cortshift_flow::requireRange("timeout", timeout, 0.05, 30.0);
  cortshift_flow::requireRange("transfer_delay", transfer_delay, 0.0, 1.0);
  cortshift_flow::requireRange("packet_size", packet_size, 0, 16000);
  cortshift_flow::requireRange("frame_retention", frame_retention, 0.001, 10.0);
  cortshift_flow::requireRange("reconnect_min", reconnect_min, 0.05, 60.0);
  cortshift_flow::requireRange("reconnect_max", reconnect_max, reconnect_min, 600.0);
  // Beyond half a period the neighbour of an image could pass for its partner.
  if (sync_tolerance >= 0.4 / frame_rate) throw std::invalid_argument("sync_tolerance must be below 0.4 / frame_rate");
}

class AravisCamera::Implementation {
 public:
  Implementation(std::string name, AravisCameraSettings camera, const AravisSettings& common,
                 std::function<void(CameraFrame)> on_frame)
      : name_(std::move(name)),
        settings_(std::move(camera)),
        common_(common),
        on_frame_(std::move(on_frame)),
        thread_([this] { run(); }) {}

  ~Implementation() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stop_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }

  /// A camera that is gone lets Aravis wait for many seconds: a thread does that, and nobody waits for it longer than
  /// for a pair. Only one trigger is under way at a time.
  void softwareTrigger() {
    Object<ArvCamera> camera;
    {
      const std::lock_guard<std::mutex> lock(device_mutex_);
      if (!camera_) throw SourceError(name_ + " camera: not connected: " + state().fault);
      camera.reset(ARV_CAMERA(g_object_ref(camera_.get())));
    }
    std::future<void> trigger =
        std::async(std::launch::async, [name = name_, camera = std::shared_ptr<ArvCamera>(std::move(camera))] {
          Check check(name);
          arv_camera_software_trigger(camera.get(), check.slot());
          check.that("the software trigger failed");
        });
    try {
      if (trigger.wait_for(std::chrono::duration<double>(common_.timeout)) == std::future_status::ready)
        return trigger.get();
      waitLater(std::move(trigger));
      throw SourceError(name_ + " camera: the software trigger is not answered");
    } catch (const SourceError& error) {
      reconnect(error.what());
      throw;
    }
  }

  void reconnect(const std::string& reason) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (lost_.empty()) lost_ = reason;
    state_.connected = false;
    state_.fault = reason;
  }

  CameraState state() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return state_;
  }

 private:
  void run() {
    double wait = common_.reconnect_min;
    while (!stopping()) {
      try {
        connect();
        wait = common_.reconnect_min;
        receive();
      } catch (const SourceError& error) {
        setFault(error.what());
      }
      disconnect();
      std::unique_lock<std::mutex> lock(mutex_);
      changed_.wait_for(lock, std::chrono::duration<double>(wait), [this] { return stop_; });
      wait = std::min(2 * wait, common_.reconnect_max);
    }
  }

  bool stopping() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return stop_;
  }

  void setFault(const std::string& fault) {
    const std::lock_guard<std::mutex> lock(mutex_);
    state_.connected = false;
    state_.fault = fault;
  }

  void connect() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      lost_.clear();
    }
    clock_ = ClockMap();
    Check check(name_);
    Object<ArvCamera> camera(arv_camera_new(settings_.device.c_str(), check.slot()));
    check.that("cannot connect to " + settings_.device);
    // Of a driver that was killed it may still send images to the port, and lock what is to be set.
    arv_camera_stop_acquisition(camera.get(), nullptr);
    configure(camera.get());
    Object<ArvStream> stream(arv_camera_create_stream(camera.get(), nullptr, nullptr, check.slot()));
    check.that("no image stream");
    if (ARV_IS_GV_STREAM(stream.get()))
      // A whole image must fit into the socket's buffer: the system's default is too small for one.
      g_object_set(stream.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_AUTO, "socket-buffer-size", 0,
                   "packet-timeout", static_cast<guint>(common_.frame_retention * kMicroseconds / 5), "frame-retention",
                   static_cast<guint>(common_.frame_retention * kMicroseconds), nullptr);
    const guint payload = arv_camera_get_payload(camera.get(), check.slot());
    check.that("no payload size");
    for (int i = 0; i < kBuffers; ++i) arv_stream_push_buffer(stream.get(), arv_buffer_new_allocate(payload));
    g_signal_connect(arv_camera_get_device(camera.get()), "control-lost", G_CALLBACK(&controlLost), this);
    arv_camera_start_acquisition(camera.get(), check.slot());
    check.that("cannot start");
    const std::lock_guard<std::mutex> device_lock(device_mutex_);
    camera_ = std::move(camera);
    stream_ = std::move(stream);
    const std::lock_guard<std::mutex> lock(mutex_);
    state_.connected = true;
    state_.fault.clear();
    ++state_.connections;
  }

  void configure(ArvCamera* camera) {
    Check check(name_);
    if (arv_camera_is_gv_device(camera)) {
      if (!common_.packet_socket) arv_camera_gv_set_stream_options(camera, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
      if (common_.packet_size > 0) {
        arv_camera_gv_set_packet_size_adjustment(camera, ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
        arv_camera_gv_set_packet_size(camera, common_.packet_size, check.slot());
        check.that("packet_size " + std::to_string(common_.packet_size));
      }
    }
    arv_camera_set_pixel_format_from_string(camera, common_.pixel_format.c_str(), check.slot());
    check.that("pixel_format " + common_.pixel_format);
    arv_camera_set_acquisition_mode(camera, ARV_ACQUISITION_MODE_CONTINUOUS, check.slot());
    check.that("continuous acquisition");
    lockExposure(camera);
    if (settings_.trigger_source.empty()) {
      arv_camera_clear_triggers(camera, check.slot());
      check.that("no trigger");
      if (arv_camera_is_frame_rate_available(camera, nullptr)) {
        arv_camera_set_frame_rate(camera, common_.frame_rate, check.slot());
        check.that("frame_rate " + std::to_string(common_.frame_rate));
      }
    } else {
      arv_camera_set_trigger(camera, settings_.trigger_source.c_str(), check.slot());
      check.that("trigger_source " + settings_.trigger_source);
    }
    for (const std::string& feature : settings_.features) {
      arv_device_set_features_from_string(arv_camera_get_device(camera), feature.c_str(), check.slot());
      check.that("feature " + feature);
    }
  }

  /// The same in both cameras and constant from image to image: flow and matching compare grey levels.
  void lockExposure(ArvCamera* camera) {
    Check check(name_);
    ArvDevice* device = arv_camera_get_device(camera);
    for (const char* feature : {"ExposureAuto", "GainAuto", "BalanceWhiteAuto"}) {
      if (!arv_device_is_feature_available(device, feature, nullptr)) continue;
      arv_device_set_string_feature_value(device, feature, "Off", check.slot());
      check.that(std::string(feature) + " Off");
    }
    arv_camera_set_exposure_time(camera, common_.exposure * kMicroseconds, check.slot());
    check.that("exposure " + std::to_string(common_.exposure) + " s");
    double gain = 0;
    if (arv_camera_is_gain_available(camera, nullptr)) {
      arv_camera_set_gain(camera, common_.gain, check.slot());
      check.that("gain " + std::to_string(common_.gain));
      gain = arv_camera_get_gain(camera, check.slot());
      check.that("gain");
    }
    const double exposure = arv_camera_get_exposure_time(camera, check.slot()) / kMicroseconds;
    check.that("exposure");
    if (std::abs(exposure - common_.exposure) > 0.01 * common_.exposure)
      throw SourceError(name_ + " camera: exposes for " + std::to_string(exposure) + " s in place of " +
                        std::to_string(common_.exposure) + " s; choose an exposure that it can do");
    const std::lock_guard<std::mutex> lock(mutex_);
    state_.exposure = exposure;
    state_.gain = gain;
  }

  static void controlLost(ArvDevice*, Implementation* self) { self->reconnect(self->name_ + " camera: lost"); }

  void receive() {
    for (;;) {
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        if (stop_) return;
        if (!lost_.empty()) throw SourceError(lost_);
      }
      ArvBuffer* buffer = arv_stream_timeout_pop_buffer(stream_.get(), kPopMicroseconds);
      if (buffer == nullptr) continue;
      CameraFrame frame = frameOf(buffer);
      arv_stream_push_buffer(stream_.get(), buffer);
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        ++(frame.image.empty() ? state_.incomplete : state_.frames);
        state_.clock_drift = clock_.drift();
      }
      on_frame_(std::move(frame));
    }
  }

  CameraFrame frameOf(ArvBuffer* buffer) {
    CameraFrame frame;
    frame.id = arv_buffer_get_frame_id(buffer);
    std::size_t bytes = 0;
    const void* data = arv_buffer_get_data(buffer, &bytes);
    if (arv_buffer_get_status(buffer) != ARV_BUFFER_STATUS_SUCCESS) return frame;
    const cv::Size size(arv_buffer_get_image_width(buffer), arv_buffer_get_image_height(buffer));
    if (bytes < bytesOfImage(common_.pixel_format, size)) return frame;
    const Stamp device(static_cast<Stamp::rep>(arv_buffer_get_timestamp(buffer)));
    const double jumped = clock_.add(device, Stamp(static_cast<Stamp::rep>(arv_buffer_get_system_timestamp(buffer))));
    if (jumped != 0) {
      const std::lock_guard<std::mutex> lock(mutex_);
      ++state_.clock_jumps;
      state_.last_clock_jump = jumped;
    }
    // The camera stamps the beginning of the exposure.
    frame.stamp = clock_.toHost(device) + fromSeconds(common_.exposure / 2 - common_.transfer_delay);
    frame.image = toBgr(common_.pixel_format, size, data);
    return frame;
  }

  /// Nobody but the destructor waits for it.
  void waitLater(std::future<void> future) {
    const std::lock_guard<std::mutex> lock(later_mutex_);
    later_.erase(std::remove_if(later_.begin(), later_.end(),
                                [](const std::future<void>& f) {
                                  return f.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
                                }),
                 later_.end());
    later_.push_back(std::move(future));
  }

  /// Saying goodbye to a camera that is gone takes seconds, too.
  void disconnect() {
    Object<ArvCamera> camera;
    Object<ArvStream> stream;
    {
      const std::lock_guard<std::mutex> lock(device_mutex_);
      camera = std::move(camera_);
      stream = std::move(stream_);
    }
    if (!camera) return;
    g_signal_handlers_disconnect_by_data(arv_camera_get_device(camera.get()), this);
    const bool gone = !stopping();
    waitLater(std::async(std::launch::async, [gone, c = camera.release(), s = stream.release()] {
      if (!gone) arv_camera_stop_acquisition(c, nullptr);
      g_object_unref(s);
      g_object_unref(c);
    }));
  }

  const std::string name_;
  const AravisCameraSettings settings_;
  const AravisSettings common_;
  const std::function<void(CameraFrame)> on_frame_;

  ClockMap clock_;  // the thread's own

  std::mutex device_mutex_;  // taken before mutex_
  Object<ArvCamera> camera_;
  Object<ArvStream> stream_;

  std::mutex later_mutex_;
  std::vector<std::future<void>> later_;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  bool stop_ = false;
  std::string lost_;
  CameraState state_;
  std::thread thread_;
};

AravisCamera::AravisCamera(const std::string& name, const AravisCameraSettings& camera, const AravisSettings& common,
                           std::function<void(CameraFrame)> on_frame)
    : implementation_(std::make_unique<Implementation>(name, camera, common, std::move(on_frame))) {}
AravisCamera::~AravisCamera() = default;
void AravisCamera::softwareTrigger() { implementation_->softwareTrigger(); }
void AravisCamera::reconnect(const std::string& reason) { implementation_->reconnect(reason); }
CameraState AravisCamera::state() const { return implementation_->state(); }

}  // namespace cortshift_stereo
