// The rigid motion that most of a set of small pieces of surface share.
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "cortshift_tracking/surround/pose_uncertainty.hpp"
#include "cortshift_tracking/trust/probability.hpp"

namespace cortshift_tracking {

struct MovedPiece {
  Eigen::Vector3d place;   ///< [m]
  Eigen::Vector3d motion;  ///< [m]
};

struct RigidFit {
  Eigen::Vector3d centre;                                       ///< of the pieces that share the motion
  Vector6 motion;                                               ///< about the centre, small rotation
  Matrix6 covariance;                                           ///< of it
  double sd = 0;                                                ///< of one coordinate of one piece that shares it [m]
  std::vector<char> shares;                                     ///< for each piece, whether it does
  std::size_t count = 0;                                        ///< of those
  Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();  ///< place + motion = transform * place
};

struct RigidFitSettings {
  double agreement =
      kRightWithin;  ///< pieces off by more do not share the motion [m]: what a reported vector is right to
  double hold = 9;   ///< pieces whose errors hang together: a measured piece counts as 1 / hold
};

/// By consensus of triples (the same ones each time), then by least squares with Tukey's weights together with what is
/// known before.
/// @param prior  covariance of the motion about the mean place of all pieces, no mean; it decides what they do not
/// @return nothing where fewer than 6 pieces share a motion
std::optional<RigidFit> fitRigid(const std::vector<MovedPiece>& pieces, const Matrix6& prior,
                                 const RigidFitSettings& settings = {});

/// How far [m] a piece ends from where the transform brings its place.
double residualOf(const MovedPiece& piece, const Eigen::Isometry3d& transform);

/// Mean place of the pieces.
Eigen::Vector3d centreOf(const std::vector<MovedPiece>& pieces);

}  // namespace cortshift_tracking
