// The script of a phantom case: head, cameras, light and the surgical stages, read from YAML.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "cortshift_stereo/geometry/camera_model.hpp"

namespace cortshift_stereo_phantom {

/// A case that cannot be played. The message names the key, its value and what is allowed.
class PhantomCaseError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A smooth closed outline about a centre in material coordinates: an ellipse with waves on it.
struct OutlineSettings {
  Eigen::Vector2d centre{0, 0};         ///< [m]
  Eigen::Vector2d radii{0.030, 0.025};  ///< half axes [m]
  double irregularity = 0.2;            ///< 0: an ellipse; 0.4: very uneven
  std::uint32_t seed = 1;
};

/// A photograph in the place of the painted cortex.
struct PictureSettings {
  std::string file;              ///< any format that OpenCV reads; relative to the folder of the case file
  double width = 0.072;          ///< that the picture's width is spread over; mirrored beyond its edges [m]
  Eigen::Vector2d centre{0, 0};  ///< material coordinates of its middle [m]
  double turn = 0;               ///< from material x to the picture's rows [rad]
  double gain = 1;               ///< of its values
  double contrast = 1;           ///< of its detail about its mean colour: below 1 for weak texture
};

/// The undeformed head. Material coordinates (x, y) [m] are those of the plane z = 0 of the brain frame, whose z axis
/// points out of the head at the middle of the craniotomy.
struct HeadSettings {
  std::uint32_t seed = 1;        ///< vessels, gyri, tissue
  double dome_radius = 0.075;    ///< radius of curvature at the apex [m]
  double sulcus_depth = 0.0012;  ///< [m]
  double vein_diameter = 0.002;  ///< of the largest vessels [m]
  OutlineSettings craniotomy;
  double window_width = 0.018;             ///< displacement falls from full to 0 at the rim over this width [m]
  double bone_height = 0.003;              ///< of the bone above the brain at the rim [m]
  double bevel_width = 0.004;              ///< over which the bone rises [m]
  std::optional<PictureSettings> picture;  ///< nothing: painted cortex
};

/// A lens whose intrinsics and distortion change with the microscope's settings. m and f are magnification and focal
/// length over those of the reference setting, at which the cameras are as CameraSettings says. The pixels' focal
/// length goes with m f^-focal_power (1 + breathing (m - 1)^2); what drifts does so by its rates times m - 1 and f - 1,
/// the principal points of left and right the opposite way.
struct ZoomSettings {
  double magnification = 1.0;   ///< of the reference setting
  double focal_length = 0.300;  ///< of the reference setting [m]
  double focal_power = 0.8;
  double breathing = 0.03;
  Eigen::Vector2d drift_zoom{12, 7};      ///< of the principal point [px]
  Eigen::Vector2d drift_focus{20, -9};    ///< of the principal point [px]
  Eigen::Vector2d distortion{0.5, -0.3};  ///< of k1 by zoom and focus
  double pupil_travel = 0;                ///< of the entrance pupils along their axes by zoom [m]
};

/// Two cameras of the microscope, verging on its axis at the working distance.
struct CameraSettings {
  cv::Size size{1024, 768};         ///< [px]
  double working_distance = 0.300;  ///< from the baseline to the point of vergence [m]
  double field_of_view = 0.080;     ///< width of the image at the working distance [m]
  double baseline = 0.025;          ///< [m]
  cortshift_stereo::LensModel lens = cortshift_stereo::LensModel::kPlumbBob;  ///< of both cameras
  std::vector<double> left_distortion{-0.35, 0, 0, 0, 0};                     ///< coefficients of the lens
  std::vector<double> right_distortion{-0.31, 0, 0, 0, 0};
  Eigen::Vector2d left_principal_offset{6, -4};   ///< of the raw principal point from the image centre [px]
  Eigen::Vector2d right_principal_offset{-5, 3};  ///< [px]
  double right_focal_ratio = 1.004;               ///< raw focal length of the right camera over that of the left
  Eigen::Vector3d right_misalignment{0.003, -0.002, 0.004};  ///< rotation vector of the right camera's mount [rad]
  std::optional<ZoomSettings> zoom;  ///< nothing: the stages' settings are reported, but nothing changes in the images
};

/// A rippled film of water on the brain, in which the lamp is mirrored: the glints lie where the film's normal halves
/// the angle between lamp and eye, elsewhere for each camera and each place of the microscope.
struct FilmSettings {
  double strength = 4;        ///< of the lamp's mirror image, of full scale: above 1 saturates
  double slope = 0.08;        ///< root mean square slope of the ripples
  double wavelength = 0.003;  ///< of the ripples: half of it to twice [m]
  double lamp_angle = 0.06;   ///< radius of the lamp as the tissue sees it, its soft rim included [rad]
  std::uint32_t seed = 1;
};

struct LightSettings {
  Eigen::Vector3d position_head{0, -0.020, 0};  ///< of the lamp in the stereo head's frame [m]
  double ambient = 0.25;                        ///< share of the light that falls from everywhere
  double diffuse = 0.80;                        ///< share that falls from the lamp
  double specular = 0.0;                        ///< strength of the wet highlights; 0: none, 1 saturates
  double shininess = 500;                       ///< exponent of the highlights
  std::optional<FilmSettings> film;             ///< nothing: no film
};

/// What one camera makes of the light.
struct ResponseSettings {
  Eigen::Vector3d white_balance{1, 1, 1};  ///< gain of blue, green, red
  double gain = 1;
  double black_level = 0;  ///< of full scale, added to every value
  double blur = 0;         ///< standard deviation of the lens's own blur [px]
};

struct ImageSettings {
  int supersampling = 3;     ///< rays per pixel side
  double noise = 1.0 / 255;  ///< standard deviation of the sensor noise, of full scale
  double vignette = 0.0;     ///< loss of light in the image corner, 0...1
  double right_gain = 1.0;   ///< gain of the right camera over the left
  std::uint32_t noise_seed = 1;
  double shot_noise = 0;      ///< standard deviation at full scale of the noise that grows with the root of the signal
  double depth_of_field = 0;  ///< standard deviation of the blur per millimetre from the focal plane [px/mm]
  double focus_offset = 0;    ///< of the focal plane beyond the working distance [m]
  bool bayer = false;         ///< one colour per pixel (RGGB), the others interpolated
  int jpeg = 0;               ///< quality 1...100; 0: not compressed
  ResponseSettings left, right;
};

/// The brain rises and falls between the pairs: along the brain's z, inside the window, as
/// DeformationSettings::outward.
struct MotionSettings {
  double pulsation = 0;          ///< amplitude [m]; 0.0003 is a brain's
  double pulsation_rate = 1.2;   ///< [Hz]
  double breathing = 0;          ///< amplitude [m]
  double breathing_rate = 0.25;  ///< [Hz]
  double pair_interval = 0.1;    ///< between two exposures [s]

