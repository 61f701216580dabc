#pragma once
// The contact parameters of a pair of materials (supplement S2.1).

#include "vsr2/scene.hpp"

namespace vsr2 {

/// Effective values of a contact pair.
struct ContactPair {
  double lateral_friction;   ///< product (Eq. 1)
  double restitution;        ///< product (Eq. 1)
  double spinning_friction;  ///< mu_spin^a mu_lat^b + mu_spin^b mu_lat^a (Eq. 1) [m]
  double damping;            ///< sum [N s/m]
  double stiffness;          ///< in series [N/m]
};

/// Eq. 1 of supplement S2.1, with Bullet's bound of +-10 on friction-like values.
ContactPair combine(const Material& a, const Material& b);

}  // namespace vsr2
