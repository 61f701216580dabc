#include "vsr2/engines.hpp"

namespace vsr2 {

void require_fast(const Scene& scene) {
  if (fast_refusal(scene) != FastRefusal::none)
    throw InvalidInput("the engine `fast` does not take this scene; choose `auto` or `exact`",
                       Fault::engine_domain);
}

EngineKind choose_engine(const Scene& scene) {
  const EngineKind asked = scene.engine().kind;
  if (asked == EngineKind::fast) require_fast(scene);
  if (asked != EngineKind::automatic) return asked;
  return fast_refusal(scene) == FastRefusal::none ? EngineKind::fast : EngineKind::exact;
}

std::unique_ptr<World> make_world(std::shared_ptr<const Scene> scene, Drive drive) {
  switch (choose_engine(*scene)) {
    case EngineKind::fast: return make_fast_world(std::move(scene), drive);
    case EngineKind::exact: return make_exact_world(std::move(scene), drive);
    default: return make_bullet_world(std::move(scene), drive);
  }
}

}  // namespace vsr2
