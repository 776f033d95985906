// A time-stamped tree of coordinate frames that answers at an exact instant or says why it cannot.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace cortshift_stereo {

/// A pose that is not known well enough. The message names the edge or frame, the reason and the remedy.
class PoseError : public std::runtime_error {
 public:
  enum class Reason {
    kMissingFrame,  ///< a frame has never been seen, or has no sample left
    kNotConnected,  ///< both frames are known, but there is no chain between them
    kGapBefore,     ///< the nearest sample before the instant is too far away, or there is none
    kGapAfter,      ///< the same after it
    kNotRigid,      ///< a sample beside the instant is not a finite rigid transform
    kTwoSources     ///< two poses of an edge contradict each other: fixed and moving, fixed twice, or of one stamp
  };

  PoseError(Reason reason, bool may_heal, const std::string& message)
      : std::runtime_error(message), reason_(reason), may_heal_(may_heal) {}

  Reason reason() const { return reason_; }
  /// Whether samples that are still under way could answer the same question.
  bool mayHeal() const { return may_heal_; }

 private:
  Reason reason_;
  bool may_heal_;
};

/// T_parent_child of a moving edge as it was measured.
struct EdgeSample {
  int64_t stamp_ns;
  Eigen::Isometry3d T_parent_child;
};

/// A moving edge on the way from one frame to another, and what was measured of it around an instant.
struct MovingEdge {
  std::string parent, child;
  std::vector<EdgeSample> samples;   ///< in the order of their stamps
  Eigen::Isometry3d T_child_source;  ///< at the instant
};

/// Frames joined by fixed edges (calibration) and by moving ones (a tracker's samples).
///
/// Where tf2 would answer from the two nearest samples however far away they are, this tree wants one on either side
/// of the instant within `max_pose_gap`. A sample that is not a rigid transform is remembered as such: asked beside
/// it, the tree refuses. Not synchronised; nanoseconds since any common origin.
class TransformTree {
 public:
  /// @param max_pose_gap  [s] > 0: farthest sample of a moving edge on either side of the instant asked for
  /// @param history       [s] > 0: how long samples are kept behind the newest of their edge
  TransformTree(double max_pose_gap, double history);

  /// T_parent_child that holds at all times; a later one replaces it. Two different ones at once are two
  /// publishers, of which none is believed until one has spoken again.
  /// @param when  [s] on any steady clock; nothing: not known
  /// `rotation` need not be normalised; beyond 0.1 % it is taken as broken.
  void addFixed(const std::string& parent, const std::string& child, const Eigen::Vector3d& translation,
                const Eigen::Quaterniond& rotation, std::optional<double> when = std::nullopt);

  /// T_parent_child at `stamp_ns`. Samples may come late and out of order. One that lies before the whole history of
  /// its edge starts the edge anew (a recording that was started again).
  void addSample(const std::string& parent, const std::string& child, int64_t stamp_ns,
                 const Eigen::Vector3d& translation, const Eigen::Quaterniond& rotation);

  /// T_target_source at `stamp_ns`; moving edges are interpolated (linear, spherical) between the samples beside it.
  /// @throws PoseError
  Eigen::Isometry3d lookup(const std::string& target, const std::string& source, int64_t stamp_ns) const;

  /// The moving edges between the two frames with their samples within `half_window_ns` of the instant.
  /// @throws PoseError as lookup
  std::vector<MovingEdge> movingEdges(const std::string& target, const std::string& source, int64_t stamp_ns,
                                      int64_t half_window_ns) const;

  /// Forgets all samples; fixed edges stay, as a latched message that carried them comes only once.
  void forgetSamples();

 private:
  struct Sample {
    std::string parent;
    Eigen::Vector3d translation;
    Eigen::Quaterniond rotation;
    bool rigid;
    bool contradicted;  // another pose of this stamp came
  };
  struct Edge {
    std::optional<Sample> fixed;
    std::optional<double> fixed_since;  // [s]
    bool contradicted = false;          // fixed is one of two
    std::map<int64_t, Sample> samples;
  };
  struct Link {  // one edge, evaluated
    std::string parent;
    Eigen::Isometry3d T_parent_child;
  };

  static Sample makeSample(const std::string& parent, const Eigen::Vector3d& translation,
                           const Eigen::Quaterniond& rotation);
  static bool samePose(const Sample& a, const Sample& b);
  bool known(const std::string& frame) const;
  std::vector<std::string> chainToRoot(const std::string& frame) const;
  const std::string* parentOf(const std::string& frame) const;
  Link evaluate(const std::string& child, int64_t stamp_ns) const;
  void refuseSecondSource(const std::string& child, const Edge& edge, int64_t stamp_ns) const;

  int64_t max_gap_ns_;
  int64_t history_ns_;
  std::map<std::string, Edge> edges_;  // by child frame
};

}  // namespace cortshift_stereo