  /// At the exposure of pair `frame` [m], in steps of 20 um so that few states are rendered.
  double outwardAt(std::uint64_t frame) const;
};

/// Displacement from the undeformed head. All parts fall to 0 at the rim and add up.
struct DeformationSettings {
  double sag = 0;                      ///< along gravity [m]
  Eigen::Vector2d lateral{0, 0};       ///< in the plane of the craniotomy (brain x, y) [m]
  double bulge = 0;                    ///< outwards (brain z) at bulge_centre; negative: sinks [m]
  Eigen::Vector2d bulge_centre{0, 0};  ///< [m]
  double bulge_width = 0.012;          ///< standard deviation of the bulge [m]
  double variation = 0;                ///< amplitude of a slow irregular part, each axis [m]
  double outward = 0;                  ///< along brain z, everywhere alike [m]
};

/// Where the microscope stands: it looks at a point of the plane z = 0 of the brain frame.
struct PlacementSettings {
  Eigen::Vector2d target{0, 0};  ///< looked at (brain x, y) [m]
  double distance = 0.300;       ///< of the stereo head from the target [m]
  Eigen::Vector2d tilt{0, 0};    ///< of the axis against the brain's z, about brain x and y [rad]
  double roll = 0;               ///< about the axis [rad]
};

/// Opaque blood, or cotton, on the surface.
struct BloodSettings {
  OutlineSettings outline;
  double border = 0.0008;  ///< width over which the film fades in [m]
  bool cotton = false;     ///< white and matt, with fibres
};

/// Tissue that has been taken out.
struct HoleSettings {
  OutlineSettings outline;
  double depth = 0.010;  ///< [m]
  double wall = 0.004;   ///< width of the slope from the brink to the floor [m]
};

/// A metal blade above the surface.
struct RetractorSettings {
  Eigen::Vector3d tip{0.012, 0, 0.006};  ///< middle of its rounded end (brain frame) [m]
  double heading = 0;                    ///< direction from the tip to the handle, from brain x to y [rad]
  double slope = 0.15;                   ///< rise of the blade towards the handle [rad]
  double width = 0.010;                  ///< [m]
  double length = 0.080;                 ///< [m]
};

/// A round instrument with a hemispherical tip above the surface: it hides tissue and keeps the lamp's light from it.
struct RodSettings {
  Eigen::Vector3d tip{0.005, 0, 0.004};  ///< its end (brain frame) [m]
  double heading = 0;                    ///< direction from the tip to the handle, from brain x to y [rad]
  double slope = 0.5;                    ///< rise towards the handle [rad]
  double diameter = 0.004;               ///< [m]
  double length = 0.080;                 ///< [m]
};

/// A point that the tracked probe is held at.
struct ProbeTargetSettings {
  std::string label;
  Eigen::Vector2d at{0, 0};  ///< material coordinates [m]
  double lift = 0;           ///< of the tip above that surface point, against gravity [m]
};

struct StageSettings {
  std::string name;
  DeformationSettings deformation;
  PlacementSettings microscope;
  double gain = 1.0;            ///< of both cameras
  double magnification = 1.0;   ///< reported microscope zoom
  double focal_length = 0.300;  ///< reported focal length of the main objective [m]
  std::vector<BloodSettings> blood;
  Eigen::Vector2d drape{0, 0};  ///< by which the cloth has slid since it was laid (brain x, y) [m]
  std::optional<HoleSettings> hole;
  std::optional<RetractorSettings> retractor;
  std::vector<RodSettings> rods;
  std::vector<ProbeTargetSettings> probe;  ///< visited in this order, again and again; empty: no probe in view
};

struct PhantomCase {
  std::string name;
  Eigen::Isometry3d T_pmr_brain = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_pmr_reference = Eigen::Isometry3d::Identity();    ///< patient registration
  Eigen::Isometry3d T_microscope_head = Eigen::Isometry3d::Identity();  ///< stereo head in the tracked body
  Eigen::Vector3d gravity_pmr{0, 0, -1};                                ///< unit vector
  HeadSettings head;
  CameraSettings cameras;
  LightSettings light;
  ImageSettings image;
  MotionSettings motion;
  std::vector<StageSettings> stages;

  /// @throws PhantomCaseError naming the first value out of its range, a repeated stage name, or a missing stage.
  void validate() const;

  /// The case as it stands at the exposure of pair `frame`.
  PhantomCase atPair(std::uint64_t frame) const;
};

/// Reads and validates a case. Every key is checked; unknown keys are refused by name. The key `based_on` names another
/// case file (relative to this one's folder) whose keys hold where this one has none; lists are taken as a whole.
/// @throws PhantomCaseError
PhantomCase loadPhantomCase(const std::string& path);

/// The same from text; `origin` names it in messages.
PhantomCase parsePhantomCase(const std::string& yaml, const std::string& origin);

}  // namespace cortshift_stereo_phantom
