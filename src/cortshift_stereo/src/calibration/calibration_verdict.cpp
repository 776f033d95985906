#include "cortshift_stereo/calibration/calibration_verdict.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>

namespace cortshift_stereo {
namespace {

std::string nameOf(Grade grade) {
  return grade == Grade::kGood ? "good" : grade == Grade::kDoubtful ? "doubtful" : "useless";
}

}  // namespace

Grade CalibrationVerdict::grade() const {
  Grade worst = Grade::kGood;
  for (const Finding& finding : findings_) worst = std::max(worst, finding.grade);
  return worst;
}

std::string CalibrationVerdict::line() const {
  std::string reasons;
  for (const Grade grade : {Grade::kUseless, Grade::kDoubtful, Grade::kGood})
    for (const Finding& finding : findings_)
      if (finding.grade == grade) reasons += (reasons.empty() ? ": " : "; ") + finding.what;
  return "verdict: " + nameOf(grade()) + reasons;
}

std::string CalibrationVerdict::yaml() const {
  std::string text = "verdict: " + nameOf(grade()) + "\nfindings:" + (findings_.empty() ? " []" : "") + "\n";
  for (const Finding& finding : findings_)
    text += "  - {grade: " + nameOf(finding.grade) + ", what: \"" + finding.what + "\"}\n";
  return text;
}

}  // namespace cortshift_stereo
