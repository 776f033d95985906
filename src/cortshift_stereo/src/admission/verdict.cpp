#include "cortshift_stereo/admission/verdict.hpp"

#include <algorithm>

namespace cortshift_stereo {

Verdict Findings::verdict() const {
  Verdict worst = Verdict::kAccept;
  for (const Finding& finding : all_) worst = std::max(worst, finding.verdict);
  return worst;
}

const Finding* Findings::refusal() const {
  for (const Finding& finding : all_)
    if (finding.verdict == Verdict::kRefuse) return &finding;
  return nullptr;
}

std::vector<std::string> Findings::warnings() const {
  std::vector<std::string> sentences;
  for (const Finding& finding : all_)
    if (finding.verdict == Verdict::kWarn) addWarnings(sentences, {finding.sentence()});
  return sentences;
}

void Findings::requireAccepted() const {
  if (const Finding* finding = refusal()) throw PairError(*finding);
}

void addWarnings(std::vector<std::string>& to, const std::vector<std::string>& more) {
  for (const std::string& warning : more)
    if (std::find(to.begin(), to.end(), warning) == to.end()) to.push_back(warning);
}

}  // namespace cortshift_stereo
