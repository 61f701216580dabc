#pragma once
// The laws of a contact: what its normal asks and what its friction bears; private to the core.
//
// The one place where contact parameters act. `fast` takes the laws as they are: the rows of
// contact_rows.hpp, contacts that stick and rocks at rest. Bullet takes what they make of the parameters
// that it has, in_force(), and so do those who read a contact.

#include <algorithm>
#include <cmath>
#include <limits>

#include "always_inline.hpp"
#include "vsr2/contact_model.hpp"

namespace vsr2 {

/// A contact's normal: a spring k with a damper c beside it, and a rebound (supplement S2.2). Over a
/// solver step dt its row asks the impulse lambda_n [N s] for
///
///   u_n + softness lambda_n = rebound(u_n before) + erp p / dt,
///   softness = 1 / ((dt k + c) dt),   erp = dt k / (dt k + c),
///
/// u_n being the normal velocity [m/s] and p the penetration [m]: the spring at the step's end and its
/// damper, by the implicit Euler rule (Catto, "Soft Constraints", 2011).
struct NormalLaw {
  double restitution = 0.0;  ///< e [1]
  double stiffness = 0.0;    ///< k [N/m]
  double damping = 0.0;      ///< c [N s/m]

  static NormalLaw of(const ContactValues& pair) {
    return {.restitution = pair["restitution"],
            .stiffness = pair["stiffness"],
            .damping = pair["damping"]};
  }
  /// What of it are parameters of a pair.
  void put(ContactValues& pair) const {
    pair["restitution"] = restitution;
    pair["stiffness"] = stiffness;
    pair["damping"] = damping;
  }

  /// Of the row over a solver step `dt` [s], as the velocity that a unit impulse leaves [1/kg].
  double softness(double dt) const { return 1.0 / resistance(dt) / dt; }
  /// Part of a penetration that a solver step undoes [1].
  double erp(double dt) const { return dt * stiffness / resistance(dt); }
  /// Normal velocity after an approach at the velocity `approach`, negative; `threshold`: the least speed
  /// that rebounds [m/s].
  double rebound(double approach, double threshold) const {
    return std::fabs(approach) >= threshold ? std::max(0.0, restitution * -approach) : 0.0;
  }

 private:
  // [N s/m]
  double resistance(double dt) const {
    return std::max(dt * stiffness + damping, std::numeric_limits<double>::epsilon());
  }
};

/// Bounds of a contact's friction by its normal impulse: lambda_t <= mu lambda_n for the size of the
/// lateral impulse, |lambda_s| <= r lambda_n for the spinning one (supplement S2.1). All who use them take
/// a bound as proportional to lambda_n.
struct FrictionBounds {
  double coefficient = 0.0;  ///< mu [1]
  double lever = 0.0;        ///< r [m]

  /// `scale`: factor of the lateral friction [1].
  static FrictionBounds of(const ContactValues& pair, double scale) {
    return {.coefficient = pair["lateral_friction"] * scale, .lever = pair["spinning_friction"]};
  }
  /// What of them are parameters of a pair.
  void put(ContactValues& pair) const {
    pair["lateral_friction"] = coefficient;
    pair["spinning_friction"] = lever;
  }

  /// Greatest lateral impulse [N s].
  template <typename Scalar>
  VSR2_INLINE Scalar lateral(const Scalar& normal) const {
    return coefficient * normal;
  }
  /// Greatest spinning impulse [N m s].
  template <typename Scalar>
  VSR2_INLINE Scalar spinning(const Scalar& normal) const {
    return lever * normal;
  }
};

/// A pair's values as its laws have them in force at a contact, whose lateral friction has the factor
/// `scale` [1].
inline ContactValues in_force(ContactValues pair, double scale) {
  const auto normal = NormalLaw::of(pair);
  const auto friction = FrictionBounds::of(pair, scale);
  normal.put(pair);
  friction.put(pair);
  return pair;
}

}  // namespace vsr2
