// The surface of a recorded pair as a stage, by the rules of a replay.
#pragma once

#include <string>

#include "cortshift_tracking/case/stage_store.hpp"
#include "cortshift_tracking/offline/case_plan.hpp"
#include "cortshift_tracking/offline/case_recording.hpp"
#include "cortshift_tracking/offline/offline_parameters.hpp"

namespace cortshift_tracking {

/// As shift_tracker does in a replay, with a reconstruction that takes no time: the surface of the newest pair that is
/// not older than max_surface_age, else that of the next pair within capture_timeout. A pair that gives no surface is
/// passed over. Where surfaces are means, each pair of the window takes part. A capture of several pairs is the mean of
/// the next ones of one view, as capture_mean_stage makes it.
class CaseCapture {
 public:
  CaseCapture(const CaseRecording& recording, const OfflineParameters& parameters)
      : recording_(recording),
        parameters_(parameters),
        depth_(std::make_shared<cortshift_stereo::BitDepth>(parameters.reconstruction.image_bits)) {}

  /// @param remarks  gets what a person should know about what is missing
  /// @throws TrackingError naming the stage and, of the last pair that was tried, why it gave no surface
  StageRecord capture(const PlannedCapture& planned, std::string& remarks) const;

 private:
  struct Captured {
    StageRecord record;
    ros::Time arrival;  ///< of the pair, or of the last one of several
    std::string remarks;
  };

  cortshift_stereo::SurfaceReconstructionParameters parametersAt(const cortshift_stereo::PairMessages& messages) const;
  StageRecord recordOf(const PairPlace& place) const;
  void rememberEarlier(const PairPlace& place, cortshift_stereo::PairReconstruction& reconstruct) const;
  Captured captureOne(const PlannedCapture& planned) const;
  Captured captureMean(const PlannedCapture& planned) const;
  std::string whyNone(const ros::Time& asked) const;
  std::string dropped(const PairPlace& place, const std::exception& error) const;

  const CaseRecording& recording_;
  OfflineParameters parameters_;
  std::shared_ptr<cortshift_stereo::BitDepth> depth_;  // one for the case
};

/// What a stage keeps of the pair that it was made from, as messages of a pair again.
cortshift_stereo::PairMessages pairOf(const StageRecord& record);

}  // namespace cortshift_tracking
