#include "cortshift_tracking/ros/parameters.hpp"

#include <cmath>
#include <vector>

#include "cortshift_stereo/ros/parameter_reader.hpp"
#include "cortshift_tracking/case/case_state.hpp"

namespace cortshift_tracking {

ShiftTrackerParameters ShiftTrackerParameters::load(const cortshift_stereo::ParameterSource& source) {
  ShiftTrackerParameters p;
  cortshift_stereo::ParameterReader reader(source);
  reader.choice("case_folder", p.case_folder);
  reader.number("capture_timeout", p.capture_timeout, 0.1, 600.0);
  reader.number("max_surface_age", p.max_surface_age, 0.0, 3600.0);
  reader.number("max_pose_gap", p.max_pose_gap, 0.001, 10.0);
  reader.number("max_speed", p.max_speed, 0.0001, 1.0);
  std::vector<double> gravity;
  reader.numbers("gravity", gravity, 3);
  reader.number("arrow_spacing", p.arrow_spacing, 0.0005, 0.05);

  ShiftSettings& s = p.shift;
  reader.number("resolution", s.frame.resolution, 0.00005, 0.001);
  reader.number("margin", s.frame.margin, 0.0, 0.02);
  reader.number("max_edge_ratio", s.projection.max_edge_ratio, 2.0, 50.0);
  reader.number("fold_tolerance", s.projection.fold_tolerance, 0.0, 0.01);
  reader.choice("channels", s.matching.channels, {"auto", "rgb", "green", "blue", "luminance"});
  reader.number("detail", s.matching.detail, 0.5, 100.0);
  reader.number("bend", s.matching.bend, 0.01, 1000.0);
  reader.number("search", s.matching.search, 0.001, 0.05);
  reader.number("coarse_resolution", s.matching.coarse_resolution, 0.00005, 0.002);
  reader.number("coarse_rounds", s.matching.coarse_rounds, 0, 10);
  std::string inversion = "linear";
  reader.choice("inversion", inversion, {"linear", "nearest"});
  s.inversion.interpolation = inversion == "linear" ? Interpolation::kLinear : Interpolation::kNearest;
  reader.number("min_confidence", s.inversion.min_confidence, 0.0, 1.0);
  reader.number("border", s.trust.border, 0.0, 0.02);
  reader.number("hole_border", s.trust.hole_border, 0.0, 0.02);
  reader.number("glare", s.trust.glare, 0.5, 1.0);
  reader.number("glare_margin", s.trust.glare_margin, 0.0, 0.01);
  reader.number("match_window", s.trust.agreement.window, 0.0005, 0.02);
  reader.number("image_noise", s.trust.agreement.image_noise, 0.0, 0.2);
  reader.flag("own_points", s.with_own_points);
  reader.flag("strain", s.with_strain);
  reader.number("strain_window", s.strain.window, 0.0005, 0.02);
  reader.choice("exclusions", p.exclusions);
  reader.number("track_resolution", p.track_resolution, 0.00005, 0.001);
  int threads = 0;
  reader.number("threads", threads, 0, 64);
  s.setThreads(threads);
  reader.finish();

  if (!gravity.empty()) {
    p.gravity_pmr = unitVector({gravity[0], gravity[1], gravity[2]});
    if (!p.gravity_pmr)
      throw cortshift_stereo::ParameterError(
          "parameter gravity is not a direction; give three numbers in pmr, for instance [0, -1, 0], or none");
  }
  return p;
}

}  // namespace cortshift_tracking
