#pragma once
// The engines: which there are, which a scene gets, and their worlds.

#include <memory>

#include "vsr2/world.hpp"

namespace vsr2 {

/// The engine a scene gets: the one asked for; `automatic`: `fast` where it takes the scene, else
/// `exact`. @throws InvalidInput if `fast` is asked for and does not take the scene.
EngineKind choose_engine(const Scene& scene);

/// A world of the engine that choose_engine() names.
std::unique_ptr<World> make_world(std::shared_ptr<const Scene> scene, Drive drive);

/// The engine `parity`: a world that steps as PyBullet does, bit for bit where `createMultiBody` made
/// its bodies.
std::unique_ptr<World> make_bullet_world(std::shared_ptr<const Scene> scene, Drive drive);
/// The engine `exact`: the same bits on every step, at about twice its speed.
std::unique_ptr<World> make_exact_world(std::shared_ptr<const Scene> scene, Drive drive);
/// The engine `fast`: a stepper of its own for one convex rock on the flat top of a box pedestal.
///
/// It follows Bullet's contact model: persistent contacts with its reduction to four points, soft
/// normal rows, restitution, lateral friction within a cone, spinning friction, its damping and
/// its order of integration. Without a residual threshold long runs of the solver's sweeps are taken
/// at once. Where the rock leaves the top it builds a Bullet world with the same state and contacts
/// and goes on with that.
/// @throws InvalidInput if fast_refusal() names a reason.
std::unique_ptr<World> make_fast_world(std::shared_ptr<const Scene> scene, Drive drive);

/// Why the engine `fast` does not take a scene.
enum class FastRefusal {
  none,                ///< it does
  several_parts,       ///< the rock has more than one convex part
  pedestal_not_a_box,
  no_friction_cone,
  contact_parameter,   ///< one that `fast` has not is above 0 (kContactParameters)
  no_margin,           ///< a hull without collision margin
};
FastRefusal fast_refusal(const Scene& scene);
/// @throws InvalidInput if it names a reason.
void require_fast(const Scene& scene);

}  // namespace vsr2
