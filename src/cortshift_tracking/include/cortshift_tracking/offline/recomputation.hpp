// A stored stage made again from its raw pair, and how far two results of the same thing lie apart.
#pragma once

#include <cortshift_msgs/DisplacementField.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cortshift_stereo/ros/reconstruction/pair_reconstruction.hpp"
#include "cortshift_tracking/case/stage_store.hpp"
#include "cortshift_tracking/field/displacement_field.hpp"

namespace cortshift_tracking {

/// Bags of a case without opening its store, which would lock it and set files aside.
struct CaseFiles {
  std::vector<std::filesystem::path> stages;  ///< in order of capture
  std::vector<std::filesystem::path> fields;  ///< in order of their names
};

/// @param folder  with stages in it or in `stages/`, and fields FROM__TO.bag
/// @throws TrackingError if there is no such folder or no stage in it
CaseFiles findCase(const std::filesystem::path& folder);

/// Where a case keeps gravity, excluded regions and outlines: beside its stages. Nothing: it keeps none.
std::optional<std::filesystem::path> caseStateFile(const CaseFiles& files);

/// @throws TrackingError if the bag holds no DisplacementField on /shift/field
cortshift_msgs::DisplacementField fieldFromBag(const std::filesystem::path& path);

/// The stage again, from raw pair, calibration, settings and poses of the stored one; key, note and stamp are kept.
/// What it was warned of stays; what is warned of now is added.
/// @param parameters  those in force now
/// @param reconstruct  one for all stages of a case in their order, so that a calibration keeps its setting
/// @throws TrackingError where the stage keeps no raw pair, and what a reconstruction throws
StageRecord remakeStage(const StageRecord& stored, const std::string& parameters,
                        cortshift_stereo::PairReconstruction& reconstruct);

/// Which of software, configuration and calibration another result was made with, for people; empty: all the same.
std::string changedProvenance(const cortshift_msgs::Provenance& before, const cortshift_msgs::Provenance& after);

/// Lengths in metres over the places that are valid in both; NaN where there is none.
struct Change {
  std::size_t before = 0, after = 0, both = 0;  ///< valid places
  double median = 0, largest = 0;
};

/// @param before, after  CV_32FC3; of one size
Change changeOf(const cv::Mat& before, const cv::Mat& after);

}  // namespace cortshift_tracking
