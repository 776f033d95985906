// Checks at the door: pairs that cannot give a surface are refused with a reason a person can act on.
#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "cortshift_stereo/admission/row_agreement.hpp"

namespace cortshift_stereo {

/// A pair that is not reconstructed. `reason` is a short fixed word for counting; what() says what is wrong and what
/// to do about it.
class PairError : public std::runtime_error {
 public:
  PairError(const std::string& reason, const std::string& message) : std::runtime_error(message), reason_(reason) {}
  const std::string& reason() const { return reason_; }

 private:
  std::string reason_;
};

/// Limits of the checks. Each default is written here and nowhere else.
struct PairLimits {
  double min_contrast = 4;             ///< [grey levels] standard deviation of the luminance
  double max_saturated_share = 0.25;   ///< [0...1] of the pixels
  double min_sharpness = 0.18;         ///< see ImageQuality
  double max_epipolar_residual = 1.0;  ///< [px] spread of the vertical gaps that no motion of the cameras explains
  double max_misalignment = 3.0;       ///< [px] vertical gaps by a turn of the right camera; up to here it is taken out
  double max_sharpness_ratio = 2.5;    ///< of ImageQuality::detail between the two images
  double min_coverage = 0.25;          ///< [0...1] of what the camera shows of the rectified left image, with a point
};

/// What one image looks like.
struct ImageQuality {
  double contrast;         ///< [grey levels] standard deviation of the luminance
  double saturated_share;  ///< [0...1] of the pixels have two channels at the upper end
  double sharpness;        ///< amplitude of detail of 2-4 px relative to detail of 8-16 px in the middle of the image:
                           ///< 0.5 ... 1 in focus, below 0.17 when blurred by 4 px
  double detail;           ///< amplitude of detail of 4-8 px relative to detail of 8-16 px, sensor noise taken off
};

/// @param image  CV_8UC3
ImageQuality measureImage(const cv::Mat& image);

/// @throws PairError blank, saturated or defocused, naming the side
void checkImage(const ImageQuality& quality, const PairLimits& limits, const std::string& side);

/// What is known of the rows of a pair that is not refused.
struct RowVerdict {
  std::optional<cv::Vec3d> turn;  ///< a turn of the right camera that is worth taking out: see Rectifier::withRightTurned
};

/// Refuses a pair whose rows say that it is none or that its calibration is void; a turn that is smaller is to be taken
/// out. A limit counts as passed only where chance (kSureSds standard errors) does not explain it.
/// @throws PairError swapped, no_match or epipolar
RowVerdict judgeRows(const RowAgreement& rows, const PairLimits& limits);

/// Refuses a pair of which one image is blurred against the other.
/// @throws PairError defocused, naming the side
void checkAlikeSharp(const ImageQuality& left, const ImageQuality& right, const PairLimits& limits);

/// What a person should know of a pair whose right camera was turned by `taken` [rad].
/// @param depth  [m] of the surface
/// @param baseline  [m]; @param focal  [px] of the rectified right image
std::vector<std::string> warningsOfRows(const RowAgreement& rows, const cv::Vec3d& taken, double baseline, double depth,
                                        double focal);

}  // namespace cortshift_stereo
