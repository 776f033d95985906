#include "cortshift_stereo_phantom/phantom_mr.hpp"

#include <cmath>
#include <cstring>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>
#include <sstream>
#include <stdexcept>

#include "random.hpp"
#include "smooth_step.hpp"

namespace cortshift_stereo_phantom {
namespace {

// Intensities of a contrast-enhanced T1-weighted scan.
constexpr double kAir = 2, kSkull = 18, kCsf = 25, kDura = 70, kGrey = 100, kWhite = 150, kFat = 190, kVessel = 255;
constexpr double kTumourCore = 60, kTumourRim = 210;
// Layers above the cortex, from inside out [m].
constexpr double kCsfTop = 0.0022, kDuraTop = 0.0032, kSkullTop = 0.0095, kScalpTop = 0.0145;
constexpr double kCorticalThickness = 0.0028;  // of grey matter on the crowns [m]
constexpr double kSulcalDepth = 0.0090;        // how much deeper white matter begins under a sulcus [m]
constexpr double kClosing = 0.018;             // outside the rim the dome passes into a ball over this width [m]
constexpr double kTableStep = 0.0001;          // of the tables over the brain's plane [m]
constexpr double kTumourDepth = 0.024;         // of its middle below that of the craniotomy [m]
constexpr double kTumourRimWidth = 0.002;      // where contrast agent gathers [m]
constexpr double kSmallestTumour = 0.003, kLargestTumour = 0.015;  // radius [m]: it lies in white matter
constexpr double kSmallest = 0.0001, kLargest = 0.002;             // voxel [m]
constexpr int kMostVoxels = 800;                                   // a side of the volume: 1 GB
constexpr double kSmallestSide = 0.02, kLargestSide = 0.3;         // of the volume [m]

double fromTumour(const Eigen::Vector3d& p) { return (p + Eigen::Vector3d(0, 0, kTumourDepth)).norm(); }

/// The undeformed cortex over the brain's plane, tabulated: closed forms cost too much for millions of samples.
class Cortex {
 public:
  Cortex(const PhantomScene& scene, double tumour)
      : tumour_(tumour),
        radius_(scene.description().head.dome_radius),
        half_(0.98 * radius_),
        count_(2 * static_cast<int>(std::ceil(half_ / kTableStep)) + 1) {
    const cortshift_flow_phantom::CorticalTexture& texture = scene.texture();
    const double sulcus_depth = scene.description().head.sulcus_depth;
    table_.create(count_, count_, CV_32FC4);
    cv::parallel_for_(cv::Range(0, count_), [&](const cv::Range& range) {
      for (int row = range.start; row < range.end; ++row)
        for (int column = 0; column < count_; ++column) {
          const double x = column * kTableStep - half_, y = row * kTableStep - half_;
          const double outwards = std::max(0.0, -scene.rimDistance(x, y));
          const cortshift_flow_phantom::Relief relief = texture.relief(x, y);
          const double dome = radius_ - std::sqrt(radius_ * radius_ + x * x + y * y);
          double below_dome, closing = 0;
          if (outwards <= 0) {
            below_dome = scene.sample(PhantomScene::kUndeformed, x, y).point.z() - dome;
          } else {  // the bone of the phantom is not there yet: the cortex goes on below the skull
            constexpr double kReliefFade = 0.004;
            below_dome = relief.height * smoothStep(outwards / kReliefFade);
            closing = smoothStep(outwards / kClosing);
          }
          const double valley = sulcus_depth > 0 ? -relief.height / sulcus_depth : 0;
          table_.at<cv::Vec4f>(row, column) = {static_cast<float>(below_dome), static_cast<float>(closing),
                                               static_cast<float>(valley),
                                               static_cast<float>(texture.vesselHalfThickness(x, y))};
        }
    });
  }

