#pragma once
// Mechanics of rock and contact beyond rigid bodies with Coulomb friction, off by default.
//
// They act through forces on the rock before each solver step, through the coefficient of friction
// of each contact, and through changes of the rock's velocity after a step. All are computed from
// the state and from the contacts between rock and pedestal, relative to the moving pedestal, and
// are the same in every engine. With all of them off no arithmetic changes.

#include <cmath>
#include <limits>

namespace vsr2 {

struct Mechanisms {
  /// Kinetic energy that an impact leaves, relative to Housner's ratio for it [1]; NaN: Bullet's
  /// impacts. Set, it takes the place of the restitution of the materials.
  ///
  /// Housner's ratio, here for any body: the share of the kinetic energy left if the velocity before
  /// the impact is projected (in the metric of the inertia) onto the rotations about the new edge,
  /// or the new point, of support. For a rectangular block of slenderness angle alpha it is
  /// (1 - 3/2 sin^2 alpha)^2 (Housner 1963).
  ///
  /// An impact begins with a blow at 0.04 m/s or more on a point that has borne nothing for 50 ms, and
  /// is over when its contacts have been quiet for 4 ms. The rock's velocity relative to the pedestal
  /// is then set to the rotation about its new support that has the energy wanted: about the line
  /// through the points that bear it, or, where it does not turn about that, about one of them. The
  /// share kept never exceeds 1. Where Housner's ratio H exceeds 0.98, as between the facets of a
  /// rounded edge, the given ratio is raised to the power (1 - H) / 0.02, so that rolling does not
  /// depend on the number of facets. Impacts after which the rock turns about neither (it lies flat
  /// on three points or more, slides or flies) are left as they are.
  double impact_energy_ratio = std::numeric_limits<double>::quiet_NaN();

  /// Damping of rocking [1], 0: none. A moment -2 zeta p I_O w against the horizontal part w of the
  /// angular velocity relative to the pedestal, while there is contact; I_O is the moment of inertia
  /// about the axis along w through the centre of the contact forces, R the mass centre's distance
  /// from it, and p^2 = m g R / I_O Housner's frequency parameter.
  double rocking_damping = 0.0;

  /// Lever arm a of rolling resistance [m], 0: none. A moment N a against w as above, N being the
  /// sum of the normal forces over the last step, times |w| / sqrt(w^2 + (0.01 rad/s)^2). It takes
  /// the work N a dtheta.
  double rolling_resistance = 0.0;

  /// Static friction relative to kinetic friction [1], 1: one value. The coefficient of a contact is
  /// mu = mu_k (1 + (friction_ratio - 1) exp(-|v| / friction_speed)), v its speed of slip before the
  /// step and mu_k the materials' coefficient.
  double friction_ratio = 1.0;
  double friction_speed = 0.01;  ///< [m/s]

  /// Tensile strength sigma of a bond between rock and pedestal [Pa], 0: none. It forms once the
  /// rock has rested for 0.1 s on three points or more. Over the area A of the footprint (convex
  /// hull of the vertices within 1 mm of the lowest) it draws the rock down with sigma A at the
  /// footprint's centroid, which the contacts bear. It breaks for good once the centroid has risen
  /// by 0.1 mm.
  double adhesion = 0.0;

  /// Tilt from the start at which a one-sided tether comes taut [rad], NaN: none. Beyond it a couple
  /// k (tilt - slack) + c d(tilt)/dt, never negative, turns the rock back; k = 800 m g h, h the
  /// height of the mass centre at the start, so that a fall through h stretches it by 0.05 rad; c is
  /// half the critical damping.
  double catch_slack = std::numeric_limits<double>::quiet_NaN();

  bool sets_impacts() const { return !std::isnan(impact_energy_ratio); }
  bool sets_friction() const { return friction_ratio != 1.0; }
  bool catches() const { return !std::isnan(catch_slack); }
  /// Some of them act on the rock's velocity.
  bool moves_rock() const {
    return sets_impacts() || rocking_damping > 0 || rolling_resistance > 0 || adhesion > 0 || catches();
  }
};

}  // namespace vsr2
