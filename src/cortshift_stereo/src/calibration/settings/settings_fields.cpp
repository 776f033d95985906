#include "cortshift_stereo/calibration/settings/settings_fields.hpp"

namespace cortshift_stereo {

void SettingsFields::requireCovered(const MicroscopeSetting& setting) const {
  left.requireCovered(setting);
  right.requireCovered(setting);
}

SettingsFields readSettingsFields(const std::string& folder) {
  SettingsFields fields{readSettingsWarp(folder + "/settings_left.yaml"),
                        readSettingsWarp(folder + "/settings_right.yaml")};
  const WarpModel &left = fields.left.model(), &right = fields.right.model();
  if (left.size != right.size || left.reference.magnification != right.reference.magnification ||
      left.reference.focal_length != right.reference.focal_length)
    throw CalibrationError(folder +
                           ": settings_left.yaml and settings_right.yaml differ in image size or reference setting; "
                           "take both from one run of calibrate_settings");
  return fields;
}

}  // namespace cortshift_stereo
