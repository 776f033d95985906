// The parts of the camera sources that need no camera.
#include <gtest/gtest.h>

#include <functional>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

#include "cortshift_stereo/sources/aravis_settings.hpp"
#include "scratch_folder.hpp"
#include "sources/aravis/clock_map.hpp"
#include "sources/aravis/frame_id_guard.hpp"
#include "sources/aravis/pixel_formats.hpp"
#include "sources/folder_source.hpp"

namespace cortshift_stereo {
namespace {

// A camera clock that is a week behind and 80 ppm fast, seen through transfers of 5 ms and more.
TEST(ClockMap, FindsOffsetAndDriftUnderTheJitter) {
  std::mt19937 random(3);
  std::exponential_distribution<double> jitter(1 / 0.008);
  ClockMap map(600);
  const double rate = 1 + 80e-6, fastest = 0.005;
  double worst = 0;
  for (int i = 0; i < 3000; ++i) {
    const double host = 1.7e9 + 0.1 * i;
    const Stamp exposed = fromSeconds(1000 + 0.1 * i * rate);
    map.add(exposed, fromSeconds(host + fastest + jitter(random)));
    if (i > 300) worst = std::max(worst, std::abs(toSeconds(map.toHost(exposed) - fromSeconds(host)) - fastest));
  }
  EXPECT_NEAR(map.drift(), -80e-6, 8e-6);
  EXPECT_LT(worst, 0.001);  // the jitter has 8 ms
  EXPECT_EQ(map.samples(), 600u);
}

// The camera's clock is set: 2 s back, 0.2 s back (less than the time between two images), and 2 s forward.
TEST(ClockMap, BeginsAnewWhereTheCamerasClockIsSet) {
  for (const double jump : {-2.0, -0.2, 2.0}) {
    ClockMap map;
    int noticed = 0;
    double told = 0;
    for (int i = 0; i < 200; ++i) {
      const double time = 0.25 * i, device = 1000 + time + (i >= 100 ? jump : 0);
      const double said = map.add(fromSeconds(device), fromSeconds(5000 + time + 0.020));
      if (said != 0) {
        ++noticed;
        told = said;
        EXPECT_LE(i, 105) << jump;
      }
      if (i < 100 || i >= 105) {
        EXPECT_NEAR(toSeconds(map.toHost(fromSeconds(device))), 5000 + time + 0.020, 0.001) << jump << ", image " << i;
      }
    }
    EXPECT_EQ(noticed, 1) << jump;
    EXPECT_NEAR(told, jump, 0.001);
  }
}

TEST(ClockMap, ANetworkThatIsSlowForAWhileIsNoJump) {
  std::mt19937 random(5);
  std::exponential_distribution<double> jitter(1 / 0.15);
  ClockMap map;
  for (int i = 0; i < 2000; ++i) {
    const double time = 0.1 * i;
    EXPECT_EQ(map.add(fromSeconds(time), fromSeconds(time + 0.005 + (i / 50 % 2 == 0 ? 0 : jitter(random)))), 0) << i;
  }
}

TEST(ClockMap, OneSampleIsItsOwnArrival) {
  ClockMap map;
  map.add(Stamp(500), Stamp(1700000000123456789));
  EXPECT_EQ(map.toHost(Stamp(500)).count(), 1700000000123456789);
}

TEST(FrameIdGuard, HoldsPairsBackAfterALostFrame) {
  FrameIdGuard guard(2, 2);
  EXPECT_FALSE(guard.accept(10, 5));
  EXPECT_TRUE(guard.accept(11, 6));
  EXPECT_TRUE(guard.accept(13, 8));    // both missed one
  EXPECT_FALSE(guard.accept(14, 10));  // the left one missed one
  EXPECT_TRUE(guard.accept(15, 11));
  EXPECT_FALSE(guard.accept(16, 11));
  EXPECT_TRUE(guard.accept(17, 13));  // one stray difference is forgotten
}

TEST(FrameIdGuard, NumbersOfSixteenBitWrap) {
  FrameIdGuard guard(1, FrameIdGuard::kNever);
  EXPECT_TRUE(guard.accept(65535, 65533));
  EXPECT_TRUE(guard.accept(1, 65534));
  EXPECT_TRUE(guard.accept(3, 1));
}

TEST(FrameIdGuard, TriggeredCamerasKeepTheirFirstDifferenceUntilTheyAreSettledAnew) {
  FrameIdGuard guard(1, FrameIdGuard::kNever);
  EXPECT_TRUE(guard.accept(10, 5));
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(guard.accept(12 + i, 6 + i));
  EXPECT_TRUE(guard.accept(40, 35));
  guard.reset();
  EXPECT_TRUE(guard.accept(41, 35));
}

TEST(PixelFormats, GiveOneColour) {
  const cv::Vec3b bgr(40, 90, 200);
  const cv::Size size(8, 6);
  const cv::Mat expected(size, CV_8UC3, cv::Scalar(bgr[0], bgr[1], bgr[2]));
  // Red, green and blue of a 2 x 2 cell as the format's name says.
  for (const std::string pattern : {"RGGB", "GRBG", "GBRG", "BGGR"})
    for (const int bits : {8, 12}) {
      cv::Mat raw(size, bits == 8 ? CV_8UC1 : CV_16UC1);
      for (int y = 0; y < size.height; ++y)
        for (int x = 0; x < size.width; ++x) {
          const char colour = pattern[static_cast<std::size_t>(2 * (y % 2) + x % 2)];
          const int value = colour == 'R' ? bgr[2] : colour == 'G' ? bgr[1] : bgr[0];
          if (bits == 8)
            raw.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(value);
          else
            raw.at<std::uint16_t>(y, x) = static_cast<std::uint16_t>(value << 4 | 15);
        }
      const std::string format = "Bayer" + pattern.substr(0, 2) + std::to_string(bits);
      EXPECT_EQ(cv::norm(toBgr(format, size, raw.data), expected, cv::NORM_INF), 0) << format;
    }
  cv::Mat rgb;
  cv::cvtColor(expected, rgb, cv::COLOR_BGR2RGB);
  EXPECT_EQ(cv::norm(toBgr("RGB8", size, rgb.data), expected, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(toBgr("BGR8", size, expected.data), expected, cv::NORM_INF), 0);
  const cv::Mat grey(size, CV_16UC1, cv::Scalar(0xabcd));
  EXPECT_EQ(toBgr("Mono16", size, grey.data).at<cv::Vec3b>(3, 3), cv::Vec3b(0xab, 0xab, 0xab));
  for (const std::string& format : knownPixelFormats()) {
    const std::vector<std::uint8_t> data(bytesOfImage(format, size));
    EXPECT_EQ(toBgr(format, size, data.data()).type(), CV_8UC3) << format;
  }
  EXPECT_THROW(bytesOfImage("Mono12Packed", size), std::invalid_argument);
}

TEST(AravisSettings, RefusesTheImpossible) {
  AravisSettings good;
  good.left.device = "192.168.1.2";
  good.right.device = "192.168.1.3";
  good.validate();
  const auto refused = [&](const std::function<void(AravisSettings&)>& change) {
    AravisSettings bad = good;
    change(bad);
    EXPECT_THROW(bad.validate(), std::invalid_argument);
  };
  refused([](AravisSettings& s) { s.left.device.clear(); });
  refused([](AravisSettings& s) { s.right.device = s.left.device; });
  refused([](AravisSettings& s) { s.pixel_format = "Rainbow"; });
  refused([](AravisSettings& s) { s.exposure = 0; });
  refused([](AravisSettings& s) { s.frame_rate = 50; });  // for this tolerance
  refused([](AravisSettings& s) { s.right.features = {"LineMode"}; });
}

class FolderSourceTest : public ::testing::Test {
 protected:
  void SetUp() override {
    calibration_.left.size = calibration_.right.size = cv::Size(20, 10);
    for (int i = 0; i < 3; ++i)
      for (const char* side : {"left", "right"})
        write(side + std::to_string(i) + ".png", i + (side[0] == 'l' ? 0 : 100));
    write("cover.png", 7);
  }
  void write(const std::string& name, int grey, cv::Size size = cv::Size(20, 10)) {
    cv::imwrite(path() + "/" + name, cv::Mat(size, CV_8UC3, cv::Scalar::all(grey)));
  }
  std::string path() const { return folder_.path(); }

  ScratchFolder folder_;
  StereoModel calibration_;
  int now_ = 0;
};

TEST_F(FolderSourceTest, GivesPairsInOrder) {
  FolderSource pairs(path(), true, calibration_, [this] { return Stamp(++now_); });
  for (int i = 0; i < 7; ++i) {
    const StereoPair pair = pairs.fire();
    EXPECT_EQ(pair.left.at<cv::Vec3b>(0, 0)[0], i % 3);
    EXPECT_EQ(pair.right.at<cv::Vec3b>(0, 0)[0], 100 + i % 3);
    EXPECT_EQ(pair.stamp.count(), i + 1);
  }
}

TEST_F(FolderSourceTest, EndsWhereTheFolderEnds) {
  FolderSource pairs(path(), false, calibration_, [] { return Stamp(1); });
  for (int i = 0; i < 3; ++i) pairs.fire();
  EXPECT_THROW(pairs.fire(), SourceError);
}

TEST_F(FolderSourceTest, RefusesWhatIsNoPair) {
  write("left1.png", 1, cv::Size(5, 5));
  FolderSource pairs(path(), false, calibration_, [] { return Stamp(1); });
  pairs.fire();
  EXPECT_THROW(pairs.fire(), SourceError);  // another size than the calibration's
  pairs.fire();
  write("left9.png", 1);
  EXPECT_THROW(FolderSource(path(), false, calibration_, [] { return Stamp(1); }), std::invalid_argument);
  EXPECT_THROW(FolderSource(path() + "/none", false, calibration_, [] { return Stamp(1); }), std::invalid_argument);
}

}  // namespace
}  // namespace cortshift_stereo
