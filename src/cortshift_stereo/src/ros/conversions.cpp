#include "cortshift_stereo/ros/conversions.hpp"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>

#include "cortshift_stereo/geometry/lens.hpp"
#include "cortshift_stereo/images/image_file.hpp"
#include "cortshift_stereo/ros/image_layout.hpp"

namespace cortshift_stereo {
namespace {

using sensor_msgs::PointField;

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

PointField field(const std::string& name, uint32_t offset) {
  PointField out;
  out.name = name;
  out.offset = offset;
  out.datatype = PointField::FLOAT32;
  out.count = 1;
  return out;
}

const PointField* findField(const sensor_msgs::PointCloud2& cloud, const std::string& name) {
  for (const PointField& f : cloud.fields)
    if (f.name == name) return &f;
  return nullptr;
}

uint32_t bytesOf(const PointField& f) {
  switch (f.datatype) {
    case PointField::FLOAT32:
    case PointField::UINT32:
    case PointField::INT32:
      return 4;
    case PointField::FLOAT64:
      return 8;
    default:
      return 0;
  }
}

void checkInside(const sensor_msgs::PointCloud2& cloud, const PointField& f) {
  if (bytesOf(f) == 0 || uint64_t{f.offset} + bytesOf(f) > cloud.point_step)
    throw MessageError("PointCloud2: field " + f.name + " (type " + std::to_string(f.datatype) + " at offset " +
                       std::to_string(f.offset) + ") does not fit a point of " + std::to_string(cloud.point_step) +
                       " bytes; send float32");
}

const PointField& numberField(const sensor_msgs::PointCloud2& cloud, const std::string& name) {
  const PointField* f = findField(cloud, name);
  if (!f) throw MessageError("PointCloud2: field " + name + " is missing; a surface needs x y z rgb");
  checkInside(cloud, *f);
  if (f->datatype != PointField::FLOAT32 && f->datatype != PointField::FLOAT64)
    throw MessageError("PointCloud2: field " + name + " is not a float; send float32");
  return *f;
}

const PointField& colourField(const sensor_msgs::PointCloud2& cloud) {
  for (const char* name : {"rgb", "rgba"})
    if (const PointField* f = findField(cloud, name)) {
      checkInside(cloud, *f);
      if (bytesOf(*f) != 4)
        throw MessageError("PointCloud2: field " + f->name + " must be 4 bytes, packed as 0x00rrggbb");
      return *f;
    }
  throw MessageError(
      "PointCloud2: field rgb is missing; the shift is computed from the texture, send a coloured cloud");
}

void checkLayout(const sensor_msgs::PointCloud2& cloud) {
  const std::string size = std::to_string(cloud.width) + "x" + std::to_string(cloud.height);
  if (cloud.is_bigendian) throw MessageError("PointCloud2: big-endian data are not supported; send little-endian");
  if (cloud.width < 2 || cloud.height < 2)
    throw MessageError("PointCloud2: " + size +
                       " is not an organised cloud; send it as the rectified left image, "
                       "NaN where there is no point");
  if (cloud.row_step < uint64_t{cloud.width} * cloud.point_step ||
      cloud.data.size() < uint64_t{cloud.row_step} * cloud.height)
    throw MessageError("PointCloud2: " + std::to_string(cloud.data.size()) + " bytes of data are too few for " + size +
                       " points of " + std::to_string(cloud.point_step) + " bytes");
}

/// Where a cloud has what a surface needs.
struct SurfaceFields {
  const PointField &x, &y, &z, &rgb;
  const PointField* confidence;  ///< null: there is none
};

/// @throws MessageError
SurfaceFields fieldsOf(const sensor_msgs::PointCloud2& cloud) {
  checkLayout(cloud);
  return {numberField(cloud, "x"), numberField(cloud, "y"), numberField(cloud, "z"), colourField(cloud),
          findField(cloud, "confidence") ? &numberField(cloud, "confidence") : nullptr};
}

float readNumber(const uint8_t* point, const PointField& f) {
  if (f.datatype == PointField::FLOAT64) {
    double value;
    std::memcpy(&value, point + f.offset, sizeof value);
    return static_cast<float>(value);
  }
  float value;
  std::memcpy(&value, point + f.offset, sizeof value);
  return value;
}

CameraModel checkedCamera(const sensor_msgs::CameraInfo& info, const std::string& side) {
  try {
    return cameraModelFromInfo(info);
  } catch (const CalibrationError& error) {
    throw CalibrationError(side + " " + error.what());
  }
}

template <int rows, int cols, typename Array>
cv::Matx<double, rows, cols> matrix(const Array& values) {
  cv::Matx<double, rows, cols> out;
  std::copy(values.begin(), values.end(), out.val);
  return out;
}

cv::Mat bgrFromCvImage(const cv_bridge::CvImage& image) {
  const bool deep = sensor_msgs::image_encodings::bitDepth(image.encoding) == 16;
  cv::Mat bgr = cv_bridge::cvtColor(boost::make_shared<cv_bridge::CvImage>(image), deep ? "bgr16" : "bgr8")->image;
  if (bgr.empty()) throw MessageError("image: it is empty");
  return bgr;
}

Eigen::Isometry3d checkedIsometry(const Eigen::Vector3d& translation, const Eigen::Quaterniond& rotation) {
  constexpr double kNormTolerance = 1e-3;
  if (!translation.allFinite() || !rotation.coeffs().allFinite() || !(std::abs(rotation.norm() - 1) < kNormTolerance))
    throw MessageError("pose: not a finite rigid transform (quaternion of length " + std::to_string(rotation.norm()) +
                       "); check its publisher");
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = rotation.normalized().toRotationMatrix();
  T.translation() = translation;
  return T;
}

void requireRigid(const Eigen::Isometry3d& T) {
  constexpr double kTolerance = 1e-6;
  const Eigen::Matrix3d R = T.linear();
  if (!T.matrix().allFinite() || !((R * R.transpose() - Eigen::Matrix3d::Identity()).norm() < kTolerance) ||
      !(R.determinant() > 0))
    throw MessageError("pose: not a finite rigid transform, it is not sent");
}

}  // namespace

sensor_msgs::PointCloud2 toPointCloud2(const Surface& surface, const std_msgs::Header& header) {
  CV_Assert(surface.points.type() == CV_32FC3 && surface.colour.type() == CV_8UC3 &&
            surface.confidence.type() == CV_32FC1);
  CV_Assert(surface.colour.size() == surface.size() && surface.confidence.size() == surface.size());
  sensor_msgs::PointCloud2 cloud;
  cloud.header = header;
  cloud.width = static_cast<uint32_t>(surface.points.cols);
  cloud.height = static_cast<uint32_t>(surface.points.rows);
  cloud.fields = {field("x", 0), field("y", 4), field("z", 8), field("rgb", 12), field("confidence", 16)};
  cloud.point_step = 20;
  cloud.row_step = cloud.width * cloud.point_step;
  cloud.is_bigendian = false;
  cloud.is_dense = false;
  cloud.data.resize(std::size_t{cloud.row_step} * cloud.height);
  uint8_t* out = cloud.data.data();
  for (int y = 0; y < surface.points.rows; ++y) {
    const auto* point = surface.points.ptr<cv::Vec3f>(y);
    const auto* colour = surface.colour.ptr<cv::Vec3b>(y);
    const float* confidence = surface.confidence.ptr<float>(y);
    for (int x = 0; x < surface.points.cols; ++x, out += cloud.point_step) {
      const uint32_t rgb = uint32_t{colour[x][2]} << 16 | uint32_t{colour[x][1]} << 8 | uint32_t{colour[x][0]};
      std::memcpy(out, point[x].val, 12);
      std::memcpy(out + 12, &rgb, 4);
      std::memcpy(out + 16, confidence + x, 4);
    }
  }
  return cloud;
}

void requireSurface(const sensor_msgs::PointCloud2& cloud) { static_cast<void>(fieldsOf(cloud)); }

Surface surfaceFromPointCloud2(const sensor_msgs::PointCloud2& cloud) {
  const auto [fx, fy, fz, frgb, fconfidence] = fieldsOf(cloud);

  const cv::Size size(static_cast<int>(cloud.width), static_cast<int>(cloud.height));
  Surface surface{cv::Mat(size, CV_32FC3), cv::Mat(size, CV_8UC3), cv::Mat(size, CV_32FC1)};
  for (int y = 0; y < size.height; ++y) {
    const uint8_t* in = cloud.data.data() + std::size_t{cloud.row_step} * static_cast<std::size_t>(y);
    auto* point = surface.points.ptr<cv::Vec3f>(y);
    auto* colour = surface.colour.ptr<cv::Vec3b>(y);
    float* confidence = surface.confidence.ptr<float>(y);
    for (int x = 0; x < size.width; ++x, in += cloud.point_step) {
      const cv::Vec3f p(readNumber(in, fx), readNumber(in, fy), readNumber(in, fz));
      const bool valid = std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]);
      uint32_t rgb;
      std::memcpy(&rgb, in + frgb.offset, 4);
      point[x] = valid ? p : cv::Vec3f::all(kNaN);
      colour[x] = cv::Vec3b(rgb & 0xff, rgb >> 8 & 0xff, rgb >> 16 & 0xff);
      const float c = !valid ? 0.0f : fconfidence ? readNumber(in, *fconfidence) : 1.0f;
      confidence[x] = c > 0 ? std::min(c, 1.0f) : 0.0f;  // a NaN confidence is none
    }
  }
  return surface;
}

