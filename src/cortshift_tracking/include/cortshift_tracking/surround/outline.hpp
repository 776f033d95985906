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

/// The brain by its colour and place: what has blood in it, cut off from bone, cloth and what looks like neither along
/// the strongest edge (Rother, Kolmogorov and Blake, ACM Transactions on Graphics 23(3):309-314, 2004). Not known where
/// no bone lies around it, since then nothing shows the colour of the light, or where colours leave doubt: brain like
/// bone, or much that looks like brain beyond the edge. The same each time.
Outline proposeOutline(const Projection& projection);

}  // namespace cortshift_tracking
