#include "sources/faulty_source.hpp"

#include <utility>

namespace cortshift_stereo {

ImageFault imageFaultFromName(const std::string& name) {
  if (name == "none") return ImageFault::kNone;
  if (name == "blank") return ImageFault::kBlank;
  if (name == "saturated") return ImageFault::kSaturated;
  if (name == "swapped") return ImageFault::kSwapped;
  throw std::invalid_argument("image fault " + name + " is unknown; known are none, blank, saturated, swapped");
}

StereoPair FaultySource::fire() {
  StereoPair pair = source_->fire();
  switch (fault_) {
    case ImageFault::kNone:
      break;
    case ImageFault::kBlank:
      pair.left.setTo(cv::Scalar::all(0));
      pair.right.setTo(cv::Scalar::all(0));
      break;
    case ImageFault::kSaturated:
      pair.left.setTo(cv::Scalar::all(255));
      pair.right.setTo(cv::Scalar::all(255));
      break;
    case ImageFault::kSwapped:
      std::swap(pair.left, pair.right);
      break;
  }
  return pair;
}

}  // namespace cortshift_stereo
