// Images of chessboards through the phantom's zoom lens at a grid of settings: what calibrate_settings is fed with.
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "cortshift_stereo/command_line.hpp"
#include "cortshift_stereo_phantom/board_image.hpp"
#include "cortshift_stereo_phantom/phantom_cameras.hpp"

namespace cortshift_stereo {
namespace {

using namespace cortshift_stereo_phantom;

const char* const kHelp =
    R"(render_boards --case CASE.yaml --output DIR

Render what the phantom's cameras see of a small and of a large chessboard at the working distance, at a grid of 5
magnifications (0.75 to 1.4 times that of the reference) and 5 focal lengths (0.85 to 1.16 times), wherever the whole
board is in view. DIR gets the images and manifest.yaml for calibrate_settings; made if missing. The case needs a zoom
lens (cameras.zoom).
Exit: 0 done, 1 failed, 2 bad usage.
)";

constexpr double kMagnifications[] = {0.75, 0.87, 1.0, 1.2, 1.4};
constexpr double kFocalLengths[] = {0.85, 0.93, 1.0, 1.08, 1.16};

cv::Affine3d affineOf(const Eigen::Isometry3d& T) {
  cv::Matx44d matrix;
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column) matrix(row, column) = T.matrix()(row, column);
  return cv::Affine3d(matrix);
}

/// A board that lies a little tilted at the working distance, its middle on the microscope's axis.
Eigen::Isometry3d placeBoard(const Board& board, double distance) {
  const Eigen::Vector3d middle(0.5 * (board.corners.width - 1) * board.square,
                               0.5 * (board.corners.height - 1) * board.square, 0);
  return Eigen::Translation3d(0, 0, distance) * Eigen::AngleAxisd(0.06, Eigen::Vector3d::UnitX()) *
         Eigen::AngleAxisd(-0.04, Eigen::Vector3d::UnitY()) * Eigen::Translation3d(-middle);  // T_head_board
}

class BoardSession {
 public:
  BoardSession(const CameraSettings& cameras, const std::string& folder)
      : cameras_(cameras), reference_(makeStereoHead(cameras)), folder_(folder) {}

  bool seesAll(const Board& board, double magnification, double focal_length) const {
    const StereoHead head = atSetting(reference_, cameras_, magnification, focal_length);
    const Eigen::Isometry3d T_head_board = placeBoard(board, cameras_.working_distance);
    for (const Side side : {Side::kLeft, Side::kRight}) {
      const View view = rawView(head, {}, side, Eigen::Isometry3d::Identity());
      // With the squares around the inner corners.
      for (int y = -1; y <= board.corners.height; ++y)
        for (int x = -1; x <= board.corners.width; ++x) {
          const auto pixel = view.project(T_head_board * Eigen::Vector3d(x * board.square, y * board.square, 0));
          constexpr double kRim = 2;  // [px]
          if (!pixel || pixel->x() < kRim || pixel->y() < kRim || pixel->x() > view.size.width - 1 - kRim ||
              pixel->y() > view.size.height - 1 - kRim)
            return false;
        }
    }
    return true;
  }

  /// "left: NAME_left.png, right: NAME_right.png"
  std::string take(const Board& board, const std::string& name, double magnification, double focal_length) const {
    const StereoHead head = atSetting(reference_, cameras_, magnification, focal_length);
    const Eigen::Isometry3d T_head_board = placeBoard(board, cameras_.working_distance);
    for (const Side side : {Side::kLeft, Side::kRight}) {
      const auto& camera = side == Side::kLeft ? head.model.left : head.model.right;
      const auto& T_head_camera = side == Side::kLeft ? head.T_head_left : head.T_head_right;
      const std::string path = folder_ + "/" + name + (side == Side::kLeft ? "_left.png" : "_right.png");
      if (!cv::imwrite(path, renderBoard(camera, affineOf(T_head_camera.inverse() * T_head_board), board)))
        throw std::runtime_error("cannot write " + path);
    }
    return "left: " + name + "_left.png, right: " + name + "_right.png";
  }

 private:
  CameraSettings cameras_;
  StereoHead reference_;
  std::string folder_;
};

void run(const Options& options) {
  const PhantomCase description = loadPhantomCase(options.required("case"));
  const std::string folder = options.required("output");
  if (!description.cameras.zoom)
    throw PhantomCaseError("the case " + description.name + " has no zoom lens; give it a section cameras.zoom");
  const ZoomSettings& zoom = *description.cameras.zoom;
  std::filesystem::create_directories(folder);
  const BoardSession session(description.cameras, folder);
  // Sizes in shares of the field of view: the large board fills it at the reference, the small one at full zoom.
  const double width = description.cameras.field_of_view;
  const auto progress = progressBar("rendering");
  std::ostringstream manifest;
  manifest.precision(17);
  manifest << "reference: {magnification: " << zoom.magnification << ", focal_length: " << zoom.focal_length
           << "}\nboards:\n";
  double done = 0;
  for (const auto& [name, board] :
       {std::pair("small", Board{{11, 8}, 0.045 * width}), std::pair("large", Board{{15, 11}, 0.0575 * width})}) {
    if (!session.seesAll(board, zoom.magnification, zoom.focal_length))
      throw PhantomCaseError(std::string("the ") + name +
                             " board does not fit into the view at the reference setting; use images of 4:3");
    manifest << "  - board: " << board.name() << "\n    reference: {"
             << session.take(board, std::string(name) + "_reference", zoom.magnification, zoom.focal_length)
             << "}\n    views:\n";
    for (const double m : kMagnifications)
      for (const double f : kFocalLengths) {
        if (progress) progress((done += 1) / 50);
        const double magnification = m * zoom.magnification, focal_length = f * zoom.focal_length;
        if (!session.seesAll(board, magnification, focal_length)) continue;
        std::ostringstream view;
        view << name << "_" << m << "_" << f;
        manifest << "      - {magnification: " << magnification << ", focal_length: " << focal_length << ", "
                 << session.take(board, view.str(), magnification, focal_length) << "}\n";
      }
  }
  std::ofstream file(folder + "/manifest.yaml");
  file << manifest.str();
  if (!file.flush()) throw std::runtime_error("cannot write " + folder + "/manifest.yaml");
}

}  // namespace
}  // namespace cortshift_stereo

int main(int argc, char** argv) {
  return cortshift_stereo::runTool(argc, argv, cortshift_stereo::kHelp, {"case", "output"}, cortshift_stereo::run);
}
