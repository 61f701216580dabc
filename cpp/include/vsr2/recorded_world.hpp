#pragma once
// A world whose state can be saved and restored, bit for bit, whatever its engine.

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "vsr2/rest.hpp"
#include "vsr2/world.hpp"

namespace vsr2 {

/// The state of a world: all that was done to it since it was built. Copies are independent; the
/// entries are plain numbers, so that bytes of them can be kept.
///
/// Bullet keeps state in its contact caches, its trees of bounding boxes and the order of its lists,
/// which no copy of contacts and velocities brings back to the bit. The same actions do, since a
/// world's bits depend on nothing else.
struct WorldState {
  enum Kind : std::int64_t { spawn, remove, push, step };
  struct Action {
    std::int64_t kind = step;
    std::int64_t times = 1;
    std::array<double, 7> values{};
    bool repeats(const Action& other) const;
  };
  /// Most time steps of a state, 2.8 hours at steps of 1 ms: a box on a flat top does them again in
  /// 16 s with the engine `fast`, in 10 minutes with `parity`.
  static constexpr std::int64_t kMaxSteps = 10'000'000;
  Drive drive = Drive::prescribed;
  std::vector<Action> actions;

  /// @throws InvalidInput if an action is none of a world: its kind, its count or a number that is not
  /// finite; or if there are more than kMaxSteps time steps.
  void check() const;
};

/// A world of the scene's engine that notes what is done to it: 72 bytes for each action, and one entry
/// for steps to the same set-point in a row.
class RecordedWorld final : public World {
 public:
  RecordedWorld(std::shared_ptr<const Scene> scene, Drive drive);

  void spawn_rock(const Pose& X_WB) override;
  void delete_rock() override;
  bool has_rock() const override { return world_->has_rock(); }
  void set_rock_velocity(const Eigen::Vector3d& v_WB, const Eigen::Vector3d& w_WB) override;
  void step(const DriveTarget& target) override;
  PedestalState pedestal() const override { return world_->pedestal(); }
  RockState rock() const override { return world_->rock(); }
  void contacts(std::vector<ContactPoint>& out) const override { world_->contacts(out); }
  Handover handover() const override { return world_->handover(); }
  EngineKind engine() const { return engine_; }

  /// Holds the pedestal where it is until the rock rests or `timeout` [s] is over. Returns the
  /// steps taken and whether it rests. @throws InvalidInput if there is no rock.
  std::pair<std::int64_t, bool> settle(const RestCriterion& criterion, double timeout);

  /// @throws InvalidInput after more than WorldState::kMaxSteps time steps.
  WorldState save_state() const;
  /// Goes on from a state of a world of the same scene: builds the world again and does again what
  /// led to the state, at the engine's speed. On an exception nothing has changed.
  /// @throws InvalidInput if the state is of another drive or cannot be done again here.
  void restore_state(const WorldState& state);

 private:
  void note(const WorldState::Action& action);

  std::shared_ptr<const Scene> scene_;
  Drive drive_;
  EngineKind engine_;
  std::unique_ptr<World> world_;
  std::vector<WorldState::Action> actions_;
};

}  // namespace vsr2
