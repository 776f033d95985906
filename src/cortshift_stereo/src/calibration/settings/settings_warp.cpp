#include "cortshift_stereo/calibration/settings/settings_warp.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <stdexcept>

#include "calibration/convex_hull.hpp"
#include "calibration/yaml_file.hpp"

namespace cortshift_stereo {
namespace {

constexpr double kHullTolerance = 1e-6;  // in units of the calibrated range: what a decimal in a file may lose
constexpr int kHighestPower = 8;

/// base^0 ... base^kHighestPower
std::array<double, kHighestPower + 1> powersOf(double base) {
  std::array<double, kHighestPower + 1> powers{};
  powers[0] = 1;
  for (std::size_t i = 1; i < powers.size(); ++i) powers[i] = powers[i - 1] * base;
  return powers;
}

bool possible(const MicroscopeSetting& setting) {
  return std::isfinite(setting.magnification) && std::isfinite(setting.focal_length) && setting.focal_length > 0;
}

void validatePowers(const std::vector<std::pair<int, int>>& powers, const char* what) {
  for (const auto& [a, b] : powers)
    if (a < 0 || b < 0 || a > kHighestPower || b > kHighestPower)
      throw CalibrationError(std::string("deformation field: ") + what + " hold a power outside 0 to " +
                             std::to_string(kHighestPower) + "; calibrate again");
}

}  // namespace

bool MicroscopeSetting::possible() const {
  return std::isfinite(magnification) && magnification > 0 && std::isfinite(focal_length) && focal_length > 0;
}

std::string describe(const MicroscopeSetting& setting) {
  std::ostringstream text;
  text << "magnification " << setting.magnification << ", focal length " << setting.focal_length * 1e3 << " mm";
  return text.str();
}

cv::Point2d WarpModel::scaled(const MicroscopeSetting& setting) const {
  return {(setting.magnification - reference.magnification) / setting_scale.x,
          (1 / setting.focal_length - 1 / reference.focal_length) / setting_scale.y};
}

void WarpModel::validate() const {
  if (size.width <= 0 || size.height <= 0)
    throw CalibrationError("deformation field: the image size is not positive; calibrate again");
  if (!(radius > 0) || !(setting_scale.x > 0) || !(setting_scale.y > 0) || !possible(reference))
    throw CalibrationError("deformation field: radius, scale or reference is not a positive number; calibrate again");
  validatePowers(image_powers, "image_powers");
  validatePowers(setting_powers, "setting_powers");
  for (const auto& [m, n] : setting_powers)
    if (m + n == 0) throw CalibrationError("deformation field: it does not vanish at the reference; calibrate again");
  if (coefficients.size() != image_powers.size() * setting_powers.size())
    throw CalibrationError("deformation field: " + std::to_string(coefficients.size()) + " coefficients for " +
                           std::to_string(image_powers.size()) + " x " + std::to_string(setting_powers.size()) +
                           " powers; calibrate again");
  if (calibrated.empty() || !std::all_of(calibrated.begin(), calibrated.end(), possible) || region.size() < 3)
    throw CalibrationError("deformation field: no calibrated settings or region; calibrate again");
}

SettingsWarp::SettingsWarp(WarpModel model) : model_(std::move(model)) {
  model_.validate();
  std::vector<cv::Point2d> points;
  for (const auto& setting : model_.calibrated) points.push_back(model_.scaled(setting));
  hull_ = convexHull(std::move(points));
}

bool SettingsWarp::covers(const MicroscopeSetting& setting) const {
  return possible(setting) && insideHull(hull_, model_.scaled(setting), kHullTolerance);
}

std::string SettingsWarp::calibratedRange() const {
  MicroscopeSetting low = model_.calibrated.front(), high = low;
  for (const auto& setting : model_.calibrated) {
    low.magnification = std::min(low.magnification, setting.magnification);
    low.focal_length = std::min(low.focal_length, setting.focal_length);
    high.magnification = std::max(high.magnification, setting.magnification);
    high.focal_length = std::max(high.focal_length, setting.focal_length);
  }
  std::ostringstream text;
  text << "magnification " << low.magnification << " to " << high.magnification << ", focal length "
       << low.focal_length * 1e3 << " to " << high.focal_length * 1e3 << " mm";
  return text.str();
}

void SettingsWarp::requireCovered(const MicroscopeSetting& setting) const {
  if (covers(setting)) return;
  throw SettingNotCalibrated(describe(setting) + " is outside the calibrated settings (" + calibratedRange() +
                             "); turn the microscope back or calibrate there");
}

std::vector<cv::Vec2d> SettingsWarp::fieldAt(const MicroscopeSetting& setting) const {
  requireCovered(setting);
  const cv::Point2d at = model_.scaled(setting);
  const auto s = powersOf(at.x), t = powersOf(at.y);
  std::vector<cv::Vec2d> field(model_.image_powers.size(), cv::Vec2d(0, 0));
  for (std::size_t k = 0; k < field.size(); ++k)
    for (std::size_t j = 0; j < model_.setting_powers.size(); ++j)
      field[k] += s[model_.setting_powers[j].first] * t[model_.setting_powers[j].second] *
                  model_.coefficients[k * model_.setting_powers.size() + j];
  return field;
}

cv::Vec2d SettingsWarp::displacement(const std::vector<cv::Vec2d>& field, const cv::Point2d& at_reference) const {
  const auto x = powersOf((at_reference.x - model_.centre.x) / model_.radius);
  const auto y = powersOf((at_reference.y - model_.centre.y) / model_.radius);
  cv::Vec2d sum(0, 0);
  for (std::size_t k = 0; k < field.size(); ++k)
    sum += x[model_.image_powers[k].first] * y[model_.image_powers[k].second] * field[k];
  return sum;
}

cv::Point2d SettingsWarp::toSetting(const cv::Point2d& at_reference, const MicroscopeSetting& setting) const {
  return at_reference + cv::Point2d(displacement(fieldAt(setting), at_reference));
}

cv::Point2d SettingsWarp::toReference(const cv::Point2d& at_setting, const MicroscopeSetting& setting) const {
  const auto field = fieldAt(setting);
  const auto miss = [&](const cv::Point2d& guess) {
    return guess + cv::Point2d(displacement(field, guess)) - at_setting;
  };
  // Newton's method; the field is close to a change of scale, so it settles in a few steps from anywhere.
  cv::Point2d guess = model_.centre;
  constexpr int kMostSteps = 30;
  constexpr double kClose = 1e-9;  // [px]
  for (int i = 0; i < kMostSteps; ++i) {
    const cv::Point2d here = miss(guess);
    if (cv::norm(here) < kClose) return guess;
    constexpr double kStep = 1e-3;  // [px]
    const cv::Point2d dx = (miss(guess + cv::Point2d(kStep, 0)) - miss(guess - cv::Point2d(kStep, 0))) / (2 * kStep);
    const cv::Point2d dy = (miss(guess + cv::Point2d(0, kStep)) - miss(guess - cv::Point2d(0, kStep))) / (2 * kStep);
    const double determinant = dx.cross(dy);
    guess -= cv::Point2d(here.cross(dy) / determinant, dx.cross(here) / determinant);
  }
  std::ostringstream place;
  place << at_setting;
  throw CalibrationError("pixel " + place.str() + " at " + describe(setting) +
                         " is outside what the deformation field can carry back to the reference");
}

cv::Mat SettingsWarp::compose(const cv::Mat& map_to_reference, const MicroscopeSetting& setting) const {
  if (map_to_reference.type() != CV_32FC2)
    throw std::invalid_argument("SettingsWarp::compose: the map must be CV_32FC2 (x and y in one matrix)");
  const auto field = fieldAt(setting);
  const std::vector<cv::Point2f> region(model_.region.begin(), model_.region.end());
  cv::Mat map(map_to_reference.size(), CV_32FC2);
  cv::parallel_for_(cv::Range(0, map.rows), [&](const cv::Range& rows) {
    for (int row = rows.start; row < rows.end; ++row)
      for (int column = 0; column < map.cols; ++column) {
        const auto& at = map_to_reference.at<cv::Point2f>(row, column);
        const bool calibrated = cv::pointPolygonTest(region, at, false) >= 0;
        map.at<cv::Point2f>(row, column) =
            calibrated ? at + cv::Point2f(cv::Point2d(displacement(field, at))) : cv::Point2f(-1, -1);
      }
  });
  return map;
}

SettingsWarp readSettingsWarp(const std::string& path) {
  const YAML::Node root = loadYamlFile(path);
  const auto pairs = [&](const std::string& key) {
    const auto numbers = requiredNumbers(root, key, path);
    if (numbers.size() % 2) throw CalibrationError(path + ": " + key + " must hold pairs of numbers; calibrate again");
    std::vector<cv::Point2d> points;
    for (std::size_t i = 0; i < numbers.size(); i += 2) points.emplace_back(numbers[i], numbers[i + 1]);
    return points;
  };
  const auto one = [&](const std::string& key) {
    const auto points = pairs(key);
    if (points.size() != 1) throw CalibrationError(path + ": " + key + " must hold two numbers; calibrate again");
    return points.front();
  };
  const auto powers = [&](const std::string& key) {
    std::vector<std::pair<int, int>> list;
    for (const auto& point : pairs(key)) list.emplace_back(cvRound(point.x), cvRound(point.y));
    return list;
  };
  WarpModel model;
  const cv::Point2d size = one("image_size"), reference = one("reference");
  model.size = {cvRound(size.x), cvRound(size.y)};
  model.reference = {reference.x, reference.y};
  model.setting_scale = one("setting_scale");
  model.centre = one("centre");
  model.radius = requiredNumber(root, "radius", path);
  model.image_powers = powers("image_powers");
  model.setting_powers = powers("setting_powers");
  for (const auto& point : pairs("coefficients")) model.coefficients.emplace_back(point.x, point.y);
  for (const auto& point : pairs("calibrated")) model.calibrated.push_back({point.x, point.y});
  model.region = pairs("region");
  try {
    return SettingsWarp(std::move(model));
  } catch (const CalibrationError& fault) {
    throw CalibrationError(path + ": " + fault.what());
  }
}

void writeSettingsWarp(const std::string& path, const SettingsWarp& warp, const std::string& remarks) {
  const WarpModel& model = warp.model();
  const auto settings = [](const std::vector<MicroscopeSetting>& list) {
    std::vector<double> numbers;
    for (const auto& setting : list) {
      numbers.push_back(setting.magnification);
      numbers.push_back(setting.focal_length);
    }
    return exactText(numbers);
  };
  const auto powers = [](const std::vector<std::pair<int, int>>& list) {
    std::vector<double> numbers;
    for (const auto& [a, b] : list) {
      numbers.push_back(a);
      numbers.push_back(b);
    }
    return exactText(numbers);
  };
  std::vector<double> coefficients, region;
  for (const auto& c : model.coefficients) {
    coefficients.push_back(c[0]);
    coefficients.push_back(c[1]);
  }
  for (const auto& p : model.region) {
    region.push_back(p.x);
    region.push_back(p.y);
  }
  std::ostringstream text;
  std::istringstream lines(remarks);
  for (std::string line; std::getline(lines, line);) text << "# " << line << "\n";
  text << "image_size: [" << model.size.width << ", " << model.size.height << "]\n"
       << "# settings: magnification, focal length [m]; their scale: magnification, 1 / focal length [1/m]\n"
       << "reference: " << settings({model.reference})
       << "\nsetting_scale: " << exactText({model.setting_scale.x, model.setting_scale.y})
       << "\ncalibrated: " << settings(model.calibrated) << "\n# reference image [px]\n"
       << "centre: " << exactText({model.centre.x, model.centre.y}) << "\nradius: " << exactText(model.radius)
       << "\nregion: " << exactText(region) << "\n# polynomial: x, y pairs, all setting powers of each image power\n"
       << "image_powers: " << powers(model.image_powers) << "\nsetting_powers: " << powers(model.setting_powers)
       << "\ncoefficients: " << exactText(coefficients) << "\n";
  writeTextFile(path, text.str());
}

}  // namespace cortshift_stereo
