#include "cortshift_stereo/calibration/settings/settings_calibration.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <set>

#include "calibration/convex_hull.hpp"
#include "calibration/outliers.hpp"

namespace cortshift_stereo {
namespace {

constexpr int kHighestImageDegree = 5;
constexpr int kHighestSettingDegree = 4;
constexpr double kOutlierFloorPx = 0.5;
constexpr double kWorthATerm = 1.02;  // a simpler field may be this much worse on held-out settings
constexpr double kRidge = 1e-9;       // added to the normal equations: terms that no view determines stay 0

/// How many terms a field has.
struct Degrees {
  int image = 1;
  int magnification = 1;
  int focal_length = 1;
};

std::vector<std::pair<int, int>> imagePowers(int degree) {
  std::vector<std::pair<int, int>> powers;
  for (int total = 0; total <= degree; ++total)
    for (int y = 0; y <= total; ++y) powers.emplace_back(total - y, y);
  return powers;
}

std::vector<std::pair<int, int>> settingPowers(const Degrees& degrees) {
  std::vector<std::pair<int, int>> powers;
  for (int m = 0; m <= degrees.magnification; ++m)
    for (int n = 0; n <= degrees.focal_length; ++n)
      if (m + n > 0 && m + n <= std::max(degrees.magnification, degrees.focal_length)) powers.emplace_back(m, n);
  return powers;
}

Eigen::MatrixXd terms(const std::vector<cv::Point2d>& points, const std::vector<std::pair<int, int>>& powers) {
  Eigen::MatrixXd matrix(points.size(), powers.size());
  for (std::size_t i = 0; i < points.size(); ++i)
    for (std::size_t k = 0; k < powers.size(); ++k)
      matrix(i, k) = std::pow(points[i].x, powers[k].first) * std::pow(points[i].y, powers[k].second);
  return matrix;
}

/// The matrix that makes the terms orthonormal over the points, so that the equations are well conditioned.
Eigen::MatrixXd orthonormaliser(const Eigen::MatrixXd& values) {
  const Eigen::LLT<Eigen::MatrixXd> cholesky(values.transpose() * values);
  return cholesky.matrixU().solve(Eigen::MatrixXd::Identity(values.cols(), values.cols()));
}

double radiusOf(const Corners& corners) {
  cv::Point2d mean(0, 0);
  for (const auto& corner : corners) mean += corner / static_cast<double>(corners.size());
  double squares = 0;
  for (const auto& corner : corners) squares += (corner - mean).dot(corner - mean);
  return std::sqrt(squares / static_cast<double>(corners.size()));
}

/// Where the coordinates of all fields are measured from, and in which units.
WarpModel frameOf(const cv::Size& size, const MicroscopeSetting& reference, const std::vector<SettingView>& views) {
  WarpModel frame;
  frame.size = size;
  frame.reference = reference;
  frame.calibrated.push_back(reference);
  std::vector<cv::Point2d> points;
  for (const auto& view : views) {
    frame.calibrated.push_back(view.setting);
    points.insert(points.end(), view.at_reference.begin(), view.at_reference.end());
  }
  frame.setting_scale = {1, 1};
  cv::Point2d largest(0, 0);
  for (const auto& setting : frame.calibrated) {
    const cv::Point2d difference = frame.scaled(setting);
    largest = {std::max(largest.x, std::abs(difference.x)), std::max(largest.y, std::abs(difference.y))};
  }
  frame.setting_scale = {largest.x > 0 ? largest.x : 1, largest.y > 0 ? largest.y : 1};
  frame.region = convexHull(std::move(points));
  for (const auto& point : frame.region) frame.centre += point / static_cast<double>(frame.region.size());
  for (const auto& point : frame.region) frame.radius = std::max(frame.radius, cv::norm(point - frame.centre));
  return frame;
}

/// Least squares for the coefficients of one choice of degrees. The normal equations are sums over views of Kronecker
/// products, so that views can be left out cheaply.
class FieldFit {
 public:
  FieldFit(WarpModel frame, const std::vector<SettingView>& views, const Degrees& degrees) : model_(std::move(frame)) {
    model_.image_powers = imagePowers(degrees.image);
    model_.setting_powers = settingPowers(degrees);
    std::vector<cv::Point2d> all_points, settings;
    std::vector<std::vector<cv::Point2d>> points;
    for (const auto& view : views) {
      settings.push_back(model_.scaled(view.setting));
      points.emplace_back();
      for (const auto& corner : view.at_reference) points.back().push_back((corner - model_.centre) / model_.radius);
      all_points.insert(all_points.end(), points.back().begin(), points.back().end());
    }
    image_basis_ = orthonormaliser(terms(all_points, model_.image_powers)) * std::sqrt(all_points.size());
    setting_basis_ = orthonormaliser(terms(settings, model_.setting_powers)) * std::sqrt(settings.size());
    const Eigen::MatrixXd setting_terms = terms(settings, model_.setting_powers) * setting_basis_;
    for (std::size_t v = 0; v < views.size(); ++v) {
      const Eigen::MatrixXd image_terms = terms(points[v], model_.image_powers) * image_basis_;
      Eigen::MatrixXd displacements(views[v].at_setting.size(), 2);
      for (std::size_t i = 0; i < views[v].at_setting.size(); ++i) {
        const cv::Point2d moved = views[v].at_setting[i] - views[v].at_reference[i];
        displacements.row(static_cast<Eigen::Index>(i)) << moved.x, moved.y;
      }
      squares_.push_back(image_terms.transpose() * image_terms);
      products_.push_back(image_terms.transpose() * displacements);
      settings_.push_back(setting_terms.row(static_cast<Eigen::Index>(v)));
    }
  }

