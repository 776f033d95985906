#include "cortshift_tracking/offline/recomputation.hpp"

#include <algorithm>
#include <boost/make_shared.hpp>
#include <regex>

#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_tracking/case/bag_access.hpp"
#include "cortshift_tracking/case/case_state.hpp"
#include "cortshift_tracking/case/stage_key.hpp"
#include "cortshift_tracking/case/stage_record.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/field/summary.hpp"
#include "cortshift_tracking/offline/case_capture.hpp"

namespace cortshift_tracking {

namespace fs = std::filesystem;

CaseFiles findCase(const fs::path& folder) {
  const std::string key = kKeyPattern;
  const std::regex stage("[0-9]{4,9}_" + key + "_[0-9a-f]{8}\\.bag"), field(key + "__" + key + "\\.bag");
  if (!fs::is_directory(folder)) throw TrackingError(folder.string() + ": no such folder; give the folder of a case");
  CaseFiles found;
  for (const fs::path& place : {folder, folder / "stages"}) {
    std::error_code error;
    for (const fs::directory_entry& entry : fs::directory_iterator(place, error)) {
      const std::string name = entry.path().filename().string();
      if (std::regex_match(name, stage))
        found.stages.push_back(entry.path());
      else if (std::regex_match(name, field))
        found.fields.push_back(entry.path());
    }
  }
  if (found.stages.empty())
    throw TrackingError(folder.string() + ": holds no stage; give the folder that process_bag or shift_tracker made");
  const auto by_name = [](const fs::path& a, const fs::path& b) { return a.filename() < b.filename(); };
  std::sort(found.stages.begin(), found.stages.end(), by_name);
  std::sort(found.fields.begin(), found.fields.end(), by_name);
  return found;
}

std::optional<fs::path> caseStateFile(const CaseFiles& files) {
  const fs::path path = files.stages.front().parent_path() / kCaseStateFile;
  return fs::exists(path) ? std::make_optional(path) : std::nullopt;
}

cortshift_msgs::DisplacementField fieldFromBag(const fs::path& path) {
  if (const auto last = lastField(path)) return *last;
  throw TrackingError(path.string() + " holds no cortshift_msgs/DisplacementField on /shift/field");
}

std::string changedProvenance(const cortshift_msgs::Provenance& before, const cortshift_msgs::Provenance& after) {
  std::string changed;
  const auto compare = [&](const char* what, const std::string& was, const std::string& is) {
    if (was == is) return;
    constexpr std::size_t kShort = 12;  // digits that tell two hashes apart
    const auto shown = [&](const std::string& text) {
      if (text.empty()) return std::string("not known");
      return text.size() == 64 ? text.substr(0, kShort) : text;
    };
    changed += (changed.empty() ? "" : "; ") + std::string(what) + " was " + shown(was) + ", now " + shown(is);
  };
  compare("software", before.software, after.software);
  compare("configuration", before.configuration, after.configuration);
  compare("calibration", before.calibration, after.calibration);
  return changed;
}

StageRecord remakeStage(const StageRecord& stored, const std::string& parameters,
                        cortshift_stereo::PairReconstruction& reconstruct) {
  const cortshift_stereo::PairMessages pair = pairOf(stored);
  if (!(stored.left || stored.left_compressed) || !(stored.right || stored.right_compressed))
    throw TrackingError("it keeps no raw pair; capture it again from the recording");
  cortshift_stereo::TransformTree tree(1.0, 1.0);  // one instant: nothing is interpolated
  addTransforms(tree, stored.tf_static, true);
  addTransforms(tree, stored.tf, false);
  const auto pose_at = [&](const std::string& target, const std::string& source, const ros::Time& stamp) {
    return poseFrom(tree, target, source, stamp);
  };
  StageRecord record = stored;
  const cortshift_stereo::PairSurface surface = reconstruct(pair, pose_at);
  record.surface =
      boost::make_shared<sensor_msgs::PointCloud2>(toPointCloud2(surface.surface_map, stored.surface->header));
  record.parameters = parameters;
  cortshift_stereo::addWarnings(record.info.warnings, surface.warnings);
  completeStage(record, pose_at, 0);  // one instant says nothing of motion: what was stored stays
  return record;
}

Change changeOf(const cv::Mat& before, const cv::Mat& after) {
  CV_Assert(before.type() == CV_32FC3 && after.type() == CV_32FC3 && before.size() == after.size());
  Change change;
  std::vector<double> lengths;
  for (int row = 0; row < before.rows; ++row)
    for (int column = 0; column < before.cols; ++column) {
      const cv::Vec3f &a = before.at<cv::Vec3f>(row, column), &b = after.at<cv::Vec3f>(row, column);
      const bool had = a[0] == a[0], has = b[0] == b[0];
      change.before += had;
      change.after += has;
      if (had && has) lengths.push_back(cv::norm(b - a));
    }
  change.both = lengths.size();
  change.median = change.largest = kUnknown;
  if (lengths.empty()) return change;
  const auto middle = lengths.begin() + static_cast<std::ptrdiff_t>(lengths.size() / 2);
  std::nth_element(lengths.begin(), middle, lengths.end());
  change.median = *middle;
  change.largest = *std::max_element(lengths.begin(), lengths.end());
  return change;
}

}  // namespace cortshift_tracking
