#include "vsr2/engines.hpp"

namespace vsr2 {
std::string to_string(EngineKind kind) {
  switch (kind) {
    case EngineKind::automatic: return "auto";
    case EngineKind::parity: return "parity";
    case EngineKind::exact: return "exact";
    case EngineKind::fast: return "fast";
  }
  return "unknown";
}

EngineKind choose_engine(const Scene& scene) {
  const EngineKind asked = scene.engine().kind;
  if (asked == EngineKind::automatic)
    return fast_domain_violation(scene).empty() ? EngineKind::fast : EngineKind::exact;
  if (asked == EngineKind::fast) {
    const std::string violation = fast_domain_violation(scene);
    if (!violation.empty())
      throw InvalidInput("the engine `fast` does not take this scene: " + violation +
                         "; choose `auto` or `exact`");
  }
  return asked;
}

std::unique_ptr<World> make_world(std::shared_ptr<const Scene> scene, Drive drive) {
  switch (choose_engine(*scene)) {
    case EngineKind::fast: return make_fast_world(std::move(scene), drive);
    case EngineKind::exact: return make_exact_world(std::move(scene), drive);
    default: return make_bullet_world(std::move(scene), drive);
  }
}

std::string engine_in_use(const World& world, EngineKind chosen) {
  if (const auto* fast = dynamic_cast<const FastWorld*>(&world)) {
    switch (fast->handover()) {
      case Handover::none: break;
      case Handover::off_the_top: return "fast, then exact (off the top)";
      case Handover::motor_on_a_slope: return "fast, then exact (motor on a slope)";
      case Handover::too_deep: return "fast, then exact (too deep)";
    }
  }
  return to_string(chosen);
}

}  // namespace vsr2
