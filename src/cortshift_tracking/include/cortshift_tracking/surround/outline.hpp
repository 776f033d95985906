// Where the exposed brain is in what a stage shows.
#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "cortshift_tracking/projection/projection.hpp"

namespace cortshift_tracking {

struct Outline {
  cv::Mat brain;     ///< CV_8UC1 255 on the brain, over the projection's grid; empty: not known
  std::string text;  ///< for people: where it is from, or why it is not known
};

/// The brain by relief, drawn to where colours change; neither asks which colours, so that light and tissue may have
/// any. Where two bodies meet their surfaces form a crease (Hoffman and Richards, Parts of recognition, Cognition
/// 18:65-96, 1984): the brain ends at the deepest closed crease, about which bone stands up. Known where, nearly all
/// around, the edge is in view, bone is higher there than the brain would be if it went on, and colours differ at that
/// same place. What stands out by a step of depth (instruments) is no brain; cotton that lies flat on it is not told
/// from it. The same each time.
Outline proposeOutline(const Projection& projection);

}  // namespace cortshift_tracking
