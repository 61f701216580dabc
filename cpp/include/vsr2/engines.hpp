#pragma once
// The engines: which there are, which a scene gets, and the worlds faster than Bullet's own.

#include <memory>
#include <string>

#include "vsr2/world.hpp"

namespace vsr2 {

std::string to_string(EngineKind kind);

/// The engine a scene gets: the one asked for; `automatic`: `fast` where it takes the scene, else
/// `exact`. @throws InvalidInput if `fast` is asked for and does not take the scene.
EngineKind choose_engine(const Scene& scene);

/// A world of the engine that choose_engine() names.
std::unique_ptr<World> make_world(std::shared_ptr<const Scene> scene, Drive drive);

/// Name of the engine a world has run with so far, a hand-over included.
std::string engine_in_use(const World& world, EngineKind chosen);

/// A world with the same bits as make_bullet_world() on every step, at more than twice its speed.
std::unique_ptr<World> make_exact_world(std::shared_ptr<const Scene> scene, Drive drive);

/// Why a fast world went on with Bullet.
enum class Handover {
  none,
  off_the_top,  ///< the rock's lowest point came near the edge of the pedestal's top
  motor_on_a_slope,  ///< a motor along x drives a top that is not level
  too_deep,     ///< the rock went deeper into the pedestal than the contact geometry holds for
};

/// A world with a stepper of its own for one convex rock on the flat top of a box pedestal.
///
/// It follows Bullet's contact model: persistent contacts with its reduction to four points, soft
/// normal rows, restitution, lateral friction within a cone, spinning friction, its damping and
/// its order of integration. Where the rock leaves the top it builds a Bullet world with the same
/// state and contacts and goes on with that.
class FastWorld : public World {
 public:
  virtual Handover handover() const = 0;
  /// Sweeps of the latest solver step that were done one by one; 0 after a handover.
  virtual int iterations() const = 0;
};

struct FastSettings {
  /// The solver stops once no row changed its speed by more than the root of this [(m/s)^2], or of
  /// the scene's own threshold if that is greater. 0: none ends early, and long runs of sweeps are
  /// taken at once.
  double residual_threshold = 0.0;
};

/// Why make_fast_world() does not take a scene; empty if it does.
std::string fast_domain_violation(const Scene& scene);

/// @throws InvalidInput if fast_domain_violation() names a reason.
std::unique_ptr<FastWorld> make_fast_world(std::shared_ptr<const Scene> scene, Drive drive,
                                           const FastSettings& settings = {});

}  // namespace vsr2