  /// Intensity at a point of the brain frame [m].
  double intensity(const Eigen::Vector3d& p) const {
    const double in_tumour = tumour_ - fromTumour(p);
    if (in_tumour > 0) return in_tumour < kTumourRimWidth ? kTumourRim : kTumourCore;
    const Place place = at(p);
    if (place.above_dome > kScalpTop) return kAir;
    if (place.above_dome > kSkullTop) return kFat;
    if (place.above_dome > kDuraTop) return kSkull;
    if (place.above_dome > kCsfTop) return kDura;
    if (place.above_cortex > 0) return kCsf;  // in the sulci too
    if (-place.above_cortex < 2 * place.vessel) return kVessel;
    const double grey = kCorticalThickness + kSulcalDepth * place.valley;
    // White matter begins softly, as in a real scan.
    return kGrey + (kWhite - kGrey) * smoothStep((-place.above_cortex - grey) / 0.0015 + 0.5);
  }

  /// Whether tissues may meet within about `reach` [m] of a point of the brain frame.
  bool mayMeet(const Eigen::Vector3d& p, double reach) const {
    const double in_tumour = tumour_ - fromTumour(p);
    if (tumour_ > 0 && in_tumour > -reach && in_tumour < kTumourRimWidth + reach) return true;
    const Place place = at(p);
    for (const double top : {kScalpTop, kSkullTop, kDuraTop, kCsfTop})
      if (std::abs(place.above_dome - top) < reach) return true;
    // Vessels and the walls of sulci lie just below the crowns.
    return place.above_dome < reach && place.above_dome > -0.004 - reach;
  }

 private:
  struct Place {
    double above_dome;    // above the smooth dome over the gyral crowns [m]
    double above_cortex;  // above the cortex, to first order [m]
    double valley;        // 0 on the crowns ... 1 in the sulci
    double vessel;        // half thickness [m]
  };

  Place at(const Eigen::Vector3d& p) const {
    const double ball = (p + Eigen::Vector3d(0, 0, radius_)).norm() - radius_;
    const double u = (p.x() + half_) / kTableStep, v = (p.y() + half_) / kTableStep;
    const int column = static_cast<int>(std::floor(u)), row = static_cast<int>(std::floor(v));
    if (column < 0 || row < 0 || column + 1 >= count_ || row + 1 >= count_ || p.z() < -0.8 * radius_)
      return {ball, ball, 0, 0};
    const double a = u - column, b = v - row;
    const cv::Vec4d p00 = table_.at<cv::Vec4f>(row, column), p01 = table_.at<cv::Vec4f>(row, column + 1),
                    p10 = table_.at<cv::Vec4f>(row + 1, column), p11 = table_.at<cv::Vec4f>(row + 1, column + 1);
    const cv::Vec4d value = (1 - b) * ((1 - a) * p00 + a * p01) + b * ((1 - a) * p10 + a * p11);
    const double root = std::sqrt(radius_ * radius_ + p.x() * p.x() + p.y() * p.y());
    const double height = p.z() - (radius_ - root);  // over the hyperboloid
    const double x_slope = -p.x() / root, y_slope = -p.y() / root;
    const double sx = x_slope + (p01[0] - p00[0]) / kTableStep, sy = y_slope + (p10[0] - p00[0]) / kTableStep;
    const double dome = height / std::sqrt(1 + x_slope * x_slope + y_slope * y_slope);
    const double cortex = (height - value[0]) / std::sqrt(1 + sx * sx + sy * sy);
    const double closing = value[1];
    return {(1 - closing) * dome + closing * ball, (1 - closing) * cortex + closing * ball, value[2], value[3]};
  }

