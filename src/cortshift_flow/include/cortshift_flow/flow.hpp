// Dense optical flow between two projection images of a cortical surface
// (Ji et al. 2014, section 2.4; Brox et al. 2004; Liu 2009).
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace cortshift_flow {

/// How the energy of Ji et al. 2014, Eq. (5), is minimised.
enum class Method {
  kVariational,  ///< the paper's model as printed, coarse to fine
  kPolished,     ///< robust start, Eq. (5) at coarse levels, then a second-order polish; forward and backward
};

/// What computeFlow needs to know beside the images. Each default is written here and nowhere else; a default
/// constructed FlowSettings is the preset "default".
struct FlowSettings {
  int threads = 0;  ///< worker threads beside OpenCV's own; 0: as many as OpenCV has. Any number gives the same bits.
  Method method = Method::kPolished;

  // Eq. (3)-(5) of the paper, intensities 0...1.
  double alpha = 0.01;         ///< weight of the smoothness term, Eq. (5)
  double epsilon = 0.001;      ///< of psi and phi, Eq. (3) and (4)
  int outer_iterations = 2;    ///< linearisations of the data term per level
  int inner_iterations = 1;    ///< updates of psi' and phi' per linearisation
  int solver_iterations = 10;  ///< sweeps of successive over-relaxation per update

  double presmoothing = 0;  ///< standard deviation of a Gaussian over each level's images [px] (kVariational)

  // Polish (kPolished).
  double curvature = 0.004;          ///< expected second difference of the flow over 4 px [px]
  int coarse_polish_iterations = 5;  ///< Gauss-Newton steps at each coarser level
  int full_polish_iterations = 2;    ///< and at full resolution
  int finest_level = 0;              ///< where the polish ends: 0 full resolution, 1 half, 2 a quarter

  /// 1: the confidence follows from what the images say of the fitted flow (trust/judgement.hpp), and a piecewise
  /// smooth flow is fitted beside the smooth one where that is needed. 0: from the error that the smooth fit predicts
  /// of itself.
  int judge = 1;

  /// Share of what is in view beyond which the piecewise flow is fitted as well, several times as slow: where the
  /// smooth one is judged unsure although the images still ask for a clear step; 1: never. Of each region the better
  /// one is kept, or the piecewise one throughout where the smooth fit says itself that it does not describe the scene.
  /// Only at full resolution and with `judge`. Chosen on the sets "fit" and "choose" of benchmark/trust_pairs.py.
  double most_unsure = 0.015;

  double search_range = 0.3;  ///< largest motion along an axis, as a share of the shorter side (kPolished)

  /// The settings of a preset: "default"; "fast", half the resolution and no `judge`; "ji2014", the paper's model with
  /// the paper's parameters.
  /// @throws std::invalid_argument for any other name.
  static FlowSettings preset(const std::string& name);
  static std::vector<std::string> presetNames();

  /// @throws std::invalid_argument naming the setting, its value and the allowed range.
  void validate() const;
};

/// Reads settings from YAML: key `preset` (default "default") and any of FlowSettings' keys by name (not `method`,
/// which a preset decides).
/// @throws std::invalid_argument naming the file and an unknown key, a wrong type or a value out of range;
///         std::runtime_error when the file cannot be read.
FlowSettings readSettings(const std::string& path);

/// Flow from the first image to the second: first(x, y) corresponds to second(x + u, y + v).
struct FlowResult {
  cv::Mat flow;  ///< CV_32FC2, size of the first image, (u, v) in pixels; finite everywhere

  /// CV_32FC1, 0...1 per pixel of the first image; 0 where the mask excludes it. It stands for a predicted error e of
  /// the flow: confidence = 1 / (1 + (e / 0.25 px)^2), so 0.5 means that 0.25 px are expected. See predictedError().
  cv::Mat confidence;
};

/// The predicted error [px] that a confidence of FlowResult stands for; infinite for 0.
double predictedError(double confidence);

/// Variational flow from `first` to `second`.
///
/// @param first   H x W, 16 to 4096 pixels a side, CV_8U, CV_16U or CV_32F (0...1), 1 or 3 channels (blue green red);
///                pixels with NaN are treated as excluded
/// @param second  same size and type
/// @param mask    empty, or CV_8UC1 H x W over `first`: 0 excludes a pixel
/// @param second_mask  the same over `second`
/// Excluded pixels never influence their neighbours: their colours are not read.
/// @throws std::invalid_argument naming what is wrong with an input or a setting.
FlowResult computeFlow(const cv::Mat& first, const cv::Mat& second, const cv::Mat& mask, const cv::Mat& second_mask,
                       const FlowSettings& settings = {});

/// The same without exclusions in the second image.
FlowResult computeFlow(const cv::Mat& first, const cv::Mat& second, const cv::Mat& mask = {},
                       const FlowSettings& settings = {});

}  // namespace cortshift_flow
