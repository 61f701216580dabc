#pragma once
// How set-points move the pedestal, in whatever engine; private to the core.

#include "vsr2/world.hpp"

namespace vsr2 {

/// @throws InvalidInput for a drive that does not let the pedestal pitch on its spring.
void check_drive(const PedestalSpec& pedestal, Drive drive);
/// @throws InvalidInput for an excursion that the drive does not follow, or pitch on a spring.
void check_target(const PedestalSpec& pedestal, Drive drive, const DriveTarget& target);

inline bool prescribes(Drive drive) {
  return drive == Drive::prescribed || drive == Drive::prescribed_spatial;
}

/// Where a prescribed pedestal is at the end of solver step `i` of `n`, counted from 1, that take it
/// from `start` to the set-point; its rates are over that step of `dt` [s] from `now`.
PedestalState on_the_way(Drive drive, const PedestalState& start, const PedestalState& now,
                         const DriveTarget& target, int i, int n, double dt);

/// Bullet's joint motor (btMultiBodyJointMotor) as PyBullet's setJointMotorControl2 sets it. Within
/// its force it gives the joint the speed
///
///   clamp(position_gain (x_ref - x) / dt + v + velocity_gain (v_ref - v), -speed_limit, speed_limit).
///
/// Force and speed limits are the original's.
struct MotorLaw {
  static constexpr double position_gain = 0.1;
  static constexpr double velocity_gain = 1.0;
  static constexpr double maximum_force = 5e8;  ///< [N]
  static constexpr double speed_limit = 200.0;  ///< [m/s]

  /// v_ref [m/s]: recordings give a position reference only, cosine modes both (S1.3).
  static double velocity_reference(Drive drive, const DriveTarget& target) {
    return drive == Drive::motor_position_velocity ? target.velocity : 0.0;
  }
  /// Greatest impulse of a solver step; PyBullet takes the time step's for it [N s].
  static double maximum_impulse(const EngineSettings& engine) {
    return maximum_force * engine.time_step;
  }
  /// The joint's speed at the start of a solver step of `dt`, which Bullet damps before its motor acts
  /// [m/s].
  static double damped(const EngineSettings& engine, double velocity, double dt);
  /// The speed it gives a free joint over a solver step of `dt` [m/s].
  static double speed(Drive drive, const PedestalState& now, const DriveTarget& target, double dt);
};

}  // namespace vsr2
