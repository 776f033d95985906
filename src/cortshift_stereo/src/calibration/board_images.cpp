#include "cortshift_stereo/calibration/board_images.hpp"

#include <filesystem>
#include <map>
#include <regex>

#include "calibration/same_size_images.hpp"

namespace cortshift_stereo {
namespace {

/// Paths of the two images of one view; empty where there is none.
struct PairPaths {
  std::string left, right;
};

std::map<std::string, PairPaths> listPairs(const std::string& folder) {
  if (!std::filesystem::is_directory(folder))
    throw CalibrationError(folder + ": no such folder; give the folder that holds left01.png, right01.png, ...");
  const std::regex image_name("(left|right)([0-9]+)\\.(png|jpg|jpeg|tif|tiff|bmp|pgm|ppm)", std::regex::icase);
  std::map<std::string, PairPaths> views;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    std::smatch parts;
    const std::string name = entry.path().filename().string();
    if (!std::regex_match(name, parts, image_name)) continue;
    auto& paths = views[parts[2]];
    std::string& path = std::tolower(parts[1].str()[0]) == 'l' ? paths.left : paths.right;
    if (!path.empty())
      throw CalibrationError(entry.path().string() + " and " + path + " are the same view; remove one of them");
    path = entry.path().string();
  }
  return views;
}

/// Where colours do not tell the board's ends apart, the cameras, side by side, see the same end first.
bool countedFromOtherEnd(const Corners& left, const Corners& right) {
  return (left.back() - left.front()).dot(right.back() - right.front()) < 0;
}

}  // namespace

BoardImages findBoards(const std::string& folder, const Board& board, const std::function<void(double)>& progress) {
  const auto views = listPairs(folder);
  BoardImages found;
  SameSizeImages images;
  std::size_t looked_at = 0, complete = 0;
  for (const auto& [name, paths] : views) {
    if (paths.left.empty() || paths.right.empty()) {
      found.rejected.push_back({name, paths.left.empty() ? "there is no left image" : "there is no right image"});
    } else {
      ++complete;
      const auto left = findBoard(images.read(paths.left), board);
      auto right = findBoard(images.read(paths.right), board);
      if (left && right) {
        if (countedFromOtherEnd(*left, *right)) right = upsideDown(*right);
        found.pairs.push_back({name, *left, *right});
      } else {
        found.rejected.push_back({name, std::string("the whole ") + board.name() + " board is not seen in the " +
                                            (left    ? "right"
                                             : right ? "left"
                                                     : "left and the right") +
                                            " image"});
      }
    }
    if (progress) progress(static_cast<double>(++looked_at) / static_cast<double>(views.size()));
  }
  found.size = images.size();
  if (complete == 0)
    throw CalibrationError(folder + ": no pairs leftNN.* and rightNN.* (png, jpg, tif, bmp, pgm, ppm) in this folder");
  if (found.pairs.empty())
    throw CalibrationError(folder + ": no " + board.name() + " board in any of the " + std::to_string(complete) +
                           " pairs; count its inner corners (where four squares meet), not its squares");
  return found;
}

}  // namespace cortshift_stereo
