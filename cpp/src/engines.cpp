#include "vsr2/engines.hpp"

namespace vsr2 {

std::string describe(FastRefusal refusal) {
  switch (refusal) {
    case FastRefusal::none: return {};
    case FastRefusal::several_parts: return "the rock has more than one convex part";
    case FastRefusal::pedestal_not_a_box: return "the pedestal is not one box";
    case FastRefusal::no_friction_cone: return "friction is not bounded by a cone";
    case FastRefusal::rolling_friction: return "there is rolling friction";
    case FastRefusal::no_margin: return "the collision margin is 0";
  }
  return "unknown";
}

EngineKind choose_engine(const Scene& scene) {
  const EngineKind asked = scene.engine().kind;
  if (asked != EngineKind::automatic && asked != EngineKind::fast) return asked;
  const FastRefusal refusal = fast_refusal(scene);
  if (refusal == FastRefusal::none) return EngineKind::fast;
  if (asked == EngineKind::automatic) return EngineKind::exact;
  throw InvalidInput("the engine `fast` does not take this scene: " + describe(refusal) +
                         "; choose `auto` or `exact`",
                     InputFault::engine_domain);
}

std::unique_ptr<World> make_world(std::shared_ptr<const Scene> scene, Drive drive) {
  switch (choose_engine(*scene)) {
    case EngineKind::fast: return make_fast_world(std::move(scene), drive);
    case EngineKind::exact: return make_exact_world(std::move(scene), drive);
    default: return make_bullet_world(std::move(scene), drive);
  }
}

}  // namespace vsr2
