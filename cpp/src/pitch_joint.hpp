#pragma once
// A pedestal's sprung pitch joint, step by step, in whatever engine; private to the core.

#include <functional>

#include "vsr2/world.hpp"

namespace vsr2 {

/// A value: copies go on independently with the same bits.
///
/// The pedestal moves with one velocity through a solver step, so what drives the joint are blows
/// at the starts of steps: by the change of that velocity, and by the impulses of the engine's
/// contacts. Between blows the joint swings freely, which is solved exactly. A step is: react() for
/// the forces of mechanisms, blow(), the engine's solution with inverse_inertia() as the joint's
/// response to the contacts, finish().
class PitchJoint {
 public:
  /// `dt`: of a solver step [s]. The scene, whose pedestal must have a spring, outlives the joint.
  PitchJoint(const Scene& scene, double dt);

  /// A rock was put down: the joint rests under its weight.
  /// @throws InvalidInput if the spring does not carry it.
  void start(const RockState& rock, const PedestalState& pedestal);
  /// The rock's velocity was changed by forces between it and the pedestal.
  void react(const RockState& before, const RockState& after, const PedestalState& pedestal);
  /// Begins a step in which the pedestal's velocity along x has changed [m/s]; returns the rate of
  /// pitch over the step without contacts [rad/s].
  double blow(double velocity_change);
  /// Change of that rate by an angular impulse of the contacts [1 / (kg m^2)].
  double inverse_inertia() const { return chord_ * inverse_inertia_; }
  /// Ends the step with the rate of pitch that it had [rad/s].
  void finish(double rate);

  double pitch() const { return pitch_; }  ///< [rad]

 private:
  std::reference_wrapper<const PedestalSpec> pedestal_;
  double inverse_inertia_;
  double stiffness_;  ///< [N m/rad]
  double drive_;      ///< blow by a change of velocity [rad/m]
  double dt_;
  // Free swinging over a step takes (pitch, rate) to these.
  double pitch_from_pitch_;
  double pitch_from_rate_;
  double rate_from_pitch_;
  double rate_from_rate_;
  double chord_;  ///< mean rate over a step to the rate at its start, without deflection [1]
  double weight_;  ///< of a rock [N]
  double mass_;
  Eigen::Vector3d rock_inertia_;

  double pitch_ = 0.0;
  double rate_ = 0.0;       ///< now [rad/s]
  double pending_ = 0.0;    ///< blow by reactions [rad/s]
  double free_rate_ = 0.0;  ///< of the step begun
};

}  // namespace vsr2
