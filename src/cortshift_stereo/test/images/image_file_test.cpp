#include "cortshift_stereo/images/image_file.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "cortshift_stereo/calibration/board.hpp"
#include "exif_image.hpp"
#include "scratch_folder.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_stereo_test::withOrientation;
using Bytes = std::vector<std::uint8_t>;

Bytes encoded(const std::string& extension, const cv::Mat& image) {
  Bytes bytes;
  cv::imencode(extension, image, bytes);
  return bytes;
}

cv::Mat ramp(int type) {
  cv::Mat image(40, 60, type);
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols * image.channels(); ++x)
      if (image.depth() == CV_8U)
        image.ptr<std::uint8_t>(y)[x] = static_cast<std::uint8_t>(x + 2 * y);
      else
        image.ptr<std::uint16_t>(y)[x] = static_cast<std::uint16_t>(300 * x + 2 * y);
  return image;
}

void write(const std::string& path, const Bytes& bytes) {
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

std::string refusal(const std::string& path) {
  try {
    readImageFile(path);
  } catch (const ImageError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(ImageFile, KeepsDepthAndChannelsOfWhatIsStored) {
  const ScratchFolder folder;
  for (const int type : {CV_8UC1, CV_8UC3, CV_16UC1, CV_16UC3})
    for (const std::string extension : {".png", ".tif"}) {
      write(folder.file("a" + extension), encoded(extension, ramp(type)));
      const cv::Mat read = readImageFile(folder.file("a" + extension));
      ASSERT_EQ(read.type(), type);
      EXPECT_EQ(cv::norm(read, ramp(type), cv::NORM_INF), 0);
      EXPECT_EQ(bgrOf(read).type(), CV_MAKETYPE(CV_MAT_DEPTH(type), 3));
    }
}

TEST(ImageFile, FindsTheOrientationThatJpegPngAndTiffCarry) {
  const Bytes jpeg = encoded(".jpg", ramp(CV_8UC3));
  EXPECT_EQ(exifOrientation(jpeg), 1);
  for (const bool big_endian : {true, false})
    for (std::uint8_t orientation = 1; orientation <= 8; ++orientation)
      EXPECT_EQ(exifOrientation(withOrientation(jpeg, orientation, big_endian)), orientation);
  EXPECT_EQ(exifOrientation(withOrientation(jpeg, 9)), 1) << "no such orientation";

  Bytes png = encoded(".png", ramp(CV_8UC3));
  EXPECT_EQ(exifOrientation(png), 1);
  const Bytes chunk{0,    0, 0, 26, 'e', 'X', 'I', 'f', 'M', 'M', 0, 42, 0, 0, 0, 8, 0, 1, 1,
                    0x12, 0, 3, 0,  0,   0,   1,   0,   3,   0,   0, 0,  0, 0, 0, 0, 0, 0, 0};
  constexpr std::ptrdiff_t kBehindHeader = 33;
  png.insert(png.begin() + kBehindHeader, chunk.begin(), chunk.end());
  EXPECT_EQ(exifOrientation(png), 3);

  EXPECT_EQ(exifOrientation(Bytes{'M', 'M', 0, 42, 0, 0, 0, 8, 0, 1, 1, 0x12, 0, 3, 0, 0, 0, 1, 0, 8, 0, 0}), 8);
  EXPECT_EQ(exifOrientation(encoded(".tif", ramp(CV_16UC1))), 1);
}

TEST(ImageFile, DamagedFilesEndTheSearchAndNothingElse) {
  const Bytes whole = withOrientation(encoded(".jpg", ramp(CV_8UC3)), 6);
  for (std::size_t size = 0; size < 120; ++size) exifOrientation(Bytes(whole.begin(), whole.begin() + size));
  Bytes far = whole;
  for (std::size_t i = 16; i < 20; ++i) far[i] = 0xff;  // the directory lies behind the end
  EXPECT_EQ(exifOrientation(far), 1);
}

TEST(ImageFile, RefusesByNameWhatAsksForRotationOrIsNoImage) {
  const ScratchFolder folder;
  const Bytes jpeg = encoded(".jpg", ramp(CV_8UC3));
  write(folder.file("upright.jpg"), withOrientation(jpeg, 1));
  EXPECT_EQ(readImageFile(folder.file("upright.jpg")).size(), cv::Size(60, 40));
  write(folder.file("left.jpg"), withOrientation(jpeg, 6));
  EXPECT_EQ(refusal(folder.file("left.jpg")).find(folder.file("left.jpg") + " carries EXIF orientation 6"), 0U);
  try {
    readGreyImage(folder.file("left.jpg"));
    FAIL() << "the calibration tools obey another rule";
  } catch (const CalibrationError& error) {
    EXPECT_NE(std::string(error.what()).find("left.jpg carries EXIF orientation 6"), std::string::npos);
  }
  write(folder.file("text.png"), Bytes{'n', 'o'});
  EXPECT_NE(refusal(folder.file("text.png")).find("text.png is not readable as an image"), std::string::npos);
  EXPECT_NE(refusal(folder.file("none.png")).find("none.png cannot be read"), std::string::npos);
  write(folder.file("float.tif"), encoded(".tif", cv::Mat(20, 20, CV_32FC1, cv::Scalar(0.5))));
  EXPECT_NE(refusal(folder.file("float.tif")).find("whole numbers of 8 or 16 bits"), std::string::npos);
}

}  // namespace
}  // namespace cortshift_stereo