CameraModel cameraModelFromInfo(const sensor_msgs::CameraInfo& info) {
  const std::string where = "camera_info: ";
  if (info.K[0] == 0) throw CalibrationError(where + "K is zero, the camera is not calibrated; calibrate it first");
  if (info.binning_x > 1 || info.binning_y > 1)
    throw CalibrationError(where + "binning is not supported; send full-resolution images");
  const auto& roi = info.roi;
  const bool full = (roi.width == 0 || roi.width == info.width) && (roi.height == 0 || roi.height == info.height);
  if (!full || roi.x_offset != 0 || roi.y_offset != 0)
    throw CalibrationError(where + "a region of interest is not supported; send full images");
  CameraModel camera;
  camera.size = cv::Size(static_cast<int>(info.width), static_cast<int>(info.height));
  camera.K = matrix<3, 3>(info.K);
  // Rectified images come without a model where there is nothing to take out.
  const bool none = std::all_of(info.D.begin(), info.D.end(), [](double d) { return d == 0; });
  if (!info.distortion_model.empty() || !none) {
    camera.lens = lensNamed(info.distortion_model, where + "distortion_model");
    camera.D = checkedCoefficients(camera.lens, info.D, where + "D");
  }
  camera.R = matrix<3, 3>(info.R);
  camera.P = matrix<3, 4>(info.P);
  return camera;
}

