#include "cortshift_stereo/ros/conversions.hpp"

#include <cv_bridge/cv_bridge.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <tuple>

#include "cortshift_stereo/images/bit_depth.hpp"
#include "exif_image.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_stereo_test::withOrientation;

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

std_msgs::Header header() {
  std_msgs::Header h;
  h.frame_id = "pmr";
  h.stamp = ros::Time(12, 34);
  return h;
}

template <typename Call>
void expectMessage(const Call& call, const std::string& text) {
  try {
    call();
    FAIL() << "accepted, where '" << text << "' was expected";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find(text), std::string::npos) << error.what();
  }
}

Surface someSurface() {
  Surface surface{cv::Mat(5, 7, CV_32FC3), cv::Mat(5, 7, CV_8UC3), cv::Mat(5, 7, CV_32FC1)};
  cv::RNG random(7);
  random.fill(surface.points, cv::RNG::UNIFORM, -0.3, 0.3);
  random.fill(surface.colour, cv::RNG::UNIFORM, 0, 256);
  random.fill(surface.confidence, cv::RNG::UNIFORM, 0.01, 1);
  for (const cv::Point p : {cv::Point(0, 0), cv::Point(6, 4), cv::Point(3, 2)}) {
    surface.points.at<cv::Vec3f>(p) = cv::Vec3f::all(kNaN);
    surface.confidence.at<float>(p) = 0;
  }
  surface.colour.at<cv::Vec3b>(1, 1) = cv::Vec3b(255, 255, 255);
  return surface;
}

bool identical(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && a.isContinuous() && b.isContinuous() &&
         std::memcmp(a.data, b.data, a.total() * a.elemSize()) == 0;
}

TEST(Conversions, cloudRoundTripKeepsEveryBitWithNaN) {
  const Surface surface = someSurface();
  const sensor_msgs::PointCloud2 cloud = toPointCloud2(surface, header());
  EXPECT_EQ(cloud.header.frame_id, "pmr");
  EXPECT_EQ(cloud.header.stamp, ros::Time(12, 34));
  EXPECT_EQ(cloud.width, 7u);
  EXPECT_EQ(cloud.height, 5u);
  const Surface back = surfaceFromPointCloud2(cloud);
  EXPECT_TRUE(identical(back.points, surface.points));
  EXPECT_TRUE(identical(back.colour, surface.colour));
  EXPECT_TRUE(identical(back.confidence, surface.confidence));
  EXPECT_TRUE(std::isnan(back.points.at<cv::Vec3f>(2, 3)[0]));
}

TEST(Conversions, packedColourIsNeverAFloatNaN) {
  const sensor_msgs::PointCloud2 cloud = toPointCloud2(someSurface(), header());
  for (std::size_t i = 0; i < cloud.data.size(); i += cloud.point_step) {
    float rgb;
    std::memcpy(&rgb, &cloud.data[i + cloud.fields[3].offset], 4);
    EXPECT_FALSE(std::isnan(rgb));
  }
}

/// A cloud as another program may send it: double coordinates in another order, gaps, padded rows, rgba, no confidence.
TEST(Conversions, foreignLayoutIsRead) {
  sensor_msgs::PointCloud2 cloud;
  cloud.width = 3;
  cloud.height = 2;
  cloud.point_step = 40;
  cloud.row_step = 3 * 40 + 8;
  cloud.data.assign(cloud.row_step * cloud.height, 0xee);
  const auto add = [&](const std::string& name, uint32_t offset, uint8_t type) {
    sensor_msgs::PointField f;
    f.name = name;
    f.offset = offset;
    f.datatype = type;
    f.count = 1;
    cloud.fields.push_back(f);
  };
  add("rgba", 1, sensor_msgs::PointField::UINT32);
  add("z", 8, sensor_msgs::PointField::FLOAT64);
  add("intensity", 5, sensor_msgs::PointField::UINT8);
  add("y", 16, sensor_msgs::PointField::FLOAT64);
  add("x", 28, sensor_msgs::PointField::FLOAT64);
  for (uint32_t v = 0; v < 2; ++v)
    for (uint32_t u = 0; u < 3; ++u) {
      uint8_t* p = &cloud.data[v * cloud.row_step + u * cloud.point_step];
      const double x = u, y = v, z = u == 1 ? kNaN : 0.25;  // only z is NaN: the point is
      const uint32_t rgba = 0xff000000u | (10 * u + v) << 16 | 200 << 8 | 7;
      std::memcpy(p + 28, &x, 8);
      std::memcpy(p + 16, &y, 8);
      std::memcpy(p + 8, &z, 8);
      std::memcpy(p + 1, &rgba, 4);
    }
  const Surface surface = surfaceFromPointCloud2(cloud);
  EXPECT_EQ(surface.points.at<cv::Vec3f>(1, 2), cv::Vec3f(2, 1, 0.25f));
  EXPECT_EQ(surface.colour.at<cv::Vec3b>(1, 2), cv::Vec3b(7, 200, 21));
  EXPECT_EQ(surface.confidence.at<float>(1, 2), 1.0f);
  EXPECT_TRUE(std::isnan(surface.points.at<cv::Vec3f>(0, 1)[0]));
  EXPECT_EQ(surface.confidence.at<float>(0, 1), 0.0f);
}

