#include "cortshift_tracking/field/exclusion.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "cortshift_tracking/case/stage_key.hpp"
#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {
namespace {

using Corners = std::vector<cv::Point>;

constexpr int kFraction = 6;  // corners in 1/64 of a grid step

Corners cornersOf(const ProjectionFrame& frame, const Region& region) {
  if (region.size() < 3) throw TrackingError("a polygon has fewer than three corners");
  Corners corners;
  for (const cv::Point2d& corner : region) {
    if (!std::isfinite(corner.x) || !std::isfinite(corner.y))
      throw TrackingError("a polygon has a corner that is not a number");
    const auto fixed = [&](double v) {
      return static_cast<int>(std::lround(std::clamp(v / frame.resolution, -1e5, 1e5) * (1 << kFraction)));
    };
    corners.emplace_back(fixed(corner.x), fixed(corner.y));
  }
  return corners;
}

}  // namespace

cv::Mat excludedMask(const ProjectionFrame& frame, const std::vector<Region>& regions) {
  cv::Mat mask = cv::Mat::zeros(frame.size, CV_8UC1);
  for (const Region& region : regions)
    cv::fillPoly(mask, std::vector<Corners>{cornersOf(frame, region)}, 255, cv::LINE_8, kFraction);
  return mask;
}

cv::Mat outlinedMask(const ProjectionFrame& frame, const std::vector<Region>& outlines) {
  cv::Mat mask = cv::Mat::zeros(frame.size, CV_8UC1);
  std::vector<Corners> all;
  for (const Region& outline : outlines) all.push_back(cornersOf(frame, outline));
  if (!all.empty()) cv::fillPoly(mask, all, 255, cv::LINE_8, kFraction);  // by parity
  return mask;
}

std::map<std::string, std::vector<Region>> readRegions(const std::string& path) {
  try {
    std::map<std::string, std::vector<Region>> regions;
    const YAML::Node file = YAML::LoadFile(path);
    if (!file.IsMap()) throw TrackingError("it is not a mapping of stage keys to polygons");
    for (const auto& entry : file) {
      const auto key = entry.first.as<std::string>();
      requireKey(key);
      for (const YAML::Node& polygon : entry.second) {
        Region region;
        for (const YAML::Node& corner : polygon) {
          const auto xy = corner.as<std::vector<double>>();
          if (xy.size() != 2) throw TrackingError("a corner of '" + key + "' is not [x, y]");
          region.emplace_back(xy[0], xy[1]);
        }
        if (region.size() < 3) throw TrackingError("a polygon of '" + key + "' has fewer than three corners");
        regions[key].push_back(region);
      }
    }
    return regions;
  } catch (const std::exception& error) {
    throw TrackingError("excluded regions of " + path + ": " + error.what() +
                        "; expected is KEY: [[[x, y], [x, y], [x, y]], ...] in metres of the projection frame");
  }
}

}  // namespace cortshift_tracking
