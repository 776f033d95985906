#include "cortshift_stereo_phantom/board_image.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "cortshift_stereo/geometry/lens.hpp"

namespace cortshift_stereo_phantom {
namespace {

/// +1 in even, -1 in odd cells of unit width, crossing 0 at the borders over `blur` on both sides.
double softCell(double x, double blur) {
  const double border = std::round(x);
  const bool even_above = static_cast<long>(border) % 2 == 0;
  return std::clamp((x - border) / blur, -1.0, 1.0) * (even_above ? 1 : -1);
}

}  // namespace

cv::Mat renderBoard(const cortshift_stereo::CameraModel& camera, const cv::Affine3d& T_camera_board,
                    const cortshift_stereo::Board& board) {
  const cv::Size size = camera.size;
  std::vector<cv::Point2d> pixels;
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x) pixels.emplace_back(x, y);
  const std::vector<cv::Point2d> rays = directionsOf(camera, pixels);
  const cv::Matx33d R = T_camera_board.rotation();
  const cv::Vec3d t = T_camera_board.translation();
  const cv::Matx33d to_board =
      cv::Matx33d(R(0, 0), R(0, 1), t[0], R(1, 0), R(1, 1), t[1], R(2, 0), R(2, 1), t[2]).inv();
  const double blur = 0.8 * t[2] / camera.K(0, 0) / board.square;  // 0.8 px in squares
  cv::Mat image(size, CV_8UC1);
  for (int i = 0; i < size.area(); ++i) {
    const cv::Vec3d on_board = to_board * cv::Vec3d(rays[i].x, rays[i].y, 1);
    const double x = on_board[0] / on_board[2] / board.square, y = on_board[1] / on_board[2] / board.square;
    double brightness = 120;  // what lies around the board
    if (x > -2 && y > -2 && x < board.corners.width + 1 && y < board.corners.height + 1) brightness = 205;
    if (x > -1 && y > -1 && x < board.corners.width && y < board.corners.height)
      brightness = 120 - 85 * softCell(x, blur) * softCell(y, blur);
    image.at<uchar>(i / size.width, i % size.width) = cv::saturate_cast<uchar>(brightness);
  }
  cv::Mat noise(size, CV_16SC1), noisy;
  cv::RNG random(42);
  random.fill(noise, cv::RNG::NORMAL, 0, 2);
  cv::add(image, noise, noisy, cv::noArray(), CV_8UC1);
  return noisy;
}

}  // namespace cortshift_stereo_phantom