TEST(Conversions, malformedCloudsAreRefusedByName) {
  const sensor_msgs::PointCloud2 good = toPointCloud2(someSurface(), header());
  sensor_msgs::PointCloud2 bad = good;
  bad.fields.erase(bad.fields.begin() + 3);
  expectMessage([&] { surfaceFromPointCloud2(bad); }, "field rgb is missing");
  bad = good;
  bad.fields.erase(bad.fields.begin());
  expectMessage([&] { surfaceFromPointCloud2(bad); }, "field x is missing");
  bad = good;
  bad.fields[2].datatype = sensor_msgs::PointField::INT16;
  expectMessage([&] { surfaceFromPointCloud2(bad); }, "field z");
  bad = good;
  bad.fields[4].offset = 17;
  expectMessage([&] { surfaceFromPointCloud2(bad); }, "does not fit");
  bad.fields[4].offset = 0xfffffffc;  // with its four bytes it ends at 0, in 32 bits
  expectMessage([&] { surfaceFromPointCloud2(bad); }, "does not fit");
  bad = good;
  bad.data.pop_back();
  expectMessage([&] { surfaceFromPointCloud2(bad); }, "too few");
  bad = good;
  bad.is_bigendian = true;
  expectMessage([&] { surfaceFromPointCloud2(bad); }, "big-endian");
  bad = good;
  bad.width = 35;
  bad.height = 1;
  expectMessage([&] { surfaceFromPointCloud2(bad); }, "not an organised cloud");
}

StereoModel someModel() {
  CameraModel left;
  left.size = cv::Size(1024, 768);
  left.K = cv::Matx33d(3850, 0, 500, 0, 3840, 390, 0, 0, 1);
  left.D = {-0.1, 0.02, 1e-4, -2e-4, 0.3};
  left.P = cv::Matx34d(3800, 0, 450, 0, 0, 3800, 384, 0, 0, 0, 1, 0);
  const double c = std::cos(0.04), s = std::sin(0.04);
  left.R = cv::Matx33d(c, 0, -s, 0, 1, 0, s, 0, c);
  CameraModel right = left;
  right.R = left.R.t();
  right.P(0, 2) = 560;
  right.P(0, 3) = -3800 * 0.025;
  return {left, right};
}

TEST(Conversions, cameraInfoRoundTrip) {
  const StereoModel model = someModel();
  const StereoModel back = stereoModelFromInfo(toCameraInfo(model.left, header()), toCameraInfo(model.right, header()));
  EXPECT_EQ(back.left.size, model.left.size);
  EXPECT_EQ(back.right.D, model.right.D);
  EXPECT_EQ(cv::norm(back.right.P - model.right.P), 0);
  EXPECT_EQ(cv::norm(back.left.K - model.left.K), 0);
  EXPECT_EQ(cv::norm(back.left.R - model.left.R), 0);
  EXPECT_NEAR(back.baseline(), 0.025, 1e-15);
}

