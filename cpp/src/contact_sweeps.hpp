#pragma once
// Bullet's projected Gauss-Seidel sweeps over the rows of up to four contacts on a flat support,
// and a short cut to the state that many of them reach; private to the core.

#include <array>

namespace vsr2 {

constexpr double kGreatestImpulse = 1e10F;  ///< Bullet's bound on a normal impulse [N s]

/// One contact's rows. A row's change of impulse is rhs - cfm applied - j . velocity change, all
/// scaled by its effective mass; only entries that are not 0 on a support with normal z are kept.
struct ContactRows {
  // normal: along z
  double nj0, nj1, njz, nd0, nd1, nd2, nrhs, nkeep, nk;
  // spinning: about z
  double sj, sd0, sd1, sd2, srhs, sk;
  double friction;  ///< of the lateral rows
  // lateral 1: along -y
  double aj0, aj2, ajy, ad0, ad1, ad2, arhs, ak;
  // lateral 2: along x
  double bj1, bj2, bjx, bd0, bd1, bd2, brhs, bk;
  // Of the support's joint: j and d of each. A motor is in the last one alone.
  double njs, nds, sjs, sds, ajs, ads, bjs, bds;
  // Of the latest sweep: impulses, their changes, and what they were before their bounds.
  double n = 0, s = 0, a = 0, b = 0;
  double dn = 0, ds = 0, da = 0, db = 0;
  double n_sum = 0, s_sum = 0, a_sum = 0, b_sum = 0;
};

/// Of the rock's velocities along the support's axes, and of the support's joint.
struct VelocityChange {
  double w0 = 0, w1 = 0, w2 = 0, x = 0, y = 0, z = 0, support = 0;
};

struct ContactProblem {
  std::array<ContactRows, 4> rows;
  int count = 0;
  double inverse_mass = 0;
  double spinning_friction = 0;
  bool sprung = false;            ///< the support turns on a spring; then it has no motor
  double motor_inverse_mass = 0;  ///< 0: no motor
  double motor_rhs = 0;
  double motor_limit = 0;
  double motor_impulse = 0;
  double motor_change = 0;  ///< of the motor's impulse in the latest sweep
  VelocityChange change;
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
