// What evidence about the input amounts to: accept, accept with a warning, or refuse. Judged once, for every door.
#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include "cortshift_stereo/admission/checks.hpp"

namespace cortshift_stereo {

enum class Verdict { kAccept, kWarn, kRefuse };

/// One thing that speaks against the input. Reads as a sentence: "THING REASON: REMEDY."
struct Finding {
  CheckId check;
  Verdict verdict;     ///< kWarn or kRefuse
  std::string thing;   ///< what it is about, "The left image"
  std::string reason;  ///< what is wrong with it, with the numbers, "is blank (contrast 2 grey levels, ...)"
  std::string remedy;  ///< what to do, "check the light"

  std::string sentence() const { return thing + " " + reason + ": " + remedy + "."; }
};

/// What the checks found; none: accepted.
class Findings {
 public:
  void warn(CheckId check, const std::string& thing, const std::string& reason, const std::string& remedy) {
    all_.push_back({check, Verdict::kWarn, thing, reason, remedy});
  }
  void refuse(CheckId check, const std::string& thing, const std::string& reason, const std::string& remedy) {
    all_.push_back({check, Verdict::kRefuse, thing, reason, remedy});
  }
  void add(const Findings& others) { all_.insert(all_.end(), others.all_.begin(), others.all_.end()); }

  const std::vector<Finding>& all() const { return all_; }
  Verdict verdict() const;

  /// The first that refuses; null where nothing does.
  const Finding* refusal() const;

  /// The sentences of what is accepted with a warning, each once: what travels with the result.
  std::vector<std::string> warnings() const;

  /// @throws PairError for the first that refuses
  void requireAccepted() const;

 private:
  std::vector<Finding> all_;
};

/// Appends those sentences that are not there yet.
void addWarnings(std::vector<std::string>& to, const std::vector<std::string>& more);

/// A pair that is not reconstructed. `reason` is a short fixed word for counting; what() says what is wrong and what
/// to do about it.
class PairError : public std::runtime_error {
 public:
  explicit PairError(const Finding& finding) : std::runtime_error(finding.sentence()), finding_(finding) {}
  PairError(CheckId check, const std::string& thing, const std::string& reason, const std::string& remedy)
      : PairError(Finding{check, Verdict::kRefuse, thing, reason, remedy}) {}

  std::string reason() const { return checkOf(finding_.check).word; }
  const Finding& finding() const { return finding_; }

 private:
  Finding finding_;
};

}  // namespace cortshift_stereo
