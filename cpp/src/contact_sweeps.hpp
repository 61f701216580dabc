#pragma once
// Bullet's projected Gauss-Seidel sweeps over the rows of up to four contacts on a flat support,
// and a short cut to the state that many of them reach; private to the core.

#include <array>

#include "contact_laws.hpp"
#include "contact_rows.hpp"

namespace vsr2 {

constexpr double kGreatestImpulse = 1e10F;  ///< Bullet's bound on a normal impulse [N s]

/// Rows of one contact.
struct ContactRows {
  NormalRow normal;
  SpinningRow spin;
  Lateral1Row lateral_1;
  Lateral2Row lateral_2;
  FrictionBounds bounds;  ///< of the lateral and spinning rows
};

struct ContactProblem {
  std::array<ContactRows, 4> rows;
  int count = 0;
  Joint joint = Joint::none;
  MotorRow motor;
  VelocityChange<double> change;  ///< by all impulses so far
};

/// Takes a problem from zero impulses through `sweeps` sweeps; returns how many were done one by
/// one.
///
/// threshold > 0: all one by one, and they end once no row's speed changed by more than its root
/// in one [(m/s)^2]. threshold 0: none ends early. While no row changes between open and closed,
/// sticking and sliding, free and bounded, a sweep is one affine map of the impulses, so a run of
/// sweeps is a power of that map; powers are taken by squaring, each state they lead to is checked
/// against the bounds, and sweeps are done one by one across a change. Sliding contacts are
/// linearised, and jumped over only while they hardly turn.
int solve(ContactProblem& problem, int sweeps, double threshold);

}  // namespace vsr2