  std::size_t parameters() const { return model_.image_powers.size() * model_.setting_powers.size(); }

  /// The field of all views but those to leave out.
  SettingsWarp solve(const std::set<std::size_t>& left_out) const {
    const Eigen::Index image = image_basis_.cols(), setting = setting_basis_.cols();
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(image * setting, image * setting);
    Eigen::MatrixXd right = Eigen::MatrixXd::Zero(image * setting, 2);
    for (std::size_t v = 0; v < squares_.size(); ++v) {
      if (left_out.count(v)) continue;
      for (Eigen::Index j = 0; j < setting; ++j) {
        right.middleRows(j * image, image) += settings_[v](j) * products_[v];
        for (Eigen::Index i = 0; i < setting; ++i)
          normal.block(j * image, i * image, image, image) += settings_[v](j) * settings_[v](i) * squares_[v];
      }
    }
    normal.diagonal().array() += kRidge * normal.trace() / static_cast<double>(normal.rows());
    const Eigen::MatrixXd solution = normal.ldlt().solve(right);
    WarpModel model = model_;
    model.coefficients.assign(parameters(), cv::Vec2d(0, 0));
    for (int axis = 0; axis < 2; ++axis) {
      Eigen::MatrixXd orthonormal(image, setting);
      for (Eigen::Index j = 0; j < setting; ++j) orthonormal.col(j) = solution.col(axis).segment(j * image, image);
      const Eigen::MatrixXd plain = image_basis_ * orthonormal * setting_basis_.transpose();
      for (Eigen::Index k = 0; k < image; ++k)
        for (Eigen::Index j = 0; j < setting; ++j)
          model.coefficients[static_cast<std::size_t>(k * setting + j)][axis] = plain(k, j);
    }
    return SettingsWarp(std::move(model));
  }

