#pragma once
// Bullet worlds for the engines built on them; private to the core.

#include <memory>
#include <optional>
#include <vector>

#include "pitch_joint.hpp"
#include "rock_mechanics.hpp"
#include "scene_shapes.hpp"
#include "vsr2/world.hpp"

class btMultiBodyConstraintSolver;

namespace vsr2 {

/// One cached contact point, in the frames Bullet keeps it in.
struct CachedContact {
  Eigen::Vector3d p_B;       ///< on the rock, in the rock's frame [m]
  Eigen::Vector3d p_P;       ///< on the pedestal, in the pedestal's frame [m]
  Eigen::Vector3d normal_W;  ///< from pedestal to rock, unit
};

/// A Bullet world that can start from another engine's state.
class BulletWorldBase : public World {
 public:
  /// As spawn_rock(), but a sprung pitch joint stays as it is.
  virtual void take_rock(const Pose& X_WB) = 0;
  virtual void set_pedestal(const PedestalState& state) = 0;
  /// Goes on with a sprung pitch joint, and the pedestal's pitch, where another engine left them.
  virtual void set_pitch_joint(const PitchJoint& joint) = 0;
  virtual const std::optional<PitchJoint>& pitch_joint() const = 0;
  /// Goes on with mechanisms where another engine left them. Needs a rock.
  virtual void set_mechanics(const RockMechanics& mechanics) = 0;
  /// Fills the contact cache between rock and pedestal, in the order given. Needs a rock, a
  /// pedestal of one convex part, and no step since the rock was spawned.
  virtual void set_contacts(const std::vector<CachedContact>& contacts) = 0;
};

/// `solver` and `rock_shape` replace Bullet's own solver and the scene's shape where given.
std::unique_ptr<BulletWorldBase> make_bullet_world_with(
    std::shared_ptr<const Scene> scene, Drive drive,
    std::unique_ptr<btMultiBodyConstraintSolver> solver, btCollisionShape* rock_shape);

}  // namespace vsr2
