#pragma once
// The world of a trial, and what of its course both settling and shaking need; private to the core.

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>

#include "foothold.hpp"
#include "vsr2/trial.hpp"

namespace vsr2 {

/// A fresh world with a rock at rest at X_WB.
std::unique_ptr<World> world_with_rock(const std::shared_ptr<const Scene>& scene, Drive drive,
                                       const Pose& X_WB);

/// Makes room for the rows of so many time steps, so that stepping allocates nothing. Memory that is
/// never written to is not resident.
void reserve_rows(std::vector<double>& log, std::int64_t steps, std::int64_t every,
                  std::int64_t doubles_a_row);

/// Steps a world with a rock in it and notes in `result` what happens.
class TrialWorld {
 public:
  TrialWorld(std::unique_ptr<World> world, const std::shared_ptr<const Scene>& scene, Drive drive,
             const std::atomic<bool>& cancel, TrialResult& result);

  const World& world() const { return *world_; }
  std::unique_ptr<World> release() { return std::move(world_); }
  void note_engine() const;
  const RockState& rock() const { return rock_; }
  const PedestalState& pedestal() const { return pedestal_; }
  /// With v and w over the latest step.
  PedestalMotion pedestal_motion() const { return vsr2::pedestal_motion(pedestal_spec_, pedestal_); }
  /// The rock's pose seen from a pedestal that has not moved.
  Pose on_pedestal() const;
  double dt() const { return dt_; }
  bool swings() const { return pedestal_spec_.pitch_spring.has_value(); }
  std::int64_t steps_held() const { return world_->steps_held(); }

  /// Advances one step; false: the trial ends here (diverged or cancelled).
  bool advance(const DriveTarget& target);
  /// Moves pedestal and rock as one body.
  void carry(const DriveTarget& from, const DriveTarget& to);
  /// Holds the pedestal until the rock rests. Log rows get times up to 0 at the end of settling.
  bool settle(const RestCriterion& criterion, double timeout, const DriveTarget& hold,
              std::int64_t log_every);
  /// Whether the rock has come to rest altogether.
  bool stands_still() const;
  /// Notes how the trial ends; false.
  bool end(Status status);
  void log(double time, const DriveTarget& target);

 private:
  void read();

  std::unique_ptr<World> world_;
  EngineKind engine_;
  const std::atomic<bool>& cancel_;
  TrialResult& result_;
  const PedestalSpec& pedestal_spec_;  // the world keeps its scene
  bool spatial_;
  double dt_;
  RockState rock_;
  PedestalState pedestal_;
};

}  // namespace vsr2
