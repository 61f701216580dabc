#pragma once
// For how long a rock that rests on a moving pedestal stays at rest; private to the core.

#include <array>
#include <cstdint>

#include "foothold.hpp"
#include "vsr2/trial.hpp"

namespace vsr2 {

/// What a rock that rests on a flat top can bear before it slides or rocks.
///
/// Carried with the top, the rock demands of its contacts the force m f, f = a - g its specific force.
/// The contacts can give it, each in the same direction, where
///
///     |f_t| <= mu f_n        and        the zero moment point lies in the support polygon,
///
/// f_n and f_t being along the top's normal and along the top, and the zero moment point that at which
/// the line through the mass centre along f meets the top (Vukobratovic and Borovac, Int. J. Humanoid
/// Robotics 1, 2004). Both are linear in f but for the friction cone.
///
/// The contacts are springs with dampers, so the rock may answer a change of f by more than its size. A
/// linear oscillator of damping ratio z < 1 answers none by more than coth(pi z / (2 sqrt(1 - z^2)))
/// times its greatest size, the integral of its impulse response's absolute value; one of z >= 1 by no
/// more than that size. The slowest of the rock's three modes on its contacts (heave and two tilts)
/// has the least z. Changes of f from rest are enlarged by its factor, and by kQuietStretch.safety
/// for what the model of small deflections leaves out.
class Bearing {
 public:
  Bearing(const Foothold& foothold, double gravity);

  /// Whether the rock stays at rest under an acceleration of the top [m/s^2], in W.
  bool bears(const Eigen::Vector3d& a_W) const;
  /// Time in which a deflection of the contacts falls to 1 / e [s].
  double memory() const { return memory_; }

 private:
  struct Edge {
    Eigen::Vector2d inward;  ///< unit
    double height;           ///< of the mass centre over it [m]
    double room;             ///< of the mass centre's foot, inside of it [m]
  };
  std::array<Edge, 6> edges_;  ///< of the support polygon; four points have six lines
  int count_ = 0;
  FrictionBounds friction_;
  double gain_ = 1.0;
  double memory_ = 0.0;
  Eigen::Matrix3d R_TW_;
  Eigen::Vector3d rest_T_;  ///< specific force at rest [m/s^2]
};

/// The set-points of a trial, and between which of them a rock at rest need not be stepped.
class QuietStretches {
 public:
  /// @param spec outlives this.
  explicit QuietStretches(const TrialSpec& spec);

  /// The last set-point up to which the rock is still as it is at set-point `k`, contacts without
  /// memory of what was before; at most `end`. `k` itself where it has to be stepped from there.
  /// `next` becomes the first set-point from which asking again may give more.
  std::int64_t last(const Foothold& foothold, std::int64_t k, std::int64_t end, std::int64_t& next) const;

 private:
  Eigen::Vector3d acceleration(std::int64_t k) const;

  const TrialSpec& spec_;
  double dt_;
  double substep_;
};

}  // namespace vsr2
