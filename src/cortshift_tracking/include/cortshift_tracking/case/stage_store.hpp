// The keyed history of a case on disk: one folder, one ordinary ROS 1 bag for each stage.
#pragma once

#include <cortshift_msgs/MicroscopeSettings.h>
#include <cortshift_msgs/StageInfo.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2_msgs/TFMessage.h>

#include <filesystem>
#include <mutex>
#include <string>
#include <vector>

namespace cortshift_tracking {

/// What one stage's bag holds. Null pointers and empty messages: not known at capture, and absent from the bag.
struct StageRecord {
  cortshift_msgs::StageInfo info;            ///< /stage/info
  sensor_msgs::PointCloud2ConstPtr surface;  ///< /surface/points; never null
  sensor_msgs::ImageConstPtr left, right;    ///< /stereo/{left,right}/image_raw, as they came in
  sensor_msgs::CompressedImageConstPtr left_compressed, right_compressed;  ///< .../image_raw/compressed
  sensor_msgs::CameraInfoConstPtr left_info, right_info;                   ///< /stereo/{left,right}/camera_info
  cortshift_msgs::MicroscopeSettingsConstPtr settings;                     ///< /microscope/settings
  tf2_msgs::TFMessage tf, tf_static;                                       ///< the transforms at the stamp
  std::string parameters;  ///< /stage/parameters: all that were in force, one "key: value" on a line
};

/// Stages in order of capture. Thread-safe.
///
/// A stage is NNNN_KEY_CRC.bag: number in the case, key, CRC-32 of the whole file. Bags that are named so or nearly so
/// (4 to 9 digits and _), were read and are damaged or none, are moved to `set_aside/` (where the folder may be
/// written); deleted stages go to `deleted/`. A file that cannot be read just now stays where it is, keeps its key and
/// place, and is read again when its stage is asked for. Nothing is ever overwritten; other files, bags too, stay.
class StageStore {
 public:
  /// Opens or creates the folder and checks every stage in it.
  /// @throws TrackingError if the folder cannot be had or another process holds it
  explicit StageStore(const std::filesystem::path& folder);
  ~StageStore();
  StageStore(const StageStore&) = delete;
  StageStore& operator=(const StageStore&) = delete;

  /// Of a stage that cannot be read: its key, a note that says why, and nothing else.
  std::vector<cortshift_msgs::StageInfo> list() const;

  /// @throws TrackingError naming the key and what keys there are
  cortshift_msgs::StageInfo infoOf(const std::string& key) const;

  /// Place of a stage in the order of capture. @throws TrackingError naming the key and what keys there are
  std::size_t indexOf(const std::string& key) const;

  /// @throws TrackingError if a stage of that key exists (naming when it was captured), or none may have it
  void requireFree(const std::string& key) const;

  /// Returns after the stage is safe on disk, with its epoch. @throws TrackingError; then nothing has changed
  cortshift_msgs::StageInfo add(StageRecord record);

  /// @throws TrackingError for an unknown key or a file that is no longer whole
  StageRecord load(const std::string& key) const;

  /// @throws TrackingError
  void remove(const std::string& key);

  /// Reads what could not be read before.
  void retryUnreadable() const;

  const std::filesystem::path& folder() const { return folder_; }

  /// What a person should know of the folder as it was found: that it cannot be written, what was left half written.
  const std::vector<std::string>& warnings() const { return warnings_; }

  /// Files that were not taken for stages, each with the reason and where it is now.
  const std::vector<std::string>& setAside() const { return set_aside_; }

  /// Stages that cannot be read, each with the reason.
  std::vector<std::string> unreadable() const;

 private:
  struct Entry {
    std::filesystem::path path;
    cortshift_msgs::StageInfo info;
    std::string trouble;  // why it cannot be read; empty: it could
  };

  void lockFolder();
  void scan();
  void putAside(const std::filesystem::path& path, const std::string& reason);
  std::size_t indexLocked(const std::string& key) const;

  std::filesystem::path folder_;
  int lock_ = -1;
  mutable std::mutex mutex_;
  mutable std::vector<Entry> entries_;  // what is known of an unreadable stage is completed when it is read
  std::vector<std::string> warnings_, set_aside_;
  unsigned last_number_ = 0;
};

/// The bag of a stage as bytes. @throws TrackingError
std::string toBag(const StageRecord& record);

/// @throws TrackingError if it is not a stage's bag; UnreadableFile if that cannot be told
StageRecord stageFromBag(const std::filesystem::path& path);

}  // namespace cortshift_tracking
