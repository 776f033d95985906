// Whether a calibration can be used, and what to do if not.
#pragma once

#include <string>
#include <vector>

namespace cortshift_stereo {

enum class Grade { kGood, kDoubtful, kUseless };

/// The worst of several findings; none: good.
class CalibrationVerdict {
 public:
  /// @param what  one sentence without its stop: what was found, by how much, and what to do
  void add(Grade grade, const std::string& what) { findings_.push_back({grade, what}); }

  /// A value against its two limits. @param what  begins with the value
  void judge(double value, double good, double useful, const std::string& what) {
    if (!(value <= good)) add(value <= useful ? Grade::kDoubtful : Grade::kUseless, what);
  }

  Grade grade() const;

  /// "verdict: doubtful: the boards ...; ..."
  std::string line() const;

  /// verdict and findings as two keys of a YAML file.
  std::string yaml() const;

 private:
  struct Finding {
    Grade grade;
    std::string what;
  };
  std::vector<Finding> findings_;
};

/// Smallest error that matters, in pixels and metres. Shifts are trusted to 0.25 mm (the reach of `confidence`); at the
/// working distance of 0.3 m of a microscope with 3840 px focal length and a baseline of 25 mm, one pixel of disparity
/// is 0.3^2 / (3840 * 0.025) = 0.94 mm, so 0.27 px.
constexpr double kHarmlessPixels = 0.27;
constexpr double kHarmlessMetres = 0.25e-3;

/// More views left out than that: what is wrong is not the views. Half of them would be no majority any more.
constexpr double kFewLeftOut = 0.25;
constexpr double kMostLeftOut = 0.5;

}  // namespace cortshift_stereo
