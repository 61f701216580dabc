#pragma once
// Bullet's world for the engines that go on with it; private to the core.

#include <memory>
#include <optional>
#include <vector>

#include "pitch_joint.hpp"
#include "rock_mechanics.hpp"
#include "vsr2/world.hpp"

namespace vsr2 {

/// One cached contact point, in the frames Bullet keeps it in.
struct CachedContact {
  Eigen::Vector3d p_B;       ///< on the rock, in the rock's frame [m]
  Eigen::Vector3d p_P;       ///< on the pedestal, in the pedestal's frame [m]
  Eigen::Vector3d normal_W;  ///< from pedestal to rock, unit
};

/// Where another engine left a rock on a pedestal of one convex part.
struct HandedOver {
  PedestalState pedestal;
  std::optional<PitchJoint> joint;
  RockState rock;
  std::vector<CachedContact> contacts;  ///< in the order of the cache
  std::optional<RockMechanics> mechanics;
};

class BulletWorldBase : public World {
 public:
  /// Goes on from another engine's state. Needs a fresh world.
  virtual void take_over(const HandedOver& from) = 0;
  virtual const std::optional<PitchJoint>& pitch_joint() const = 0;
};

/// As make_exact_world().
std::unique_ptr<BulletWorldBase> make_exact_bullet_world(std::shared_ptr<const Scene> scene, Drive drive);

}  // namespace vsr2
