#include "cortshift_stereo/calibration/settings/setting_views.hpp"

#include "calibration/same_size_images.hpp"

namespace cortshift_stereo {
namespace {

Corners requireBoard(SameSizeImages& images, const std::string& path, const Board& board) {
  const auto corners = findBoard(images.read(path), board);
  if (!corners)
    throw CalibrationError(path + ": the whole " + board.name() +
                           " board is not seen at the reference setting; correct the board or take the pair again");
  return *corners;
}

}  // namespace

SettingViews findSettingViews(const SettingsManifest& manifest, const std::function<void(double)>& progress) {
  SettingViews found;
  SameSizeImages images;
  std::size_t total = 0, done = 0;
  for (const auto& board : manifest.boards) total += board.views.size();
  for (const auto& board : manifest.boards) {
    const Corners left_reference = requireBoard(images, board.left, board.board);
    const Corners right_reference = requireBoard(images, board.right, board.board);
    const auto add = [&](const std::string& path, const MicroscopeSetting& setting, const Corners& reference,
                         std::vector<SettingView>& views) {
      auto corners = findBoard(images.read(path), board.board);
      if (!corners) {
        found.rejected.push_back({path, "the whole " + board.board.name() + " board is not seen"});
        return;
      }
      // The board does not turn between settings: of its two possible orders the one like that at the reference is
      // taken.
      if ((corners->back() - corners->front()).dot(reference.back() - reference.front()) < 0)
        corners = upsideDown(*corners);
      views.push_back({path, setting, *corners, reference});
    };
    for (const auto& view : board.views) {
      add(view.left, view.setting, left_reference, found.left);
      add(view.right, view.setting, right_reference, found.right);
      if (progress) progress(static_cast<double>(++done) / static_cast<double>(total));
    }
  }
  found.size = images.size();
  return found;
}

}  // namespace cortshift_stereo