TEST(Conversions, everyLensKeepsItsNameAndCoefficients) {
  StereoModel model = someModel();
  for (const auto& [lens, name, D] :
       {std::tuple(LensModel::kRationalPolynomial, "rational_polynomial",
                   std::vector<double>{0.4, -0.2, 1e-4, -2e-4, 0.3, 0.6, 0.1, -0.05}),
        std::tuple(LensModel::kEquidistant, "equidistant", std::vector<double>{0.1, 0.02, -0.01, 0.3})}) {
    model.left.lens = model.right.lens = lens;
    model.left.D = model.right.D = D;
    sensor_msgs::CameraInfo left = toCameraInfo(model.left, header());
    EXPECT_EQ(left.distortion_model, name);
    EXPECT_EQ(left.D, D);
    if (lens == LensModel::kRationalPolynomial) left.D.resize(14, 0.0);  // as OpenCV fills up
    const StereoModel back = stereoModelFromInfo(left, toCameraInfo(model.right, header()));
    EXPECT_EQ(back.left.lens, lens);
    EXPECT_EQ(back.left.D, D);
    EXPECT_EQ(back.right.D, D);
  }
  // Zeros are a pinhole in two models, and a fisheye in the third.
  sensor_msgs::CameraInfo info = toCameraInfo(model.left, header());
  info.D.assign(4, 0.0);
  EXPECT_EQ(cameraModelFromInfo(info).lens, LensModel::kEquidistant);
  info.distortion_model.clear();
  info.D.clear();
  EXPECT_EQ(cameraModelFromInfo(info).lens, LensModel::kPlumbBob);
}

TEST(Conversions, badCalibrationsAreRefusedByName) {
  const sensor_msgs::CameraInfo left = toCameraInfo(someModel().left, header());
  const sensor_msgs::CameraInfo right = toCameraInfo(someModel().right, header());
  expectMessage([&] { stereoModelFromInfo(right, left); }, "swapped");
  expectMessage([&] { stereoModelFromInfo(left, left); }, "baseline");
  expectMessage([&] { stereoModelFromInfo(left, sensor_msgs::CameraInfo()); }, "right camera_info: K is zero");
  const auto refused = [&](const std::string& text, const auto& spoil) {
    sensor_msgs::CameraInfo info = right;
    spoil(info);
    expectMessage([&] { stereoModelFromInfo(left, info); }, text);
  };
  refused("baseline", [](auto& info) { info.P[3] *= 1000; });  // millimetres
  refused("baseline", [](auto& info) { info.P[3] = -info.P[3]; });
  refused("baseline", [](auto& info) { info.P[3] = 0; });
  refused("baseline", [](auto& info) { info.P[3] = std::nan(""); });
  refused("not a rotation", [](auto& info) { info.R[0] = 0.9; });
  refused("not a rotation", [](auto& info) { info.R.assign(0); });
  refused("not a rotation", [](auto& info) { info.R[4] = std::nan(""); });
  refused("1024x768, right ones 640x768", [](auto& info) { info.width = 640; });
  refused("differ in fx, fy or cy", [](auto& info) { info.P[6] += 1; });
  refused("differ in fx, fy or cy", [](auto& info) { info.P[0] += 1; });
  refused("distortion_model is 'fisheye'; plumb_bob, rational_polynomial and equidistant are supported",
          [](auto& info) { info.distortion_model = "fisheye"; });
  refused("distortion_model is 'thin_prism'", [](auto& info) {
    info.distortion_model = "thin_prism";
    info.D.assign(5, 0.0);
  });
  refused("distortion_model is ''", [](auto& info) { info.distortion_model.clear(); });
  refused("D has 5 values; equidistant has 4: k1 k2 k3 k4", [](auto& info) { info.distortion_model = "equidistant"; });
  refused("D has 5 values; rational_polynomial has 8",
          [](auto& info) { info.distortion_model = "rational_polynomial"; });
  refused("D has 12 values, as of OpenCV's thin prism model", [](auto& info) {
    info.distortion_model = "rational_polynomial";
    info.D.resize(12, 0.1);
  });
  refused("D has 8", [](auto& info) { info.D.resize(8, 0.1); });
  refused("D is not finite", [](auto& info) { info.D[0] = std::nan(""); });
  refused("binning", [](auto& info) { info.binning_x = 2; });
  refused("region of interest", [](auto& info) { info.roi.width = 100; });
  refused("focal length", [](auto& info) { info.K[4] = -1; });
  refused("horizontal pair", [](auto& info) { info.P[7] = 3; });
}

