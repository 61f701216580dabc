#include "vsr2/contact_model.hpp"

#include <algorithm>

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

}  // namespace vsr2
