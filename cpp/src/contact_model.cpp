#include "vsr2/contact_model.hpp"

#include <algorithm>

namespace vsr2 {
namespace {

// MAX_FRICTION in Bullet's btManifoldResult.
constexpr double kMaxFriction = 10.0;
double bounded(double value) { return std::clamp(value, -kMaxFriction, kMaxFriction); }

}  // namespace

ContactValues combine(const ContactValues& a, const ContactValues& b) {
  constexpr ContactKey friction = "lateral_friction";
  ContactValues pair;
  for (std::size_t i = 0; i < pair.all.size(); ++i) {
    const double of_a = a.all[i];
    const double of_b = b.all[i];
    double& value = pair.all[i];
    switch (kContactParameters[i].pair) {
      case PairRule::product: value = of_a * of_b; break;
      case PairRule::friction: value = bounded(of_a * of_b); break;
      case PairRule::lever: value = bounded(of_a * b[friction] + of_b * a[friction]); break;
      case PairRule::series: value = 1.0 / (1.0 / of_a + 1.0 / of_b); break;
      case PairRule::sum: value = of_a + of_b; break;
    }
  }
  return pair;
}

}  // namespace vsr2