 private:
  WarpModel model_;
  Eigen::MatrixXd image_basis_, setting_basis_;
  std::vector<Eigen::MatrixXd> squares_, products_;
  std::vector<Eigen::RowVectorXd> settings_;
};

double rmsOf(const SettingsWarp& warp, const SettingView& view) {
  double squares = 0;
  for (std::size_t i = 0; i < view.at_setting.size(); ++i) {
    const cv::Point2d miss = warp.toSetting(view.at_reference[i], view.setting) - view.at_setting[i];
    squares += miss.dot(miss);
  }
  return std::sqrt(squares / static_cast<double>(view.at_setting.size()));
}

/// Views by setting, and for each setting whether the others surround it.
struct SettingGroup {
  std::set<std::size_t> views;
  bool surrounded = false;
};

std::vector<SettingGroup> groupBySetting(const WarpModel& frame, const std::vector<SettingView>& views) {
  std::map<std::pair<double, double>, SettingGroup> groups;
  for (std::size_t v = 0; v < views.size(); ++v)
    groups[{views[v].setting.magnification, views[v].setting.focal_length}].views.insert(v);
  groups.erase({frame.reference.magnification, frame.reference.focal_length});  // the field is zero there by its form
  std::vector<SettingGroup> list;
  for (auto& [setting, group] : groups) {
    std::vector<cv::Point2d> others;
    for (const auto& other : frame.calibrated)
      if (std::make_pair(other.magnification, other.focal_length) != setting) others.push_back(frame.scaled(other));
    constexpr double kOnTheLine = 1e-9;
    group.surrounded = insideHull(convexHull(others), frame.scaled({setting.first, setting.second}), kOnTheLine);
    list.push_back(group);
  }
  return list;
}

/// Error of each view in reference pixels when its setting is left out; NaN for settings that the others do not
/// surround, since there the field would have to be extrapolated.
std::vector<double> heldOutErrors(const FieldFit& fit, const std::vector<SettingView>& views,
                                  const std::vector<SettingGroup>& groups) {
  std::vector<double> errors(views.size(), std::numeric_limits<double>::quiet_NaN());
  for (const auto& group : groups) {
    if (!group.surrounded) continue;
    const SettingsWarp warp = fit.solve(group.views);
    for (const std::size_t v : group.views)
      errors[v] = rmsOf(warp, views[v]) * radiusOf(views[v].at_reference) / radiusOf(views[v].at_setting);
  }
  return errors;
}

double rmsOfFinite(const std::vector<double>& values) {
  double squares = 0;
  int count = 0;
  for (const double value : values)
    if (!std::isnan(value)) {
      squares += value * value;
      ++count;
    }
  return count ? std::sqrt(squares / count) : std::numeric_limits<double>::infinity();
}

/// Degrees with few terms and little error on held-out settings: first in the image, then in the settings.
Degrees chooseDegrees(const WarpModel& frame, const std::vector<SettingView>& views) {
  std::set<double> magnifications, focal_lengths;
  for (const auto& setting : frame.calibrated) {
    magnifications.insert(setting.magnification);
    focal_lengths.insert(setting.focal_length);
  }
  const auto highest = [](std::size_t settings) {
    return std::min(static_cast<int>(settings) - 1, kHighestSettingDegree);
  };
  Degrees most{kHighestImageDegree, highest(magnifications.size()), highest(focal_lengths.size())};
  const auto groups = groupBySetting(frame, views);
  std::size_t corners = std::numeric_limits<std::size_t>::max();
  for (const auto& view : views) corners = std::min(corners, view.at_setting.size());
  while (most.image > 1 && 2 * imagePowers(most.image).size() > corners) --most.image;

  // One setting more than terms, so that the terms are determined when a setting is left out.
  const auto tooMany = [&](const Degrees& degrees) { return settingPowers(degrees).size() >= groups.size(); };

  struct Tried {
    Degrees degrees;
    std::size_t parameters;
    double error;
  };
  std::vector<Tried> tried;
  const auto attempt = [&](const Degrees& degrees) {
    if (tooMany(degrees)) return;
    const FieldFit fit(frame, views, degrees);
    tried.push_back({degrees, fit.parameters(), rmsOfFinite(heldOutErrors(fit, views, groups))});
  };
  const auto simplest = [&] {
    double best = std::numeric_limits<double>::infinity();
    for (const auto& one : tried) best = std::min(best, one.error);
    const Tried* chosen = nullptr;
    for (const auto& one : tried)
      if (one.error <= kWorthATerm * best && (!chosen || one.parameters < chosen->parameters)) chosen = &one;
    if (!chosen || !std::isfinite(best))
      throw CalibrationError(
          "no setting lies between others, so nothing can be checked; take a grid of at least 3 magnifications or 3 "
          "focal lengths");
    return chosen->degrees;
  };
  while (tooMany(most) && most.magnification + most.focal_length > 2)
    --(most.magnification >= most.focal_length ? most.magnification : most.focal_length);
  for (int image = 1; image <= most.image; ++image) attempt({image, most.magnification, most.focal_length});
  const int image = simplest().image;
  tried.clear();
  for (int m = std::min(1, most.magnification); m <= most.magnification; ++m)
    for (int n = std::min(1, most.focal_length); n <= most.focal_length; ++n) attempt({image, m, n});
  return simplest();
}

void requirePairs(const std::vector<SettingView>& views) {
  for (const auto& view : views) {
    if (view.at_setting.size() != view.at_reference.size() || view.at_setting.size() < 9)
      throw CalibrationError(view.name + ": " + std::to_string(view.at_setting.size()) +
                             " corners at the setting and " + std::to_string(view.at_reference.size()) +
                             " at the reference; both need the whole board, at least 9 corners");
    if (!(view.setting.magnification > 0) || !(view.setting.focal_length > 0))
      throw CalibrationError(view.name + ": " + describe(view.setting) + " is not a setting; both must be positive");
  }
  if (views.empty()) throw CalibrationError("no views at settings other than the reference; take a grid of settings");
}

}  // namespace

SettingsCalibration calibrateSettings(const cv::Size& size, const MicroscopeSetting& reference,
                                      const std::vector<SettingView>& views) {
  requirePairs(views);
  auto used = views;
  std::vector<RejectedView> rejected;
  while (true) {
    const WarpModel frame = frameOf(size, reference, used);
    const Degrees degrees = chooseDegrees(frame, used);
    const FieldFit fit(frame, used, degrees);
    SettingsCalibration result{
        fit.solve({}), degrees.image, {degrees.magnification, degrees.focal_length}, 0, 0, {}, {}};
    const auto held_out = heldOutErrors(fit, used, groupBySetting(frame, used));
    std::vector<double> errors, suspicion;
    for (std::size_t v = 0; v < used.size(); ++v) {
      errors.push_back(rmsOf(result.warp, used[v]));
      suspicion.push_back(std::isnan(held_out[v]) ? errors[v] : held_out[v]);
      result.residuals.push_back({used[v].name, used[v].setting, errors[v], held_out[v]});
    }
    if (const auto worst = findOutlier(suspicion, kOutlierFloorPx)) {
      char error[32];
      std::snprintf(error, sizeof error, "%.2f", suspicion[*worst]);
      rejected.push_back({used[*worst].name, std::string("it disagrees with the other views by ") + error +
                                                 " px; did the board move, or is the setting not the one named?"});
      used.erase(used.begin() + static_cast<std::ptrdiff_t>(*worst));
      requirePairs(used);
      continue;
    }
    result.rms = rmsOfFinite(errors);
    result.held_out_rms = rmsOfFinite(held_out);
    result.rejected = rejected;
    if (!(result.held_out_rms <= kLargestHeldOutRms)) {
      char error[32];
      std::snprintf(error, sizeof error, "%.2f", result.held_out_rms);
      throw CalibrationError(std::string("the deformation field misses held-out settings by ") + error +
                             " px; take a denser grid of settings, and check that the board never moved");
    }
    return result;
  }
}

}  // namespace cortshift_stereo
