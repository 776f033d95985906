#include "cortshift_flow_phantom/planar_phantom.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

#include "cortshift_flow_phantom/cortical_texture.hpp"

namespace cortshift_flow_phantom {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kReferenceSide = 768;  // lengths in the settings are given for this shorter side [px]
constexpr double kCoreMargin = 40;      // [px]
constexpr double kPatchRadius = 27;     // [px]
constexpr double kEdge = 0.6;           // half width of the patch's and the rim's soft edge [px]

using Point = cv::Point2d;

double softStep(double signed_distance, double half_width) {
  const double t = std::clamp(0.5 + 0.5 * signed_distance / half_width, 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

/// Where material points go, and where they came from; exact in both directions.
class Deformation {
 public:
  explicit Deformation(const PlanarPhantomSettings& s)
      : centre_(0.5 * (s.size.width - 1), 0.5 * (s.size.height - 1)),
        scale_(std::min(s.size.width, s.size.height) / kReferenceSide),
        radius_(s.rim_radius * scale_),
        radial_(s.motion != Motion::kSmooth),
        everywhere_(!radial_ || s.surround == Surround::kContinuing),
        // Eq. (6) has the factor 2, which gives 37 px at 342 px.
        factor_(s.largest_motion * scale_ / std::sqrt(radius_)),
        amplitude_(s.largest_motion * scale_),
        spread_(s.surround == Surround::kOverlaid ? amplitude_ : 0) {}

  /// Radius of the craniotomy as the undeformed or the deformed image shows it [px].
  double rim(bool deformed) const { return deformed ? radius_ + spread_ : radius_; }
  bool inside(const Point& p, bool deformed) const { return !radial_ || distance(p) < rim(deformed); }
  bool moves(const Point& p, bool deformed) const { return everywhere_ || inside(p, deformed); }
  double distance(const Point& p) const { return std::hypot(p.x - centre_.x, p.y - centre_.y); }
  double radius() const { return radius_; }
  double scale() const { return scale_; }
  Point centre() const { return centre_; }

  Point displacement(const Point& p) const {
    if (radial_) {
      const double d = distance(p);
      return d > 0 ? (p - centre_) * (factor_ / std::sqrt(d)) : Point(0, 0);
    }
    const Point q = (p - centre_) * (2 * kPi / (kReferenceSide * scale_));
    return amplitude_ *
           Point(0.45 + 0.3 * std::sin(0.8 * q.x + 0.5 * q.y + 0.3) + 0.2 * std::cos(1.1 * q.y - 0.4 * q.x),
                 -0.2 + 0.35 * std::cos(0.7 * q.x - 0.9 * q.y) + 0.15 * std::sin(1.3 * q.x + 0.2));
  }

  Point origin(const Point& p) const {
    if (radial_) {
      const double moved = distance(p);
      if (moved == 0) return p;
      const double root = 0.5 * (std::sqrt(factor_ * factor_ + 4 * moved) - factor_);
      return centre_ + (p - centre_) * (root * root / moved);
    }
    Point x = p;  // the field's gradient is well below 1: a contraction
    for (int i = 0; i < 60; ++i) {
      const Point next = p - displacement(x);
      const double step = std::hypot(next.x - x.x, next.y - x.y);
      x = next;
      if (step < 1e-10) break;
    }
    return x;
  }

 private:
  Point centre_;
  double scale_, radius_;
  bool radial_, everywhere_;
  double factor_, amplitude_, spread_;
};

class Scene {
 public:
  explicit Scene(const PlanarPhantomSettings& s)
      : settings_(s), deformation_(s), texture_(textureSettings(s)), patch_centre_(deformation_.centre()) {
    patch_centre_ += Point(-0.42, 0.30) * deformation_.radius();
    blood_centre_ = deformation_.centre() + Point(0.35, -0.25) * deformation_.radius();
    blood_radius_ = std::sqrt(s.blood) * deformation_.radius();
  }

  const Deformation& deformation() const { return deformation_; }

  bool inPatch(const Point& material) const { return settings_.featureless_patch && patchDistance(material) < -kEdge; }
  bool nearPatch(const Point& material) const { return settings_.featureless_patch && patchDistance(material) < 4; }

  /// Distance into the blood (negative outside), in the second image [px].
  double bloodDepth(const Point& p) const {
    const Point q = p - blood_centre_;
    const double angle = std::atan2(q.y, q.x);
    return blood_radius_ * (1 + 0.16 * std::cos(3 * angle + 1) + 0.1 * std::sin(5 * angle)) - std::hypot(q.x, q.y);
  }

  /// Colour at a point of the undeformed or the deformed image.
  cv::Vec3d colour(const Point& p, bool deformed) const {
    const double inside = settings_.motion == Motion::kSmooth || settings_.surround == Surround::kContinuing
                              ? 1.0
                              : softStep(deformation_.rim(deformed) - deformation_.distance(p), kEdge);
    cv::Vec3d result(0, 0, 0);
    if (inside > 0) result += inside * tissue(deformed ? deformation_.origin(p) : p);
    if (inside < 1) result += (1 - inside) * surround(p);
    return result;
  }

  cv::Vec3d withBlood(const cv::Vec3d& under, const Point& p) const {
    const double opacity = softStep(bloodDepth(p), 3.0);
    const Point q = p - blood_centre_;
    const double shade = 1 + 0.12 * std::sin(0.045 * q.x + 0.3) * std::cos(0.06 * q.y);
    return under * (1 - opacity) + cv::Vec3d(0.06, 0.05, 0.38) * shade * opacity;
  }

 private:
  static CorticalTexture::Settings textureSettings(const PlanarPhantomSettings& s) {
    CorticalTexture::Settings texture;
    texture.seed = s.seed;
    texture.half_extent = std::max(texture.half_extent, 0.55 * std::max(s.size.width, s.size.height) * s.pixel_size);
    return texture;
  }

  double patchDistance(const Point& material) const {
    return std::hypot(material.x - patch_centre_.x, material.y - patch_centre_.y) - kPatchRadius * deformation_.scale();
  }

  cv::Vec3d tissue(const Point& material) const {
    const cv::Vec3d colour = textureAt(material);
    if (!settings_.featureless_patch) return colour;
    const double patch = softStep(-patchDistance(material), kEdge);
    return colour * (1 - patch) + cv::Vec3d(1, 1, 1) * patch;
  }

  cv::Vec3d surround(const Point& p) const {
    if (settings_.surround == Surround::kTissue) return textureAt(p);
    // Another place of the same texture, dyed: grain to hold on to, but not the look of tissue.
    const cv::Vec3d grain = textureAt(Point(-p.y, p.x));
    const double grey = (grain[0] + grain[1] + grain[2]) / 3;
    return {0.25 + 0.45 * grey, 0.15 + 0.45 * grey, 0.05 + 0.35 * grey};
  }

  cv::Vec3d textureAt(const Point& p) const {
    const Point q = (p - deformation_.centre()) * settings_.pixel_size;
    return cv::Vec3d(texture_.colour(q.x, q.y));
  }

  PlanarPhantomSettings settings_;
  Deformation deformation_;
  CorticalTexture texture_;
  Point patch_centre_, blood_centre_;
  double blood_radius_ = 0;
};

struct Quadrature {
  std::vector<double> nodes, weights;  // over -0.5...0.5
};

Quadrature gaussLegendre(int points) {
  switch (points) {
    case 1:
      return {{0.0}, {1.0}};
    case 2:
      return {{-0.28867513459481287, 0.28867513459481287}, {0.5, 0.5}};
    case 3:
      return {{-0.3872983346207417, 0.0, 0.3872983346207417}, {5.0 / 18, 8.0 / 18, 5.0 / 18}};
    case 4:
      return {{-0.4305681557970263, -0.16999052179242816, 0.16999052179242816, 0.4305681557970263},
              {0.17392742256872692, 0.32607257743127307, 0.32607257743127307, 0.17392742256872692}};
    case 6:
      return {{-0.4662347571015760, -0.3306046932331323, -0.1193095930415985, 0.1193095930415985, 0.3306046932331323,
               0.4662347571015760},
              {0.0856622461895852, 0.1803807865240693, 0.2339569672863455, 0.2339569672863455, 0.1803807865240693,
               0.0856622461895852}};
    default:
      throw std::invalid_argument("quadrature = " + std::to_string(points) + " is not allowed; 1...4 and 6 are");
  }
}

/// A pixel's value is the mean of the scene over its area: what a sensor integrates.
cv::Mat render(const Scene& scene, const PlanarPhantomSettings& settings, bool deformed, bool bleeding) {
  const Quadrature rule = gaussLegendre(settings.quadrature);
  cv::Mat image(settings.size, CV_32FC3);
  cv::parallel_for_(cv::Range(0, image.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y)
      for (int x = 0; x < image.cols; ++x) {
        cv::Vec3d sum(0, 0, 0);
        for (std::size_t j = 0; j < rule.nodes.size(); ++j)
          for (std::size_t i = 0; i < rule.nodes.size(); ++i) {
            const Point p(x + rule.nodes[i], y + rule.nodes[j]);
            cv::Vec3d colour = scene.colour(p, deformed);
            if (bleeding) colour = scene.withBlood(colour, p);
            sum += rule.weights[i] * rule.weights[j] * colour;
          }
        image.at<cv::Vec3f>(y, x) = cv::Vec3f(sum);
      }
  });
  return image;
}

void disturbBrightness(const PlanarPhantomSettings& s, cv::Mat& image) {
  const Point centre(0.5 * (s.size.width - 1), 0.5 * (s.size.height - 1));
  const double corner = std::hypot(centre.x, centre.y);
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols; ++x) {
      const double r = std::hypot(x - centre.x, y - centre.y) / corner;
      const double gain = s.gain * (1 - s.vignette * r * r);
      cv::Vec3f& value = image.at<cv::Vec3f>(y, x);
      for (int c = 0; c < 3; ++c) value[c] = static_cast<float>(gain * value[c] + s.offset);
    }
}

cv::Mat sensorImage(const PlanarPhantomSettings& s, cv::Mat image, std::uint64_t noise_seed) {
  if (s.noise > 0) {
    cv::RNG random(noise_seed);
    cv::Mat noise(image.size(), CV_32FC3);
    random.fill(noise, cv::RNG::NORMAL, 0.0, s.noise / 255);
    image += noise;
  }
  cv::min(image, 1.0, image);
  cv::max(image, 0.0, image);
  if (s.eight_bit) image.convertTo(image, CV_8U, 255.0);
  return image;
}

void check(const PlanarPhantomSettings& s) {
  const auto require = [](bool good, const char* what) {
    if (!good) throw std::invalid_argument(std::string("planar phantom: ") + what);
  };
  require(s.size.width >= 16 && s.size.height >= 16, "size must be at least 16x16");
  require(s.pixel_size > 0, "pixel_size must be positive");
  require(s.rim_radius > 0 && s.rim_radius < kReferenceSide / 2, "rim_radius must be in 0...384");
  require(s.largest_motion >= 0 && s.largest_motion < 200, "largest_motion must be in 0...200");
  require(s.noise >= 0 && s.vignette >= 0 && s.vignette < 1 && s.gain > 0, "noise, vignette or gain out of range");
  require(s.blood >= 0 && s.blood <= 0.5, "blood must be in 0...0.5");
}

}  // namespace

