#pragma once
// Bullet's damping of velocities (btMultiBody::stepVelocitiesMultiDof); private to the core.

namespace vsr2 {

/// Rate at which a velocity of size `speed` decays [1/s]: a constant part, and one in proportion to
/// the speed in SI units.
inline double damping_rate(double damping, double speed) { return damping + damping * speed; }

}  // namespace vsr2
