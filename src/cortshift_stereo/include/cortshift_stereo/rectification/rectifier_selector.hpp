// Which rectification belongs to the microscope's present setting.
#pragma once

#include <memory>
#include <optional>

#include "cortshift_stereo/admission/pair_quality.hpp"
#include "cortshift_stereo/rectification/rectifier.hpp"

namespace cortshift_stereo {

/// Keeps the rectifier of the last setting, as making one takes longer than using it.
class RectifierSelector {
 public:
  /// @param fields     deformation fields of other settings; null: only the reference setting can be used
  /// @param reference  setting of the stereo calibration; nothing: that of the fields, and without fields the first one
  ///                   that is asked for
  /// @param tolerance  relative difference that still counts as the reference setting
  /// @throws CalibrationError if the reference is not that of the fields
  RectifierSelector(std::shared_ptr<const SettingsFields> fields, std::optional<MicroscopeSetting> reference,
                    double tolerance);

  /// From now on this calibration holds. @throws CalibrationError; then none holds
  void calibrate(const StereoModel& model);

  /// Setting of that calibration; nothing where it is not known yet.
  const std::optional<MicroscopeSetting>& reference() const { return reference_; }

  /// @param setting  of the microscope; nothing: it does not report any and stands at the reference
  /// @throws PairError "settings" where that setting is not calibrated; CalibrationError
  std::shared_ptr<const Rectifier> at(const std::optional<MicroscopeSetting>& setting);

  /// What the settings may be, for people.
  std::string calibratedSettings() const;

 private:
  bool isReference(const MicroscopeSetting& setting) const;

  std::shared_ptr<const SettingsFields> fields_;
  const std::optional<MicroscopeSetting> given_reference_;
  const double tolerance_;
  std::optional<StereoModel> model_;
  std::optional<MicroscopeSetting> reference_;  // of model_
  std::shared_ptr<const Rectifier> rectifier_;
  std::optional<MicroscopeSetting> rectifier_setting_;  // nothing: the reference
};

}  // namespace cortshift_stereo
