#pragma once
// Closed-form expressions of the contact model (supplement S2). The engines do not call these:
// tests hold them against what Bullet uses in a running contact.

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

/// Softness of a contact row (supplement S2.2): cfm = 1 / (dt k + c) [s/kg], erp = dt k / (dt k + c).
struct ContactSoftness {
  double cfm;
  double erp;
};
/// @throws InvalidInput unless dt > 0, k >= 0, c >= 0 and dt k + c > 0.
ContactSoftness contact_softness(double stiffness, double damping, double time_step);

/// Target rebound speed (S2.2): -e u_n where the approach |u_n| reaches the threshold, else 0 [m/s].
double restitution_target(double restitution, double normal_velocity, double velocity_threshold);

/// Effective inverse mass along the normal, K_n (S2.2) [1/kg]; a static body has zero inverses.
double inverse_mass_along(const Eigen::Vector3d& normal, double inverse_mass_a,
                          const Eigen::Matrix3d& inverse_inertia_a, const Eigen::Vector3d& r_a,
                          double inverse_mass_b, const Eigen::Matrix3d& inverse_inertia_b,
                          const Eigen::Vector3d& r_b);

/// Normal impulse of one isolated contact (S2.2): with p the penetration depth counted negative
/// when the bodies are apart, lambda = (u_rest - u_n + erp p / dt) / (K_n + cfm / dt) [N s],
/// never negative.
///
/// Remarks on the supplement's print: its p is Bullet's signed distance, hence its minus sign;
/// Bullet divides cfm by dt, which the print leaves out; and the engine leaves the first 1e-5 m of
/// penetration uncorrected, so there p is the depth less that slop.
double normal_impulse(double rebound_target, double normal_velocity, double penetration,
                      const ContactSoftness& softness, double time_step, double inverse_mass);

}  // namespace vsr2