/// Colours in large flat patches: demosaicking and jpeg keep their interior.
cv::Mat patches() {
  cv::Mat bgr(64, 96, CV_8UC3, cv::Scalar(30, 60, 200));
  bgr(cv::Rect(32, 0, 32, 64)) = cv::Scalar(200, 180, 20);
  bgr(cv::Rect(64, 0, 32, 64)) = cv::Scalar(90, 90, 90);
  return bgr;
}

void expectPatches(const cv::Mat& got, const cv::Mat& wanted, double tolerance) {
  ASSERT_EQ(got.type(), CV_8UC3);
  ASSERT_EQ(got.size(), wanted.size());
  for (const int x : {16, 48, 80}) {
    const cv::Vec3b a = got.at<cv::Vec3b>(32, x), b = wanted.at<cv::Vec3b>(32, x);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(a[c], b[c], tolerance) << "x " << x << " channel " << c;
  }
}

TEST(Conversions, imagesOfEveryEncodingBecomeBgr) {
  const cv::Mat bgr = patches();
  cv::Mat rgb, grey;
  cv::cvtColor(bgr, rgb, cv::COLOR_BGR2RGB);
  cv::cvtColor(bgr, grey, cv::COLOR_BGR2GRAY);
  cv::Mat grey_bgr, grey16;
  cv::cvtColor(grey, grey_bgr, cv::COLOR_GRAY2BGR);
  grey.convertTo(grey16, CV_16U, 257);
  const auto decode = [](const cv::Mat& pixels, const std::string& encoding) {
    cv::Mat bgr = bgrFromImage(*cv_bridge::CvImage(header(), encoding, pixels).toImageMsg());
    EXPECT_EQ(bgr.depth(), pixels.depth()) << encoding;
    BitDepth(16).toEightBits(bgr);
    return bgr;
  };
  expectPatches(decode(bgr, "bgr8"), bgr, 0);
  expectPatches(decode(rgb, "rgb8"), bgr, 0);
  expectPatches(decode(grey, "mono8"), grey_bgr, 0);
  expectPatches(decode(grey16, "mono16"), grey_bgr, 1);

  const std::vector<std::pair<std::string, std::vector<int>>> mosaics = {{"bayer_rggb8", {2, 1, 1, 0}},
                                                                         {"bayer_bggr8", {0, 1, 1, 2}},
                                                                         {"bayer_gbrg8", {1, 0, 2, 1}},
                                                                         {"bayer_grbg8", {1, 2, 0, 1}}};
  for (const auto& [encoding, channel] : mosaics) {
    cv::Mat mosaic(bgr.size(), CV_8U);
    for (int y = 0; y < bgr.rows; ++y)
      for (int x = 0; x < bgr.cols; ++x)
        mosaic.at<uint8_t>(y, x) = bgr.at<cv::Vec3b>(y, x)[channel[static_cast<std::size_t>(2 * (y % 2) + x % 2)]];
    SCOPED_TRACE(encoding);
    expectPatches(decode(mosaic, encoding), bgr, 1);
    cv::Mat mosaic16;
    mosaic.convertTo(mosaic16, CV_16U, 257);
    expectPatches(decode(mosaic16, encoding.substr(0, encoding.size() - 1) + "16"), bgr, 1);
    sensor_msgs::CompressedImage compressed;
    compressed.format = encoding + "; png compressed ";
    cv::imencode(".png", mosaic, compressed.data);
    expectPatches(bgrFromImage(compressed), bgr, 1);
  }
}

TEST(Conversions, compressedImagesThatAskForRotationAreRefused) {
  sensor_msgs::CompressedImage image;
  image.format = "jpeg";
  cv::imencode(".jpg", patches(), image.data);
  image.data = withOrientation(image.data, 6);
  expectMessage([&] { bgrFromImage(image); }, "carries EXIF orientation 6");
}

