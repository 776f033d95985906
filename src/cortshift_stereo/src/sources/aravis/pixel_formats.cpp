#include "sources/aravis/pixel_formats.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace cortshift_stereo {
namespace {

constexpr int kCopy = -1;

struct PixelFormat {
  const char* name;
  int type;    // of the matrix that holds the raw pixels
  int bits;    // that are used of each value
  int to_bgr;  // cv::cvtColor's code
};

// OpenCV names Bayer patterns by the second row and column, GenICam by the first.
const std::vector<PixelFormat>& formats() {
  static const std::vector<PixelFormat> table = {{"Mono8", CV_8UC1, 8, cv::COLOR_GRAY2BGR},
                                                 {"Mono10", CV_16UC1, 10, cv::COLOR_GRAY2BGR},
                                                 {"Mono12", CV_16UC1, 12, cv::COLOR_GRAY2BGR},
                                                 {"Mono16", CV_16UC1, 16, cv::COLOR_GRAY2BGR},
                                                 {"BayerRG8", CV_8UC1, 8, cv::COLOR_BayerBG2BGR},
                                                 {"BayerRG10", CV_16UC1, 10, cv::COLOR_BayerBG2BGR},
                                                 {"BayerRG12", CV_16UC1, 12, cv::COLOR_BayerBG2BGR},
                                                 {"BayerRG16", CV_16UC1, 16, cv::COLOR_BayerBG2BGR},
                                                 {"BayerGR8", CV_8UC1, 8, cv::COLOR_BayerGB2BGR},
                                                 {"BayerGR12", CV_16UC1, 12, cv::COLOR_BayerGB2BGR},
                                                 {"BayerGB8", CV_8UC1, 8, cv::COLOR_BayerGR2BGR},
                                                 {"BayerGB12", CV_16UC1, 12, cv::COLOR_BayerGR2BGR},
                                                 {"BayerBG8", CV_8UC1, 8, cv::COLOR_BayerRG2BGR},
                                                 {"BayerBG12", CV_16UC1, 12, cv::COLOR_BayerRG2BGR},
                                                 {"RGB8", CV_8UC3, 8, cv::COLOR_RGB2BGR},
                                                 {"BGR8", CV_8UC3, 8, kCopy},
                                                 {"YUV422_8_UYVY", CV_8UC2, 8, cv::COLOR_YUV2BGR_UYVY},
                                                 {"YUV422_8", CV_8UC2, 8, cv::COLOR_YUV2BGR_YUYV}};
  return table;
}

const PixelFormat& find(const std::string& name) {
  for (const PixelFormat& format : formats())
    if (name == format.name) return format;
  std::string known;
  for (const PixelFormat& format : formats()) known += std::string(" ") + format.name;
  throw std::invalid_argument("pixel format '" + name + "' is not known; known are" + known);
}

}  // namespace

const std::vector<std::string>& knownPixelFormats() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> list;
    for (const PixelFormat& format : formats()) list.emplace_back(format.name);
    return list;
  }();
  return names;
}

std::size_t bytesOfImage(const std::string& format, cv::Size size) {
  return static_cast<std::size_t>(size.area()) * CV_ELEM_SIZE(find(format).type);
}

cv::Mat toBgr(const std::string& name, cv::Size size, const void* data) {
  const PixelFormat& format = find(name);
  const cv::Mat raw(size, format.type, const_cast<void*>(data));
  cv::Mat eight = raw, bgr;
  if (format.bits > 8)
    raw.convertTo(eight, CV_8U, 1.0 / (1 << (format.bits - 8)), -0.5 + 1.0 / 512);  // cuts, as a shift
  if (format.to_bgr == kCopy) return eight.clone();
  cv::cvtColor(eight, bgr, format.to_bgr);
  return bgr;
}

}  // namespace cortshift_stereo
