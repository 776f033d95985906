#include "cortshift_stereo/geometry/surface_file.hpp"

#include <cmath>
#include <cstring>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <vector>

namespace cortshift_stereo {
namespace {

void write(const std::string& path, const std::string& head, const std::vector<uint8_t>& body) {
  std::ofstream file(path, std::ios::binary);
  file << head;
  file.write(reinterpret_cast<const char*>(body.data()), static_cast<std::streamsize>(body.size()));
  file.close();
  if (!file) throw std::runtime_error("cannot write " + path + "; does its folder exist, and is there space?");
}

}  // namespace

void writePly(const std::string& path, const Surface& surface) {
  constexpr std::size_t kPointBytes = 19;
  std::vector<uint8_t> body;
  body.reserve(surface.points.total() * kPointBytes);
  std::size_t count = 0;
  for (int y = 0; y < surface.points.rows; ++y)
    for (int x = 0; x < surface.points.cols; ++x) {
      const cv::Vec3f& point = surface.points.at<cv::Vec3f>(y, x);
      if (std::isnan(point[0])) continue;
      const cv::Vec3b& bgr = surface.colour.at<cv::Vec3b>(y, x);
      const std::size_t at = body.size();
      body.resize(at + kPointBytes);
      std::memcpy(&body[at], point.val, 12);
      for (std::size_t c = 0; c < 3; ++c) body[at + 12 + c] = bgr[2 - static_cast<int>(c)];
      std::memcpy(&body[at + 15], &surface.confidence.at<float>(y, x), 4);
      ++count;
    }
  write(path,
        "ply\nformat binary_little_endian 1.0\ncomment raw left camera frame, metres\nelement vertex " +
            std::to_string(count) +
            "\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\n"
            "property uchar blue\nproperty float confidence\nend_header\n",
        body);
}

void writePfm(const std::string& path, const cv::Mat& disparity) {
  CV_Assert(disparity.type() == CV_32FC1);
  std::vector<uint8_t> body;
  cv::imencode(".pfm", disparity, body);
  write(path, "", body);
}

}  // namespace cortshift_stereo
