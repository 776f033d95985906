// Chessboard pairs to the calibration of the stereo head.
#include <cstdio>
#include <sstream>

#include "cortshift_stereo/calibration/board_images.hpp"
#include "cortshift_stereo/calibration/stereo/stereo_report.hpp"
#include "cortshift_stereo/calibration/stereo/stereo_verdict.hpp"
#include "cortshift_stereo/command_line.hpp"
#include "cortshift_stereo/geometry/lens.hpp"

namespace cortshift_stereo {
namespace {

const char* const kHelp =
    R"(calibrate_stereo --images DIR --board 9x6 --square 0.025 --output DIR [--views all|even|odd|NN,NN,...]
                 [--model plumb_bob|rational_polynomial|equidistant]

Calibrate the two cameras of the microscope from chessboard pairs.

  --images DIR   leftNN.* and rightNN.* (png, jpg, tif, bmp, pgm, ppm); a view needs both sides
  --board WxH    inner corners of the board along both sides
  --square S     side of a square [m]
  --output DIR   gets left.yaml and right.yaml (ROS camera_info) and report.yaml; made if missing
  --views WHICH  calibrate on these views and check on the others: all (default), every second one in the order
                 of their numbers (odd: 1st, 3rd, ...; even: 2nd, 4th, ...), or numbers as in the file names

  --model LENS   plumb_bob (default), rational_polynomial for strong distortion, equidistant for fisheyes

How many terms of the lens are used is chosen by cross-validation; the report shows all candidates, k1 alone among them.
The last line is the verdict: good, doubtful or useless, and what to do. Of a useless calibration only report.yaml is written.
Exit: 0 done, 1 failed or useless, 2 bad usage.
)";

/// Split the pairs into those to calibrate on (first) and those to check on.
std::pair<std::vector<BoardPair>, std::vector<BoardPair>> select(const std::vector<BoardPair>& pairs,
                                                                 const std::string& which) {
  std::set<std::string> wanted;
  if (which == "all" || which == "odd" || which == "even") {
    for (std::size_t i = 0; i < pairs.size(); ++i)
      if (which == "all" || (i % 2 == 0) == (which == "odd")) wanted.insert(pairs[i].name);
  } else {
    std::istringstream list(which);
    for (std::string name; std::getline(list, name, ',');) wanted.insert(name);
  }
  std::pair<std::vector<BoardPair>, std::vector<BoardPair>> split;
  for (const auto& pair : pairs) (wanted.erase(pair.name) ? split.first : split.second).push_back(pair);
  if (!wanted.empty()) throw UsageError("--views " + which + ": there is no usable view " + *wanted.begin());
  return split;
}

void printErrors(const char* label, const SetErrors& errors) {
  std::printf("%-28s %3zu views: reprojection %.3f px, epipolar %.3f px, corner spacing %.3f mm\n", label,
              errors.pairs.size(), errors.reprojection_rms, errors.epipolar_rms, errors.spacing_error * 1e3);
}

void run(const Options& options) {
  Board board;
  LensModel lens = LensModel::kPlumbBob;
  try {
    lens = lensNamed(options.find("model").value_or(nameOf(lens)), "--model");
    board = Board::parse(options.required("board"), options.requiredNumber("square"));
  } catch (const CalibrationError& fault) {
    throw UsageError(fault.what());
  }
  StereoReport report;
  report.date = dateNow();
  report.images = options.required("images");
  report.board = board;
  const std::string output = options.required("output");
  const BoardImages found = findBoards(report.images, board, progressBar("finding boards"));
  const auto [fit, check] = select(found.pairs, options.find("views").value_or("all"));

  try {
    report.calibration = calibrateStereo(board, found.size, fit, progressBar("calibrating"), lens);
  } catch (const CalibrationError& fault) {
    throw CalibrationError(std::string("verdict: useless: ") + fault.what());
  }
  auto& rejected = report.calibration.rejected;
  rejected.insert(rejected.begin(), found.rejected.begin(), found.rejected.end());
  if (!check.empty()) report.checks = checkPairs(report.calibration.parameters, board, check);
  report.verdict = judgeStereo(report.calibration, report.checks);
  writeStereoCalibration(output, report);

  for (const auto& view : rejected) std::printf("view %s left out: %s\n", view.name.c_str(), view.reason.c_str());
  for (const auto& score : report.calibration.scores)
    printErrors(("cross-validated " + score.model).c_str(), score.held_out);
  std::printf("distortion model: %s\n", report.calibration.model.c_str());
  printErrors("fitted", report.calibration.used);
  if (report.checks) printErrors("checked", *report.checks);
  const bool useless = report.verdict.grade() == Grade::kUseless;
  std::printf("wrote %sreport.yaml to %s\n%s\n", useless ? "" : "left.yaml, right.yaml and ", output.c_str(),
              report.verdict.line().c_str());
  if (useless) throw CalibrationError("the calibration is useless");
}

}  // namespace
}  // namespace cortshift_stereo

int main(int argc, char** argv) {
  using namespace cortshift_stereo;
  return runTool(argc, argv, kHelp, {"images", "board", "square", "output", "views", "model"}, run);
}
