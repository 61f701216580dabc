// The `exact` engine: the `parity` world with a solver and hulls that give the same bits sooner.

#include "bullet_world.hpp"
#include "exact_solver.hpp"
#include "vsr2/engines.hpp"

namespace vsr2 {

std::unique_ptr<World> make_exact_world(std::shared_ptr<const Scene> scene, Drive drive) {
  btCollisionShape* rock = scene->shapes().scanned_rock;
  return make_bullet_world_with(std::move(scene), drive, std::make_unique<ExactSolver>(), rock);
}

}  // namespace vsr2
