#pragma once
// Scenes that several tests use.

#include <initializer_list>
#include <memory>

#include "vsr2/trial.hpp"

namespace vsr2::testing {

struct GivenValue {
  ContactKey key;
  double value;
};

/// Contact values by name, the others the original's.
inline ContactValues material(std::initializer_list<GivenValue> given) {
  ContactValues out;
  for (const GivenValue& one : given) out[one.key] = one.value;
  return out;
}

/// A material that neither bounces nor resists spinning.
inline ContactValues frictional(double lateral_friction) {
  return material({{"restitution", 0.0},
                   {"lateral_friction", lateral_friction},
                   {"spinning_friction", 0.0}});
}

struct BlockOptions {
  Eigen::Vector3d size{0.4, 0.55, 0.95};
  double density = 2700.0;
  EngineSettings engine;
  ContactValues material;
};

/// A homogeneous block on the prism pedestal (top at 2.5 m).
std::shared_ptr<const Scene> block_scene(const BlockOptions& options = {});
/// The block as a convex hull of its corners, turned into the body frame as a mesh would be.
std::shared_ptr<const Scene> hull_scene(int sides = 0);
/// Pose of a block standing on the pedestal with its mass centre `height` above the top.
Pose standing(double height, double yaw = 0.0);
/// A trial of a block from rest under the given displacement.
TrialSpec trial_of(std::shared_ptr<const Scene> scene, const Pose& start,
                   std::vector<double> position, Drive drive = Drive::prescribed);
/// x(t) = A (1 - cos 2 pi F t), one period, sampled at 1 ms.
std::vector<double> cosine(double amplitude, double frequency);

}  // namespace vsr2::testing