  double tumour_;  // radius [m]; 0: none
  double radius_, half_;
  int count_;
  cv::Mat table_;  // CV_32FC4: height over the hyperboloid [m], share of the ball, valley 0...1, half thickness of the
                   // vessel [m]
};

/// The grid of a volume, its voxels 0.
MrVolume emptyVolume(const PhantomScene& scene, const MrSettings& settings) {
  settings.validate();
  const double ball = scene.description().head.dome_radius;
  const bool whole = settings.side == 0;
  const Eigen::Vector3d centre = scene.description().T_pmr_brain * Eigen::Vector3d(0, 0, whole ? -ball : 0);
  const double reach = whole ? ball + kScalpTop + 0.004 : settings.side / 2;
  const int n = static_cast<int>(std::ceil(2 * reach / settings.voxel));
  if (n > kMostVoxels)
    throw PhantomCaseError("voxel = " + std::to_string(1000 * settings.voxel) + " mm makes " + std::to_string(n) +
                           " voxels a side, allowed are " + std::to_string(kMostVoxels) +
                           "; take larger ones, or a smaller side of the volume");

  MrVolume volume;
  volume.size = {n, n, n};
  volume.data.resize(static_cast<std::size_t>(n) * n * n);
  volume.T_pmr_voxel = Eigen::Affine3d::Identity();
  volume.T_pmr_voxel.linear() = Eigen::Vector3d(-settings.voxel, settings.voxel, settings.voxel).asDiagonal();
  volume.T_pmr_voxel.translation() = centre + 0.5 * (n - 1) * settings.voxel * Eigen::Vector3d(1, -1, -1);
  return volume;
}

double gaussian(Random& random) {
  constexpr double kPi = 3.14159265358979323846;
  return std::sqrt(-2 * std::log(1 - random.uniform())) * std::cos(2 * kPi * random.uniform());
}

template <typename Value>
void put(std::vector<char>& header, std::size_t offset, const Value& value) {
  std::memcpy(header.data() + offset, &value, sizeof value);
}

}  // namespace

void MrSettings::validate() const {
  std::ostringstream out;
  if (!(voxel >= kSmallest && voxel <= kLargest))
    out << "voxel = " << voxel << " m is not allowed; allowed is " << kSmallest << " ... " << kLargest;
  else if (supersampling < 1 || supersampling > 8)
    out << "supersampling = " << supersampling << " is not allowed; allowed is 1 ... 8";
  else if (!(side == 0 || (side >= kSmallestSide && side <= kLargestSide)))
    out << "side = " << side << " m is not allowed; allowed is 0 (the whole head) and " << kSmallestSide << " ... "
        << kLargestSide;
  else if (!(noise >= 0 && noise <= 50))
    out << "noise = " << noise << " is not allowed; allowed is 0 ... 50";
  else if (!(tumour == 0 || (tumour >= kSmallestTumour && tumour <= kLargestTumour)))
    out << "tumour = " << tumour << " m is not allowed; allowed is 0 (none) and " << kSmallestTumour << " ... "
        << kLargestTumour;
  if (!out.str().empty()) throw PhantomCaseError(out.str());
}

MrVolume makeMr(const PhantomScene& scene, const MrSettings& settings) {
  MrVolume volume = emptyVolume(scene, settings);
  const Cortex cortex(scene, settings.tumour);
  const int n = volume.size[0];
  const Eigen::Affine3d T_brain_voxel = scene.description().T_pmr_brain.inverse() * volume.T_pmr_voxel;
  const int s = settings.supersampling;
  cv::parallel_for_(cv::Range(0, n), [&](const cv::Range& range) {
    for (int k = range.start; k < range.end; ++k) {
      Random random(settings.seed * 0x9e3779b97f4a7c15ULL + static_cast<std::uint64_t>(k));
      for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
          const Eigen::Vector3d p = T_brain_voxel * Eigen::Vector3d(i, j, k);
          const bool border = cortex.mayMeet(p, settings.voxel);
          double sum = 0;
          if (border) {
            for (int a = 0; a < s * s * s; ++a) {
              const Eigen::Vector3d offset((a % s + 0.5) / s - 0.5, (a / s % s + 0.5) / s - 0.5,
                                           (a / (s * s) + 0.5) / s - 0.5);
              sum += cortex.intensity(T_brain_voxel * (Eigen::Vector3d(i, j, k) + offset));
            }
            sum /= s * s * s;
          } else {
            sum = cortex.intensity(p);
          }
          // Magnitude images are never negative: the noise is Rician.
          const double real = sum + settings.noise * gaussian(random), imaginary = settings.noise * gaussian(random);
          volume.data[(static_cast<std::size_t>(k) * n + j) * n + i] =
              static_cast<std::int16_t>(std::lround(std::hypot(real, imaginary)));
        }
    }
  });
  return volume;
}

