// Records a phantom case as a bag, offline: what a driver and a tracker would have published in an operating room.
#include <cortshift_msgs/MicroscopeSettings.h>
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/TransformStamped.h>
#include <rosbag/bag.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <tf2_msgs/TFMessage.h>

#include <boost/make_shared.hpp>
#include <cmath>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>

#include "cortshift_stereo/command_line.hpp"
#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_stereo_phantom/phantom_renderer.hpp"
#include "sources/phantom/phantom_motion.hpp"
#include "sources/phantom/simulated_tracker.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_stereo_phantom::PhantomPairs;
using cortshift_stereo_phantom::PhantomScene;

const char* const kHelp =
    R"(phantom_bag --case CASE.yaml --output FILE.bag [--first-pairs 2]

Record a phantom case as a ROS bag: every stage once, with lossless compressed images, camera_info, the microscope's
pose and settings, and /tf of a 20 Hz tracker with microscope and probe.

  --case FILE      phantom case, for instance config/phantom/phantom_case.yaml
  --output FILE    bag to write
  --first-pairs N  pairs of the first stage; the others get one each

The same case gives the same messages every time.
Exit: 0 done, 1 failed, 2 bad usage.
)";

// When things happen [s]. A stage lasts kStage, the move to the next one included.
constexpr double kBegin = 1.7e9;  // ROS time of the recording's start
constexpr double kStage = 9.0;
constexpr double kFirstPair = 3.0;  // from the start of a stage
constexpr double kBetweenPairs = 2.0;
constexpr double kTail = 1.0;            // tracker samples after the last stage
constexpr double kDelay = 0.003;         // from a stamp to the arrival of its message
constexpr double kTrackerPhase = 0.017;  // pairs fall between two samples

class Recorder {
 public:
  Recorder(const std::string& path, const std::shared_ptr<const PhantomScene>& scene)
      : scene_(scene), pairs_(scene), motion_(scene, motionSettings(), 0, at(0)), tracker_({}) {
    bag_.open(path, rosbag::bagmode::Write);
  }

  void record(int first_pairs, const std::function<void(double)>& progress) {
    writeStaticTransforms();
    const int stages = scene_->stageCount();
    for (int stage = 0; stage < stages; ++stage) {
      const double begin = stage * kStage;
      if (stage > 0) motion_.moveTo(stage, at(begin));
      writeSettings(stage, begin);
      const int count = stage == 0 ? first_pairs : 1;
      for (int i = 0; i < count; ++i) {
        const double exposure = begin + kFirstPair + i * kBetweenPairs;
        trackUntil(exposure);
        writePair(stage, exposure);
        if (progress) progress((stage + static_cast<double>(i + 1) / count) / stages);
      }
      trackUntil(begin + kStage + (stage + 1 == stages ? kTail : 0));
    }
    bag_.close();
  }

 private:
  static PhantomMotionSettings motionSettings() {
    PhantomMotionSettings settings;
    settings.probe_dwell = 0.9;
    settings.probe_travel = 0.4;
    return settings;
  }

  static Stamp at(double seconds) { return fromSeconds(kBegin + seconds); }

  static ros::Time rosTime(double seconds) {
    return ros::Time().fromNSec(static_cast<std::uint64_t>(at(seconds).count()));
  }

  static std_msgs::Header header(const std::string& frame, double seconds) {
    std_msgs::Header result;
    result.frame_id = frame;
    result.stamp = rosTime(seconds);
    return result;
  }

  static geometry_msgs::TransformStamped edge(const std::string& parent, const std::string& child,
                                              const Eigen::Isometry3d& T, double seconds) {
    geometry_msgs::TransformStamped message;
    message.header = header(parent, seconds);
    message.child_frame_id = child;
    message.transform = toTransform(T);
    return message;
  }

  /// @param latching late subscribers to a player of the bag get the message too
  template <typename Message>
  void write(const std::string& topic, double stamp, const Message& message, bool latching = false) {
    const auto connection = boost::make_shared<ros::M_string>();
    (*connection)["topic"] = topic;
    (*connection)["type"] = ros::message_traits::datatype(message);
    (*connection)["md5sum"] = ros::message_traits::md5sum(message);
    (*connection)["message_definition"] = ros::message_traits::definition(message);
    (*connection)["callerid"] = "/phantom_bag";
    if (latching) (*connection)["latching"] = "1";
    bag_.write(topic, rosTime(stamp + kDelay), message, connection);
  }