StereoModel stereoModelFromInfo(const sensor_msgs::CameraInfo& left, const sensor_msgs::CameraInfo& right) {
  const StereoModel model{checkedCamera(left, "left"), checkedCamera(right, "right")};
  model.validate();
  return model;
}

sensor_msgs::CameraInfo toCameraInfo(const CameraModel& camera, const std_msgs::Header& header) {
  sensor_msgs::CameraInfo info;
  info.header = header;
  info.width = static_cast<uint32_t>(camera.size.width);
  info.height = static_cast<uint32_t>(camera.size.height);
  info.distortion_model = nameOf(camera.lens);
  info.D = checkedCoefficients(camera.lens, camera.D, "camera_info: D");
  std::copy_n(camera.K.val, 9, info.K.begin());
  std::copy_n(camera.R.val, 9, info.R.begin());
  std::copy_n(camera.P.val, 12, info.P.begin());
  return info;
}

cv::Mat bgrFromImage(const sensor_msgs::Image& image) {
  const std::string name = "image " + std::to_string(image.width) + "x" + std::to_string(image.height) +
                           " of encoding '" + image.encoding + "'";
  cv_bridge::CvImagePtr pixels;
  cv::Mat bgr;
  try {
    requireWhole(image);
    pixels = cv_bridge::toCvCopy(isSwapped(image) ? withBytesSwapped(image) : image);
    bgr = bgrFromCvImage(*pixels);
  } catch (const std::exception& error) {  // cv_bridge throws its own types and OpenCV's
    throw MessageError(name + " cannot be read (" + error.what() +
                       "); send bgr8, rgb8, mono8, mono16 or a Bayer encoding");
  }
  requireByteOrder(pixels->image, pixels->encoding, name);
  return bgr;
}