MrVolume makeTumour(const PhantomScene& scene, const MrSettings& settings) {
  MrVolume volume = emptyVolume(scene, settings);
  const Eigen::Affine3d T_brain_voxel = scene.description().T_pmr_brain.inverse() * volume.T_pmr_voxel;
  std::size_t at = 0;
  for (int k = 0; k < volume.size[2]; ++k)
    for (int j = 0; j < volume.size[1]; ++j)
      for (int i = 0; i < volume.size[0]; ++i)
        volume.data[at++] = fromTumour(T_brain_voxel * Eigen::Vector3d(i, j, k)) < settings.tumour ? 1 : 0;
  return volume;
}

void writeNifti(const MrVolume& volume, const std::string& path) {
  std::vector<char> header(352, 0);  // NIfTI-1 header and four bytes that say: no extension
  put(header, 0, std::int32_t{348});
  const std::int16_t dimensions[8] = {3,
                                      static_cast<std::int16_t>(volume.size[0]),
                                      static_cast<std::int16_t>(volume.size[1]),
                                      static_cast<std::int16_t>(volume.size[2]),
                                      1,
                                      1,
                                      1,
                                      1};
  put(header, 40, dimensions);
  put(header, 70, std::int16_t{4});   // datatype: signed short
  put(header, 72, std::int16_t{16});  // bits per voxel
  const Eigen::Matrix3d linear = 1000 * volume.T_pmr_voxel.linear();
  const Eigen::Vector3d origin = 1000 * volume.T_pmr_voxel.translation();
  Eigen::Matrix3d rotation = linear;
  float pixdim[8] = {1, 0, 0, 0, 0, 0, 0, 0};
  for (int axis = 0; axis < 3; ++axis) {
    pixdim[axis + 1] = static_cast<float>(linear.col(axis).norm());
    rotation.col(axis).normalize();
  }
  if (rotation.determinant() < 0) {  // qfac: the third axis is the mirrored one
    pixdim[0] = -1;
    rotation.col(2) *= -1;
  }
  put(header, 76, pixdim);
  put(header, 108, 352.0F);   // where the voxels begin
  put(header, 112, 1.0F);     // slope
  put(header, 123, char{2});  // millimetres
  std::strncpy(header.data() + 148, "cortshift phantom, undeformed, T1 with contrast", 79);
  put(header, 252, std::int16_t{1});  // qform and sform: scanner coordinates
  put(header, 254, std::int16_t{1});
  Eigen::Quaterniond q(rotation);
  if (q.w() < 0) q.coeffs() *= -1;
  const float quaternion[6] = {static_cast<float>(q.x()),      static_cast<float>(q.y()),
                               static_cast<float>(q.z()),      static_cast<float>(origin.x()),
                               static_cast<float>(origin.y()), static_cast<float>(origin.z())};
  put(header, 256, quaternion);
  float rows[12];
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 4; ++column)
      rows[4 * row + column] = static_cast<float>(column < 3 ? linear(row, column) : origin(row));
  put(header, 280, rows);
  std::memcpy(header.data() + 344, "n+1", 4);

  std::ofstream file(path, std::ios::binary);
  file.write(header.data(), static_cast<std::streamsize>(header.size()));
  file.write(reinterpret_cast<const char*>(volume.data.data()),
             static_cast<std::streamsize>(volume.data.size() * sizeof(std::int16_t)));
  file.close();
  if (!file) throw std::runtime_error("cannot write " + path + "; is the folder there, is the disk full?");
}

}  // namespace cortshift_stereo_phantom
