#include "cortshift_tracking/ros/field_message.hpp"

#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "cortshift_stereo/provenance.hpp"
#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_tracking/case/calibration_identity.hpp"
#include "cortshift_tracking/surround/outline.hpp"

namespace cortshift_tracking {
namespace {

// The contract's fields, and those that follow on request.
constexpr std::array<const char*, 8> kFields = {"x", "y", "z", "dx", "dy", "dz", "rgb", "confidence"};
constexpr const char* kUncertainty = "uncertainty";
constexpr std::array<const char*, 2> kStrainFields = {"strain_major", "strain_minor"};
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

using cortshift_stereo::MessageError;

void addField(sensor_msgs::PointCloud2& cloud, const char* name) {
  sensor_msgs::PointField entry;
  entry.name = name;
  entry.offset = cloud.point_step;
  entry.datatype = sensor_msgs::PointField::FLOAT32;
  entry.count = 1;
  cloud.fields.push_back(entry);
  cloud.point_step += sizeof(float);
}

/// Where the fields stand in a point. @throws MessageError for the first one that is not there
uint32_t offsetOf(const sensor_msgs::PointCloud2& cloud, const char* name) {
  for (const auto& entry : cloud.fields)
    if (entry.name == name && entry.datatype == sensor_msgs::PointField::FLOAT32 &&
        entry.offset + sizeof(float) <= cloud.point_step)
      return entry.offset;
  throw MessageError(std::string("displacement field: points lack a float32 field '") + name + "'");
}

bool hasField(const sensor_msgs::PointCloud2& cloud, const char* name) {
  for (const auto& entry : cloud.fields)
    if (entry.name == name) return true;
  return false;
}

/// The outlines of a mask and of the large holes in it, corners in the frame [m]; to half a grid point, which is less
/// than anyone draws.
std::vector<geometry_msgs::Polygon> polygonsOf(const cv::Mat& mask, double resolution) {
  std::vector<geometry_msgs::Polygon> polygons;
  if (mask.empty()) return polygons;
  std::vector<std::vector<cv::Point>> contours;
  std::vector<cv::Vec4i> family;  // next, previous, child, parent
  cv::Mat filled = mask.clone();
  cv::findContours(mask, contours, family, cv::RETR_CCOMP, cv::CHAIN_APPROX_NONE);
  for (std::size_t i = 0; i < contours.size(); ++i)
    if (family[i][3] >= 0 && cv::contourArea(contours[i]) * resolution * resolution < kSmallHole)
      cv::drawContours(filled, contours, static_cast<int>(i), 255, cv::FILLED);  // with what lies in it
  cv::findContours(filled, contours, cv::RETR_CCOMP, cv::CHAIN_APPROX_NONE);
  for (const std::vector<cv::Point>& contour : contours) {
    std::vector<cv::Point> corners;
    cv::approxPolyDP(contour, corners, 0.5, true);
    if (corners.size() < 3) continue;
    geometry_msgs::Polygon polygon;
    for (const cv::Point& corner : corners) {
      geometry_msgs::Point32 point;
      point.x = static_cast<float>(corner.x * resolution);
      point.y = static_cast<float>(corner.y * resolution);
      polygon.points.push_back(point);
    }
    polygons.push_back(polygon);
  }
  return polygons;
}

/// The correction as a pose with covariance; identity and NaN where there was none.
geometry_msgs::PoseWithCovariance correctionMessage(const std::optional<Correction>& correction) {
  geometry_msgs::PoseWithCovariance message;
  message.pose = cortshift_stereo::toPose(correction ? correction->transform_pmr : Eigen::Isometry3d::Identity());
  for (int row = 0; row < 6; ++row)
    for (int column = 0; column < 6; ++column)
      message.covariance[static_cast<std::size_t>(6 * row + column)] =
          correction ? correction->covariance(row, column) : kUnknown;
  return message;
}

std::optional<Correction> correctionFromMessage(const geometry_msgs::PoseWithCovariance& message) {
  if (!(message.covariance[0] > 0)) return std::nullopt;  // NaN, or what nobody filled in
  Correction correction{cortshift_stereo::isometryFromMessage(message.pose), {}};
  for (int row = 0; row < 6; ++row)
    for (int column = 0; column < 6; ++column)
      correction.covariance(row, column) = message.covariance[static_cast<std::size_t>(6 * row + column)];
  return correction;
}

}  // namespace

Region regionFromMessage(const geometry_msgs::Polygon& polygon) {
  Region region;
  for (const geometry_msgs::Point32& corner : polygon.points) region.emplace_back(corner.x, corner.y);
  return region;
}

cortshift_msgs::ShiftSummary toMessage(const Summary& summary, const std::string& from_key, const std::string& to_key) {
  cortshift_msgs::ShiftSummary message;
  message.from_key = from_key;
  message.to_key = to_key;
  message.valid_points = static_cast<uint32_t>(summary.valid_points);
  message.overlap = summary.overlap;
  message.magnitude_mean = summary.magnitude.mean;
  message.magnitude_sd = summary.magnitude.sd;
  message.gravity_mean = summary.gravity.mean;
  message.gravity_sd = summary.gravity.sd;
  message.normal_mean = summary.normal.mean;
  message.normal_sd = summary.normal.sd;
  message.lateral_mean = summary.lateral.mean;
  message.lateral_sd = summary.lateral.sd;
  message.gravity_normal_angle = summary.gravity_normal_angle;
  message.compute_time = summary.compute_seconds();
  message.latency = kUnknown;
  message.warnings = summary.warnings;
  message.common_sd = summary.common_sd;
  message.brain_points = static_cast<uint32_t>(summary.brain.points);
  message.brain_magnitude_mean = summary.brain.magnitude.mean;
  message.brain_magnitude_sd = summary.brain.magnitude.sd;
  message.brain_gravity_mean = summary.brain.gravity.mean;
  message.brain_gravity_sd = summary.brain.gravity.sd;
  message.brain_normal_mean = summary.brain.normal.mean;
  message.brain_normal_sd = summary.brain.normal.sd;
  message.brain_lateral_mean = summary.brain.lateral.mean;
  message.brain_lateral_sd = summary.brain.lateral.sd;
  message.outline = summary.outline;
  message.surround_correction = correctionMessage(summary.correction);
  message.surround = summary.surround;
  for (const ErrorShare& share : summary.budget) {
    cortshift_msgs::ErrorSource source;
    source.source = share.source;
    source.known_from = share.known_from;
    source.sd = share.sd;
    message.budget.push_back(source);
  }
  return message;
}

Summary summaryFromMessage(const cortshift_msgs::ShiftSummary& message) {
  Summary summary;
  summary.valid_points = message.valid_points;
  summary.overlap = message.overlap;
  summary.magnitude = {message.magnitude_mean, message.magnitude_sd};
  summary.gravity = {message.gravity_mean, message.gravity_sd};
  summary.normal = {message.normal_mean, message.normal_sd};
  summary.lateral = {message.lateral_mean, message.lateral_sd};
  summary.gravity_normal_angle = message.gravity_normal_angle;
  summary.warnings = message.warnings;
  summary.common_sd = message.common_sd;
  summary.brain = {message.brain_points,
                   {message.brain_magnitude_mean, message.brain_magnitude_sd},
                   {message.brain_gravity_mean, message.brain_gravity_sd},
                   {message.brain_normal_mean, message.brain_normal_sd},
                   {message.brain_lateral_mean, message.brain_lateral_sd}};
  summary.outline = message.outline;
  summary.correction = correctionFromMessage(message.surround_correction);
  summary.surround = message.surround;
  for (const cortshift_msgs::ErrorSource& source : message.budget)
    summary.budget.push_back({source.source, source.known_from, source.sd});
  return summary;
}

cortshift_msgs::DisplacementField toMessage(const DisplacementField& field, const Summary& summary,
                                            const cortshift_msgs::StageInfo& from,
                                            const cortshift_msgs::StageInfo& to) {
  cortshift_msgs::DisplacementField message;
  message.header.frame_id = "pmr";
  message.header.stamp = to.stamp;
  message.from_key = from.key;
  message.to_key = to.key;
  message.from_stamp = from.stamp;
  message.to_stamp = to.stamp;
  message.projection = cortshift_stereo::toPose(field.frame.T_pmr_projection);
  message.resolution = field.frame.resolution;
  message.summary = toMessage(summary, from.key, to.key);
  message.provenance.software = cortshift_stereo::softwareVersion();
  message.provenance.configuration = summary.configuration;
  message.provenance.calibration = calibrationOf(from, to);

  message.brain = polygonsOf(field.brain, field.frame.resolution);

  sensor_msgs::PointCloud2& cloud = message.points;
  cloud.header = message.header;
  cloud.width = static_cast<uint32_t>(field.frame.size.width);
  cloud.height = static_cast<uint32_t>(field.frame.size.height);
  const bool with_strain = !field.strain_major.empty();
  for (const char* name : kFields) addField(cloud, name);
  addField(cloud, kUncertainty);
  if (with_strain)
    for (const char* name : kStrainFields) addField(cloud, name);
  cloud.row_step = cloud.point_step * cloud.width;
  cloud.is_dense = false;
  cloud.data.resize(std::size_t{cloud.row_step} * cloud.height);
  uint8_t* out = cloud.data.data();
  for (int row = 0; row < field.frame.size.height; ++row)
    for (int column = 0; column < field.frame.size.width; ++column, out += cloud.point_step) {
      std::array<float, kFields.size()> values;
      values.fill(kNaN);
      const cv::Vec3f& d = field.displacement_pmr.at<cv::Vec3f>(row, column);
      if (!std::isnan(d[0])) {
        const cv::Vec3f& p = field.start_pmr.at<cv::Vec3f>(row, column);
        const cv::Vec3b& c = field.colour.at<cv::Vec3b>(row, column);
        const uint32_t rgb = uint32_t{c[2]} << 16 | uint32_t{c[1]} << 8 | uint32_t{c[0]};
        float packed;
        std::memcpy(&packed, &rgb, sizeof packed);
        values = {p[0], p[1], p[2], d[0], d[1], d[2], packed, field.confidence.at<float>(row, column)};
      }
      std::memcpy(out, values.data(), sizeof values);
      const float uncertainty =
          field.uncertainty.empty() || std::isnan(d[0]) ? kNaN : field.uncertainty.at<float>(row, column);
      std::memcpy(out + sizeof values, &uncertainty, sizeof uncertainty);
      if (!with_strain) continue;
      const std::array<float, 2> strains = {field.strain_major.at<float>(row, column),
                                            field.strain_minor.at<float>(row, column)};
      std::memcpy(out + sizeof values + sizeof uncertainty, strains.data(), sizeof strains);
    }
  return message;
}

sensor_msgs::PointCloud2 ownPointsMessage(const ShiftResult& result, const std_msgs::Header& header) {
  const cv::Mat &starts = result.own_points_pmr, &displacements = result.own_displacements_pmr;
  sensor_msgs::PointCloud2 cloud;
  cloud.header = header;
  cloud.width = static_cast<uint32_t>(displacements.cols);
  cloud.height = static_cast<uint32_t>(displacements.rows);
  for (const char* name : {"x", "y", "z", "dx", "dy", "dz"}) addField(cloud, name);
  cloud.row_step = cloud.point_step * cloud.width;
  cloud.is_dense = false;
  cloud.data.resize(std::size_t{cloud.row_step} * cloud.height);
  uint8_t* out = cloud.data.data();
  for (int row = 0; row < displacements.rows; ++row)
    for (int column = 0; column < displacements.cols; ++column, out += cloud.point_step) {
      const cv::Vec3f& d = displacements.at<cv::Vec3f>(row, column);
      cv::Vec6f values = cv::Vec6f::all(kNaN);
      if (!std::isnan(d[0])) {
        const cv::Vec3f& p = starts.at<cv::Vec3f>(row, column);
        values = {p[0], p[1], p[2], d[0], d[1], d[2]};
      }
      std::memcpy(out, values.val, sizeof values.val);
    }
  return cloud;
}

DisplacementField fieldFromMessage(const cortshift_msgs::DisplacementField& message) {
  const sensor_msgs::PointCloud2& cloud = message.points;
  std::array<uint32_t, kFields.size()> offsets{};
  for (std::size_t i = 0; i < kFields.size(); ++i) offsets[i] = offsetOf(cloud, kFields[i]);
  // Not every writer knows it: fields of a registered MR say nothing about it.
  const std::optional<uint32_t> uncertainty =
      hasField(cloud, kUncertainty) ? std::make_optional(offsetOf(cloud, kUncertainty)) : std::nullopt;
  if (cloud.is_bigendian || cloud.width == 0 || cloud.height == 0 ||
      cloud.row_step < uint64_t{cloud.width} * cloud.point_step ||
      cloud.data.size() < uint64_t{cloud.row_step} * cloud.height || !(message.resolution > 0))
    throw MessageError("displacement field: the size of its points does not fit its data");

  DisplacementField field;
  field.frame.T_pmr_projection = cortshift_stereo::isometryFromMessage(message.projection);
  field.frame.resolution = message.resolution;
  field.frame.size = cv::Size(static_cast<int>(cloud.width), static_cast<int>(cloud.height));
  field.start_pmr = cv::Mat(field.frame.size, CV_32FC3, cv::Scalar::all(kNaN));
  field.displacement_pmr = field.start_pmr.clone();
  field.colour = cv::Mat::zeros(field.frame.size, CV_8UC3);
  field.confidence = cv::Mat::zeros(field.frame.size, CV_32FC1);
  if (uncertainty) field.uncertainty = cv::Mat(field.frame.size, CV_32FC1, cv::Scalar(kNaN));
  std::vector<Region> brain;
  for (const geometry_msgs::Polygon& polygon : message.brain) brain.push_back(regionFromMessage(polygon));
  if (!brain.empty()) field.brain = outlinedMask(field.frame, brain);
  for (int row = 0; row < field.frame.size.height; ++row)
    for (int column = 0; column < field.frame.size.width; ++column) {
      const uint8_t* in = cloud.data.data() + std::size_t{cloud.row_step} * static_cast<std::size_t>(row) +
                          std::size_t{cloud.point_step} * static_cast<std::size_t>(column);
      std::array<float, kFields.size()> v;
      for (std::size_t i = 0; i < v.size(); ++i) std::memcpy(&v[i], in + offsets[i], sizeof(float));
      if (std::isnan(v[0]) || std::isnan(v[3])) continue;
      field.start_pmr.at<cv::Vec3f>(row, column) = cv::Vec3f(v[0], v[1], v[2]);
      field.displacement_pmr.at<cv::Vec3f>(row, column) = cv::Vec3f(v[3], v[4], v[5]);
      uint32_t rgb;
      std::memcpy(&rgb, &v[6], sizeof rgb);
      field.colour.at<cv::Vec3b>(row, column) =
          cv::Vec3b(static_cast<uchar>(rgb), static_cast<uchar>(rgb >> 8), static_cast<uchar>(rgb >> 16));
      field.confidence.at<float>(row, column) = v[7];
      if (uncertainty) std::memcpy(&field.uncertainty.at<float>(row, column), in + *uncertainty, sizeof(float));
    }
  return field;
}

}  // namespace cortshift_tracking