cv::Mat bgrFromImage(const sensor_msgs::CompressedImage& image) {
  const std::string name = "compressed image of format '" + image.format + "'";
  cv_bridge::CvImage decoded;
  cv::Mat bgr;
  try {
    decoded.image = decodeImage(image.data, "its data");
    // The recorder's format reads "ENCODING; png compressed ..."; a Bayer pattern is stored as a grey image.
    const std::string recorded = image.format.substr(0, image.format.find(';'));
    const std::string depth = decoded.image.depth() == CV_16U ? "16" : "8";
    switch (decoded.image.channels()) {
      case 1:
        decoded.encoding = sensor_msgs::image_encodings::isBayer(recorded) ? recorded : "mono" + depth;
        break;
      case 3:
        decoded.encoding = "bgr" + depth;
        break;
      default:
        decoded.encoding = "bgra" + depth;
    }
    bgr = bgrFromCvImage(decoded);
  } catch (const std::exception& error) {
    throw MessageError(name + ", " + std::to_string(image.data.size()) + " bytes, cannot be decoded (" + error.what() +
                       "); send png or jpeg");
  }
  requireByteOrder(decoded.image, decoded.encoding, name);
  return bgr;
}

stereo_msgs::DisparityImage toDisparityImage(const cv::Mat& disparity, const StereoModel& model,
                                             const cv::Range& search_range, const std_msgs::Header& header) {
  CV_Assert(disparity.type() == CV_32FC1);
  const double offset = model.left.P(0, 2) - model.right.P(0, 2);
  stereo_msgs::DisparityImage out;
  out.header = header;
  cv_bridge::CvImage(header, "32FC1", disparity - offset).toImageMsg(out.image);
  out.f = static_cast<float>(model.left.P(0, 0));
  out.T = static_cast<float>(model.baseline());
  out.valid_window.width = static_cast<uint32_t>(disparity.cols);
  out.valid_window.height = static_cast<uint32_t>(disparity.rows);
  out.min_disparity = static_cast<float>(search_range.start - offset);
  out.max_disparity = static_cast<float>(search_range.end - offset);
  out.delta_d = 1.0f / 32;  // what the sub-pixel refinement resolves on clean images
  return out;
}

Eigen::Isometry3d isometryFromMessage(const geometry_msgs::Pose& pose) {
  const auto& q = pose.orientation;
  return checkedIsometry({pose.position.x, pose.position.y, pose.position.z}, {q.w, q.x, q.y, q.z});
}

Eigen::Isometry3d isometryFromMessage(const geometry_msgs::Transform& transform) {
  const auto& t = transform.translation;
  const auto& q = transform.rotation;
  return checkedIsometry({t.x, t.y, t.z}, {q.w, q.x, q.y, q.z});
}

geometry_msgs::Pose toPose(const Eigen::Isometry3d& T) {
  requireRigid(T);
  const Eigen::Quaterniond q(T.linear());
  geometry_msgs::Pose pose;
  pose.position.x = T.translation().x();
  pose.position.y = T.translation().y();
  pose.position.z = T.translation().z();
  pose.orientation.x = q.x();
  pose.orientation.y = q.y();
  pose.orientation.z = q.z();
  pose.orientation.w = q.w();
  return pose;
}

geometry_msgs::Transform toTransform(const Eigen::Isometry3d& T) {
  const geometry_msgs::Pose pose = toPose(T);
  geometry_msgs::Transform transform;
  transform.translation.x = pose.position.x;
  transform.translation.y = pose.position.y;
  transform.translation.z = pose.position.z;
  transform.rotation = pose.orientation;
  return transform;
}

}  // namespace cortshift_stereo
