// Every parameter of shift_tracker, each default once.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "cortshift_stereo/admission/limits.hpp"
#include "cortshift_stereo/ros/parameter_source.hpp"
#include "cortshift_tracking/shift.hpp"

namespace cortshift_tracking {

struct ShiftTrackerParameters {
  std::string case_folder;        ///< folder of the stages; empty: a new one for each ROS master under ~/.ros/cortshift
  double capture_timeout = 10.0;  ///< longest wait for a surface [s, wall], 0.1 ... 600
  double max_surface_age = 2.0;   ///< a surface up to this old is captured at once [s, ROS time], 0 ... 3600
  double max_pose_gap = 0.2;      ///< farthest tracker sample on either side of a stage's stamp [s], 0.001 ... 10
  double max_speed = 0.005;       ///< of the microscope, or of what it looks at, at a capture [m/s], 0.0001 ... 1
  cortshift_stereo::PoseLimits poses;          ///< what tracker samples around an exposure may be like
  std::optional<Eigen::Vector3d> gravity_pmr;  ///< direction of gravity, unit length; empty: not known
  double arrow_spacing = 0.003;                ///< between the arrows of /shift/markers [m], 0.0005 ... 0.05
  std::string exclusions;                      ///< YAML file of regions excluded by hand, see readRegions; empty: none
  std::string hand_eye;                        ///< file of calibrate_hand_eye, for what it is off by; empty: not known
  std::string stereo_report;                   ///< report.yaml of calibrate_stereo, for the same; empty: not known
  std::string settings_report;                 ///< settings_report.yaml of calibrate_settings; needs stereo_report
  double track_resolution = 0.0002;            ///< of the projection in live mode [m], 0.00005 ... 0.001
  ShiftSettings shift;

  /// All that the result depends on as text, equal where they are equal; see cortshift_stereo::ParameterWriter.
  std::string effective() const;

  /// All parameters in force as a stage keeps them. @param reconstruction  those of the reconstruction; empty: not
  /// known
  std::string configuration(const std::string& reconstruction) const;

  /// @throws cortshift_stereo::ParameterError naming key, value and what is allowed
  static ShiftTrackerParameters load(const cortshift_stereo::ParameterSource& source);

 private:
  void readResiduals();
};

}  // namespace cortshift_tracking