  void writeStaticTransforms() {
    const auto& description = scene_->description();
    const auto& head = scene_->stereoHead();
    tf2_msgs::TFMessage message;
    message.transforms = {edge("pmr", "reference", description.T_pmr_reference, 0),
                          edge("microscope", "left_optical", description.T_microscope_head * head.T_head_left, 0),
                          edge("left_optical", "right_optical", head.T_left_right(), 0)};
    write("/tf_static", 0, message, true);
  }

  void writeSettings(int stage, double seconds) {
    const auto& settings = scene_->description().stages[static_cast<std::size_t>(stage)];
    cortshift_msgs::MicroscopeSettings message;
    message.header = header("microscope", seconds);
    message.magnification = settings.magnification;
    message.focal_length = settings.focal_length;
    write("/microscope/settings", seconds, message, true);
  }

  /// In the order of time: players trust the order of the file.
  void trackUntil(double end) {
    for (; tracked_ < end; tracked_ += 1 / TrackerSettings{}.rate) writeTracker(tracked_);
  }

  void writeTracker(double seconds) {
    tf2_msgs::TFMessage message;
    message.transforms.push_back(
        edge("reference", "microscope", tracker_.measure(motion_.T_reference_microscope(at(seconds))), seconds));
    if (const auto tip = motion_.T_reference_probe_tip(at(seconds)))
      message.transforms.push_back(edge("reference", "probe_tip", tracker_.measure(*tip), seconds));
    write("/tf", seconds, message);
  }

  void writePair(int stage, double seconds) {
    const auto images = pairs_.take(stage, frame_++);
    const auto& model = scene_->stereoHead().model;
    geometry_msgs::PoseStamped pose;
    pose.header = header("reference", seconds);
    pose.pose = toPose(motion_.T_reference_microscope(at(seconds)));
    write("/microscope/pose", seconds, pose);
    writeCamera("left", images.left, model.left, seconds);
    writeCamera("right", images.right, model.right, seconds);
  }

  void writeCamera(const std::string& side, const cv::Mat& image, const CameraModel& camera, double seconds) {
    write("/stereo/" + side + "/camera_info", seconds, toCameraInfo(camera, header("left_optical", seconds)));
    sensor_msgs::CompressedImage message;
    message.header = header(side + "_optical", seconds);
    message.format = "bgr8; png compressed bgr8";
    if (!cv::imencode(".png", image, message.data, {cv::IMWRITE_PNG_COMPRESSION, 9}))
      throw std::runtime_error("an image could not be compressed as png");
    write("/stereo/" + side + "/image_raw/compressed", seconds, message);
  }

  std::shared_ptr<const PhantomScene> scene_;
  PhantomPairs pairs_;
  PhantomMotion motion_;
  SimulatedTracker tracker_;
  rosbag::Bag bag_;
  std::uint64_t frame_ = 0;
  double tracked_ = kTrackerPhase;  // time of the next tracker sample [s]
};

void run(const Options& options) {
  const double first_pairs = options.number("first-pairs", 2);
  if (!(first_pairs >= 1 && first_pairs <= 3) || first_pairs != std::floor(first_pairs))
    throw UsageError("--first-pairs must be 1, 2 or 3");
  const auto scene =
      std::make_shared<const PhantomScene>(cortshift_stereo_phantom::loadPhantomCase(options.required("case")));
  // Written beside its place and renamed when whole, so that no half bag is taken for a recording.
  const std::string path = options.required("output"), part = path + ".part";
  Recorder(part, scene).record(static_cast<int>(first_pairs), progressBar("rendering"));
  std::filesystem::rename(part, path);
}

}  // namespace
}  // namespace cortshift_stereo

int main(int argc, char** argv) {
  return cortshift_stereo::runTool(argc, argv, cortshift_stereo::kHelp, {"case", "output", "first-pairs"},
                                   cortshift_stereo::run);
}
