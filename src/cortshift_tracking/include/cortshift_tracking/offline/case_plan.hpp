// What is to be done with a recorded case.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace cortshift_tracking {

struct PlannedCapture {
  std::string key;
  double seconds = 0;  ///< from the bag's start
  std::string note;
  unsigned int pairs = 1;  ///< the surface is the mean of so many pairs, 1 ... 64
};

struct PlannedShift {
  std::string from, to;
};

struct CasePlan {
  std::vector<PlannedCapture> captures;  ///< in order of time
  std::vector<PlannedShift> shifts;
  std::optional<Eigen::Vector3d> gravity_pmr;  ///< unit length

  /// Sorts the captures by time.
  /// @throws PlanError for keys that are no keys, stand twice or are not captured, for times before 0, means of too
  /// many pairs, for shifts that
  ///         go back in time or stand twice, and for a plan with nothing to do
  void check();
};

/// A plan that cannot be meant so.
class PlanError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// `KEY@SECONDS`, or `KEY@SECONDSxPAIRS` for the mean of several pairs. @throws PlanError
PlannedCapture captureFromText(const std::string& text);

/// FROM:TO. @throws PlanError
PlannedShift shiftFromText(const std::string& text);

/// x,y,z with or without brackets. @throws PlanError unless it is a direction
Eigen::Vector3d directionFromText(const std::string& text);

/// A YAML file:
///
///     captures: [{key: dural_opening, at: 5.2, pairs: 8, note: before resection}, ...]
///                           # at: seconds from the bag's start; pairs: of the mean, may be left out as may the note
///     shifts: [{from: dural_opening, to: after_resection}, ...]
///     gravity: [0, -1, 0]                                                      # direction in pmr, may be left out
///
/// @throws PlanError naming the entry and what is wrong with it
CasePlan planFromYaml(const std::string& path);

}  // namespace cortshift_tracking
