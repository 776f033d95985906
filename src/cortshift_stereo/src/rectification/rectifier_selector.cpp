#include "cortshift_stereo/rectification/rectifier_selector.hpp"

#include <cmath>

#include "cortshift_stereo/admission/verdict.hpp"

namespace cortshift_stereo {
namespace {

bool equal(const MicroscopeSetting& a, const MicroscopeSetting& b) {
  return a.magnification == b.magnification && a.focal_length == b.focal_length;
}

bool near(const MicroscopeSetting& a, const MicroscopeSetting& b, double tolerance) {
  return std::abs(a.magnification - b.magnification) <= tolerance * b.magnification &&
         std::abs(a.focal_length - b.focal_length) <= tolerance * b.focal_length;
}

}  // namespace

RectifierSelector::RectifierSelector(std::shared_ptr<const SettingsFields> fields,
                                     std::optional<MicroscopeSetting> reference, double tolerance)
    : fields_(std::move(fields)), given_reference_(reference), tolerance_(tolerance) {
  if (fields_ && reference && !near(*reference, fields_->reference(), tolerance))
    throw CalibrationError("the reference setting is given as " + describe(*reference) +
                           ", but the deformation fields lead to " + describe(fields_->reference()) +
                           "; they must belong to one stereo calibration");
  reference_ = fields_ ? std::optional(fields_->reference()) : given_reference_;
}

void RectifierSelector::calibrate(const StereoModel& model) {
  model_.reset();
  rectifier_ = nullptr;
  model.validate();
  model_ = model;
  reference_ = fields_ ? std::optional(fields_->reference()) : given_reference_;
}

bool RectifierSelector::isReference(const MicroscopeSetting& setting) const {
  return near(setting, *reference_, tolerance_);
}

std::shared_ptr<const Rectifier> RectifierSelector::at(const std::optional<MicroscopeSetting>& setting) {
  if (!model_) throw CalibrationError("no stereo calibration is known");
  if (setting && !reference_) reference_ = setting;
  std::optional<MicroscopeSetting> other;  // than the reference
  if (setting && fields_ && fields_->cover(*setting)) {
    if (!equal(*setting, *reference_)) other = setting;
  } else if (setting && !isReference(*setting)) {
    throw PairError(CheckId::kSettings, "The microscope",
                    "is at " + describe(*setting) + ", but calibrated is only " + calibratedSettings(),
                    "turn the microscope back, or calibrate that setting with calibrate_settings");
  }
  const bool same = rectifier_ && rectifier_setting_.has_value() == other.has_value() &&
                    (!other || equal(*other, *rectifier_setting_));
  if (!same) {
    rectifier_ = nullptr;
    rectifier_ = other ? std::make_shared<const Rectifier>(*model_, *fields_, *other)
                       : std::make_shared<const Rectifier>(*model_);
    rectifier_setting_ = other;
  }
  return rectifier_;
}

std::string RectifierSelector::calibratedSettings() const {
  if (fields_) return fields_->left.calibratedRange();
  return reference_ ? describe(*reference_) : "the first setting that is reported";
}

}  // namespace cortshift_stereo
