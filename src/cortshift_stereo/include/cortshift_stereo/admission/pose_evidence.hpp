// What the samples of a tracker around an exposure say about the pose that is taken from them.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "cortshift_stereo/admission/limits.hpp"
#include "cortshift_stereo/admission/verdict.hpp"
#include "cortshift_stereo/geometry/transform_tree.hpp"

namespace cortshift_stereo {

/// How one moving edge behaves, where the camera looks. Steady motion does not count: each sample is compared with
/// what the samples on either side of it lead to expect.
struct EdgeTremble {
  double jitter = 0;        ///< [m] root mean square deviation of a sample
  double middle = 0;        ///< [m] median deviation
  double worst = 0;         ///< [m] largest deviation
  double next = 0;          ///< [m] median distance of neighbouring samples
  double next_but_one = 0;  ///< [m] the same, leaving out one in between
};

/// @param working_distance  [m] along the optical axis of the camera, which is the frame of T_child_source
/// Zero where there are fewer than 5 samples.
EdgeTremble trembleOf(const MovingEdge& edge, double working_distance = 0.3);

/// How a pose spreads: root mean square of each coordinate at the camera, and about each axis, so that both together
/// are as long as what is seen where the camera looks.
struct PoseSpread {
  double translation = 0;  ///< [m], of a speed [m/s]
  double rotation = 0;     ///< [rad], of a speed [rad/s]
};

struct ExposureMotion {
  PoseSpread tremble;  ///< of the pose at the exposure, which is interpolated between two samples
  PoseSpread speed;    ///< of its steady motion
};

/// Of the moving edges between the two frames together; nothing where there are none, or fewer than 5 samples of one.
/// @param working_distance  [m]  @throws PoseError as TransformTree::lookup
std::optional<ExposureMotion> exposureMotion(const TransformTree& tree, const std::string& target,
                                             const std::string& source, int64_t stamp_ns,
                                             double working_distance = 0.3);

/// Two publishers of one edge in turn.
Findings checkPublishers(const MovingEdge& edge, const EdgeTremble& tremble);

/// Samples that tremble more than the tracker is known for, or one of them that jumps.
Findings checkJitter(const MovingEdge& edge, const EdgeTremble& tremble, const PoseLimits& limits);

/// A tracker that trembles, and then says bit by bit what it said before: it repeats itself and does not measure. Of
/// one that rounds, single samples are the same by chance: it is refused where more of them in a row are than that
/// explains.
/// @param edge  with samples from well before the exposure
Findings checkRepetition(const MovingEdge& edge, int64_t stamp_ns);

/// All of the above for every moving edge between the two frames. @throws PoseError as TransformTree::lookup
Findings checkPoses(const TransformTree& tree, const std::string& target, const std::string& source, int64_t stamp_ns,
                    const PoseLimits& limits);

}  // namespace cortshift_stereo
