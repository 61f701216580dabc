#include "vsr2/contact_model.hpp"

#include <algorithm>
#include <cmath>
#include <string>

namespace vsr2 {
namespace {
// Bullet bounds combined friction-like values (MAX_FRICTION in btManifoldResult).
constexpr double kMaxFriction = 10.0;
double bounded(double value) { return std::clamp(value, -kMaxFriction, kMaxFriction); }
}  // namespace

ContactPair combine(const Material& a, const Material& b) {
  return {
      .lateral_friction = bounded(a.lateral_friction * b.lateral_friction),
      .restitution = a.restitution * b.restitution,
      .spinning_friction = bounded(a.spinning_friction * b.lateral_friction +
                                   b.spinning_friction * a.lateral_friction),
      .damping = a.damping + b.damping,
      .stiffness = 1.0 / (1.0 / a.stiffness + 1.0 / b.stiffness),
  };
}

ContactSoftness contact_softness(double stiffness, double damping, double time_step) {
  const double denominator = time_step * stiffness + damping;
  if (!(time_step > 0) || !(stiffness >= 0) || !(damping >= 0) || !(denominator > 0)) {
    throw InvalidInput("contact softness needs time_step > 0, stiffness >= 0, damping >= 0, not both 0; got " +
                       std::to_string(time_step) + " s, " + std::to_string(stiffness) + " N/m, " +
                       std::to_string(damping) + " N s/m");
  }
  return {1.0 / denominator, time_step * stiffness / denominator};
}

double restitution_target(double restitution, double normal_velocity, double velocity_threshold) {
  if (std::abs(normal_velocity) < velocity_threshold) return 0.0;
  return std::max(0.0, -restitution * normal_velocity);
}

double inverse_mass_along(const Eigen::Vector3d& normal, double inverse_mass_a,
                          const Eigen::Matrix3d& inverse_inertia_a, const Eigen::Vector3d& r_a,
                          double inverse_mass_b, const Eigen::Matrix3d& inverse_inertia_b,
                          const Eigen::Vector3d& r_b) {
  const Eigen::Vector3d a = (inverse_inertia_a * r_a.cross(normal)).cross(r_a);
  const Eigen::Vector3d b = (inverse_inertia_b * r_b.cross(normal)).cross(r_b);
  return inverse_mass_a + inverse_mass_b + normal.dot(a) + normal.dot(b);
}

double normal_impulse(double rebound_target, double normal_velocity, double penetration,
                      const ContactSoftness& softness, double time_step, double inverse_mass) {
  const double rhs = rebound_target - normal_velocity + softness.erp * penetration / time_step;
  return std::max(0.0, rhs / (inverse_mass + softness.cfm / time_step));
}

}  // namespace vsr2