PlanarPhantom makePlanarPhantom(const PlanarPhantomSettings& settings) {
  check(settings);
  const Scene scene(settings);
  const Deformation& deformation = scene.deformation();
  const bool inward = settings.motion == Motion::kInward;
  const bool bleeding = settings.blood > 0;

  PlanarPhantom phantom;
  cv::Mat first = render(scene, settings, inward, false);
  cv::Mat second = render(scene, settings, !inward, bleeding);
  disturbBrightness(settings, second);
  phantom.first = sensorImage(settings, first, 2ULL * settings.seed + 11);
  phantom.second = sensorImage(settings, second, 2ULL * settings.seed + 12);

  phantom.truth = cv::Mat(settings.size, CV_32FC2, cv::Scalar::all(0));
  for (cv::Mat* mask : {&phantom.craniotomy, &phantom.core, &phantom.patch, &phantom.blood})
    *mask = cv::Mat(settings.size, CV_8UC1, cv::Scalar(0));
  phantom.rim_distance = cv::Mat(settings.size, CV_32FC1, cv::Scalar(0));
  for (int y = 0; y < settings.size.height; ++y)
    for (int x = 0; x < settings.size.width; ++x) {
      const Point p(x, y);
      if (!deformation.moves(p, inward)) continue;
      const Point material = inward ? deformation.origin(p) : p;
      const Point shift = inward ? material - p : deformation.displacement(p);
      phantom.truth.at<cv::Vec2f>(y, x) = cv::Vec2f(static_cast<float>(shift.x), static_cast<float>(shift.y));
      if (!deformation.inside(p, inward)) continue;
      phantom.craniotomy.at<uchar>(y, x) = 255;
      const double to_rim = settings.motion == Motion::kSmooth ? std::min(std::min(x, settings.size.width - 1 - x),
                                                                          std::min(y, settings.size.height - 1 - y))
                                                               : deformation.rim(inward) - deformation.distance(p);
      phantom.rim_distance.at<float>(y, x) = static_cast<float>(to_rim);
      if (scene.inPatch(material)) phantom.patch.at<uchar>(y, x) = 255;
      const bool hidden = bleeding && scene.bloodDepth(p + shift) > -4;
      if (hidden) phantom.blood.at<uchar>(y, x) = 255;
      if (to_rim > kCoreMargin && !hidden && !scene.nearPatch(material)) phantom.core.at<uchar>(y, x) = 255;
    }
  return phantom;
}

}  // namespace cortshift_flow_phantom
