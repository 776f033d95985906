// Every number of ReconstructionSettings by its name: what the parameters of the nodes and the options of the tools
// share.
#pragma once

#include <string>
#include <vector>

#include "cortshift_stereo/reconstruction.hpp"

namespace cortshift_stereo {

struct ReconstructionLimit {
  std::string name;  ///< of the parameter, as max_deviation
  double ReconstructionSettings::*own;
  double PairLimits::*of_pairs;  ///< one of the two is null
  double low, high;              ///< allowed
  std::string meaning;           ///< one line with the unit

  /// The number in settings that may be const.
  template <typename Settings>
  auto& in(Settings& settings) const {
    return own != nullptr ? settings.*own : settings.limits.*of_pairs;
  }

  /// Of the command line, without the dashes: max-deviation
  std::string option() const;
};

const std::vector<ReconstructionLimit>& reconstructionLimits();

}  // namespace cortshift_stereo
