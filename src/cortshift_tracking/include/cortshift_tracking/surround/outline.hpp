// Where the exposed brain is in what a stage shows.
#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "cortshift_tracking/projection/projection.hpp"

namespace cortshift_tracking {

constexpr double kSmallHole = 0.000025;  // [m^2] a glint or a shadow in the brain; more is something that lies on it

struct Outline {
  cv::Mat brain;     ///< CV_8UC1 255 on the brain, over the projection's grid; empty: not known
  cv::Mat opening;   ///< CV_8UC1 255 on the brain and what lies on it; empty: not known
  std::string text;  ///< for people: where it is from, or why it is not known
};

/// The best closed edge, whatever speaks against it.
struct FoundOutline {
  cv::Mat brain, opening;  ///< as of an Outline; empty: the view is too small
  double seen = 0;         ///< share of the way around on which both sides of the edge are in view, 0...1
  double stepped = 0;      ///< of these: where bone stands up
  double clear = 0;        ///< of these: where colours differ
  double together = 0;     ///< of these: where relief and colours have the edge at the same place
};

FoundOutline findOutline(const Projection& projection);

/// What an outline must have to be known. `stepped` lies between what right outlines and plainly wrong ones have on
/// `config/phantom/fit` (script/benchmark surround --set config/phantom/fit --only limits); the others are for views
/// that the set does not have.
struct OutlineLimits {
  double seen = 0.65;  ///< a retractor may hide a fifth of the way around, and the view end at some bone
  double stepped = 0.75;
  double clear = 0.85, together = 0.85;  ///< blood over the rim hides up to a tenth
};

/// Why what was found is not enough for an outline; empty: it is.
std::string doubtOf(const FoundOutline& found, const OutlineLimits& limits = {});

/// The brain by relief, drawn to where colours change; neither asks which colours, so that light and tissue may have
/// any. Where two bodies meet their surfaces form a crease (Hoffman and Richards, Parts of recognition, Cognition
/// 18:65-96, 1984): the brain ends at the deepest closed crease, about which bone stands up. Known where, nearly all
/// around, the edge is in view, bone is higher there than the brain would be if it went on, and colours differ at that
/// same place. What stands out by a step of depth (instruments) is no brain, nor what has the paleness of bone and an
/// edge (cotton, a flap of dura). Cotton that lies flat is not told from tissue without a colour of its own, nor where
/// it covers more than half of what is seen of the brain, nor always over the rim. The same each time.
Outline proposeOutline(const Projection& projection);

}  // namespace cortshift_tracking