TEST(Conversions, compressedImagesBecomeBgr) {
  const cv::Mat bgr = patches();
  sensor_msgs::CompressedImage image;
  image.format = "bgr8; png compressed bgr8";
  cv::imencode(".png", bgr, image.data);
  EXPECT_TRUE(identical(bgrFromImage(image), bgr));
  image.format = "jpeg";
  cv::imencode(".jpg", bgr, image.data);
  expectPatches(bgrFromImage(image), bgr, 4);
  image.format = "rgb8; png compressed bgr8";  // from an rgb8 camera; the file itself holds its colours in order
  cv::imencode(".png", bgr, image.data);
  EXPECT_TRUE(identical(bgrFromImage(image), bgr));
  image.data.resize(20);
  expectMessage([&] { bgrFromImage(image); }, "cannot be decoded");
  image.data.clear();
  expectMessage([&] { bgrFromImage(image); }, "0 bytes");
}

TEST(Conversions, brokenImagesAreRefusedByName) {
  sensor_msgs::Image image = *cv_bridge::CvImage(header(), "bgr8", patches()).toImageMsg();
  image.data.resize(100);
  expectMessage([&] { bgrFromImage(image); }, "96x64");
  image = *cv_bridge::CvImage(header(), "bgr8", patches()).toImageMsg();
  image.encoding = "nonsense";
  expectMessage([&] { bgrFromImage(image); }, "'nonsense'");
  // Found by script/fuzz: two rows of 2^31 + 6 bytes are 12 in 32 bits.
  image = sensor_msgs::Image();
  image.encoding = "mono16";
  image.width = 3;
  image.height = 2;
  image.step = 0x80000006;
  image.data.resize(12);
  expectMessage([&] { bgrFromImage(image); }, "12 bytes of data are too few for 2 rows of 2147483654");
  expectMessage([&] { bgrFromImage(sensor_msgs::Image()); }, "0x0");
}

TEST(Conversions, disparityMessageGivesTheDepthOfVergingCameras) {
  const StereoModel model = someModel();
  const double z = 0.3;
  const double disparity = 3800 * 0.025 / z + 450 - 560;
  ASSERT_NEAR(depthOfDisparity(model, disparity), z, 1e-12);
  cv::Mat map(4, 6, CV_32FC1, cv::Scalar(disparity));
  map.at<float>(1, 2) = kNaN;
  const stereo_msgs::DisparityImage message = toDisparityImage(map, model, cv::Range(190, 230), header());
  const cv::Mat image = cv_bridge::toCvCopy(message.image)->image;
  EXPECT_NEAR(message.f * message.T / image.at<float>(0, 0), z, 1e-6);
  EXPECT_TRUE(std::isnan(image.at<float>(1, 2)));
  EXPECT_LT(message.min_disparity, image.at<float>(0, 0));
  EXPECT_GT(message.max_disparity, image.at<float>(0, 0));
}

TEST(Conversions, posesRoundTripAndBrokenOnesAreRefused) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::AngleAxisd(2.5, Eigen::Vector3d(1, -2, 0.5).normalized()).toRotationMatrix();
  T.translation() << 0.1, -0.2, 0.3;
  EXPECT_LT((isometryFromMessage(toPose(T)).matrix() - T.matrix()).norm(), 1e-12);
  EXPECT_LT((isometryFromMessage(toTransform(T)).matrix() - T.matrix()).norm(), 1e-12);
  geometry_msgs::Pose pose = toPose(T);
  pose.orientation.w += 0.1;
  expectMessage([&] { isometryFromMessage(pose); }, "not a finite rigid");
  expectMessage([&] { isometryFromMessage(geometry_msgs::Transform()); }, "not a finite rigid");  // all zero
  pose = toPose(T);
  pose.position.y = std::nan("");
  expectMessage([&] { isometryFromMessage(pose); }, "not a finite rigid");
  T.linear() *= 1.01;
  expectMessage([&] { toPose(T); }, "not a finite rigid");
  T.linear() = Eigen::DiagonalMatrix<double, 3>(1, 1, -1);
  expectMessage([&] { toPose(T); }, "not a finite rigid");
}

}  // namespace
}  // namespace cortshift_stereo
