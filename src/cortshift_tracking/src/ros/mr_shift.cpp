#include "cortshift_tracking/ros/mr_shift.hpp"

#include <cmath>

#include "cortshift_stereo/admission/verdict.hpp"
#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_tracking/case/bag_access.hpp"
#include "cortshift_tracking/case/stage_key.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/field/composition.hpp"
#include "cortshift_tracking/ros/field_message.hpp"

namespace cortshift_tracking {
namespace {

namespace fs = std::filesystem;

constexpr double kSameStamp = 0.001;  // [s] files of other programs hold rounded stamps

fs::path fieldPath(const StageStore& store, const std::string& key) {
  return store.folder() / "fields" / (std::string(kMrKey) + "__" + key + ".bag");
}

std::string command(const StageStore& store, const std::string& key) {
  return "rosrun cortshift_tracking register_mr '" + store.folder().string() + "' " + key + " MR";
}

/// The last stage up to `to_key` that is registered to the MR.
cortshift_msgs::StageInfo registeredStage(const StageStore& store, const std::string& to_key) {
  const std::vector<cortshift_msgs::StageInfo> stages = store.list();
  for (std::size_t i = store.indexOf(to_key) + 1; i-- > 0;)
    if (i < stages.size() && fs::exists(fieldPath(store, stages[i].key))) return stages[i];
  throw TrackingError("no stage up to '" + to_key + "' is registered to the preoperative MR; run `" +
                      command(store, stages.empty() ? to_key : stages.front().key) +
                      "`, where MR is a NIfTI file or the folder of a DICOM series, and ask again");
}

cortshift_msgs::DisplacementField readRegistration(const StageStore& store, const cortshift_msgs::StageInfo& stage) {
  const fs::path path = fieldPath(store, stage.key);
  const std::string remedy = "; move it away and run `" + command(store, stage.key) + "`";
  cortshift_msgs::DisplacementFieldConstPtr last;
  try {
    last = lastField(path);
  } catch (const TrackingError& error) {
    throw TrackingError(error.what() + remedy);
  }
  if (!last) throw TrackingError(path.string() + " holds no displacement field on /shift/field" + remedy);
  if (last->from_key != kMrKey || last->to_key != stage.key ||
      std::abs((last->to_stamp - stage.stamp).toSec()) > kSameStamp)
    throw TrackingError(path.string() + " holds the field " + last->from_key + " -> " + last->to_key +
                        " of another capture than stage '" + stage.key + "'" + remedy);
  return *last;
}

/// Both surfaces over the field's grid and the flow between them, for the pictures.
void addPictures(ShiftResult& result, const cortshift_stereo::Surface& later, const ProjectionSettings& settings) {
  const DisplacementField& field = result.field;
  const Eigen::Matrix3d R = field.frame.T_pmr_projection.linear().transpose();
  constexpr float kNowhere = -1e6F;
  result.later = project(later, field.frame, settings);
  result.flow = cv::Mat(field.frame.size, CV_32FC2, cv::Scalar::all(kNowhere));
  cv::Mat mask = cv::Mat::zeros(field.frame.size, CV_8UC1);
  for (int row = 0; row < mask.rows; ++row)
    for (int column = 0; column < mask.cols; ++column) {
      const cv::Vec3f& d = field.displacement_pmr.at<cv::Vec3f>(row, column);
      if (std::isnan(d[0])) continue;
      const Eigen::Vector3d local = R * Eigen::Vector3d(d[0], d[1], d[2]) / field.frame.resolution;
      result.flow.at<cv::Vec2f>(row, column) = {static_cast<float>(local.x()), static_cast<float>(local.y())};
      mask.at<uchar>(row, column) = 255;
    }
  // Vessels are bright in the MR and dark in a photograph.
  cv::Mat inverted = ~field.colour;
  inverted.convertTo(result.earlier.colour, CV_32FC3, 1.0 / 255);
  result.earlier.colour.setTo(0, mask == 0);
  result.earlier.mask = mask;
}

}  // namespace

StageShift computeMrShift(const StageStore& store, const std::string& to_key, FirstNormal& first_normal,
                          const std::optional<Eigen::Vector3d>& gravity_pmr, const ShiftSettings& settings,
                          const Drawn& drawn, bool across_epochs) {
  const cortshift_msgs::StageInfo registered = registeredStage(store, to_key);
  const cortshift_msgs::DisplacementField message = readRegistration(store, registered);
  StageShift shift;
  shift.from.key = kMrKey;
  shift.from.stamp = message.from_stamp;
  shift.to = registered;
  ShiftResult& result = shift.result;
  result.field = fieldFromMessage(message);
  double overlap = message.summary.overlap;
  Summary times;
  times.flow_seconds = message.summary.compute_time;
  if (registered.key != to_key) {
    const StageShift onwards =
        computeStageShift(store, registered.key, to_key, first_normal, gravity_pmr, settings, drawn, across_epochs);
    shift.to = onwards.to;
    result.field = composed(result.field, onwards.result.field);
    overlap *= onwards.result.summary.overlap;
    times.projection_seconds = onwards.result.summary.projection_seconds;
    times.flow_seconds += onwards.result.summary.flow_seconds;
    times.inversion_seconds = onwards.result.summary.inversion_seconds;
    times.warnings = onwards.result.summary.warnings;
    times.surround = onwards.result.summary.surround;
    times.correction = onwards.result.summary.correction;
  }
  result.summary = summarise(result.field, overlap, first_normal.of(store), gravity_pmr);
  result.summary.warnings = message.summary.warnings;
  cortshift_stereo::addWarnings(result.summary.warnings,
                                registered.key == to_key ? warningsOf({}, registered) : times.warnings);
  result.summary.configuration = settings.configuration;
  result.summary.surround = times.surround;
  result.summary.correction = times.correction;
  result.summary.projection_seconds = times.projection_seconds;
  result.summary.flow_seconds = times.flow_seconds;
  result.summary.inversion_seconds = times.inversion_seconds;
  if (result.summary.valid_points == 0)
    throw TrackingError("stage '" + registered.key + "' is registered to the MR, but no displacement on to '" + to_key +
                        "' can be trusted; register '" + to_key + "' itself: `" + command(store, to_key) + "`");
  addPictures(result, cortshift_stereo::surfaceFromPointCloud2(*store.load(to_key).surface), settings.projection);
  return shift;
}

}  // namespace cortshift_tracking
