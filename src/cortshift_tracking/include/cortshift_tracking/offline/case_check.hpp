// What a recorded case holds, and what of the contract it lacks, before anything is computed.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "cortshift_tracking/offline/case_recording.hpp"

namespace cortshift_tracking {

/// Times in seconds from the bag's start.
struct PairCheck {
  double seconds = 0;   ///< when the pair had arrived
  std::string trouble;  ///< why it cannot give a surface; empty: nothing speaks against it
};

/// A stretch of the recording in which a stage can be captured.
struct Capturable {
  double first = 0, last = 0;  ///< arrival of its first and last pair [s]
  std::size_t pairs = 0;
};

/// The samples of a moving edge of tf.
struct EdgeCheck {
  std::string name;  ///< parent -> child
  std::size_t samples = 0, gaps = 0, backwards = 0;
  ros::Time first, last;               ///< stamps
  double longest = 0, longest_at = 0;  ///< [s]
};

struct CaseCheck {
  std::vector<std::string> missing;   ///< against the contract: no stage can be captured, or not all of it is known
  std::vector<std::string> warnings;  ///< a result carries them
  std::vector<std::string> contradictions;  ///< process_bag refuses them, beyond what happens in every recording
  std::vector<double> image_offsets;        ///< right stamp minus left stamp of neighbouring images [s]
  std::vector<EdgeCheck> edges;
  std::vector<std::string> calibration;  ///< what camera_info and tf say of the stereo head
  std::vector<PairCheck> pairs;
  std::vector<Capturable> capturable;
};

/// The judgement of process_bag without the computation. Reads the small messages and of the images the stamps alone,
/// but for a few where raw and compressed ones must agree. What it keeps is a few numbers for each pair.
/// @param progress  called with a share (0...1); may be empty
CaseCheck checkCase(const CaseRecording& recording, const cortshift_stereo::SurfaceReconstructionParameters& parameters,
                    const std::function<void(double)>& progress);

}  // namespace cortshift_tracking
