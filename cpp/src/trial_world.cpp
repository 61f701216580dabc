#include "trial_world.hpp"

#include <array>
#include <exception>

#include "vsr2/constants.hpp"
#include "vsr2/engines.hpp"

namespace vsr2 {
namespace {

bool finite(const RockState& rock) {
  return rock.p_WB.allFinite() && rock.q_WB.coeffs().allFinite() && rock.v_WB.allFinite() &&
         rock.w_WB.allFinite();
}

void append_row(std::vector<double>& log, double time, double commanded,
                double commanded_velocity, const PedestalState& pedestal, const RockState& rock) {
  const std::array<double, kLogColumns> row = {
      time, commanded, commanded_velocity, pedestal.position, pedestal.velocity,
      rock.p_WB.x(), rock.p_WB.y(), rock.p_WB.z(),
      rock.q_WB.x(), rock.q_WB.y(), rock.q_WB.z(), rock.q_WB.w(),
      rock.v_WB.x(), rock.v_WB.y(), rock.v_WB.z(),
      rock.w_WB.x(), rock.w_WB.y(), rock.w_WB.z()};
  log.insert(log.end(), row.begin(), row.end());
}

// Whether a fresh world at the pose of rest would have the same contacts. All corners of a box are found
// at once, the vertices of a hull one a step: it settles again, and borderline outcomes of a scanned rock
// shift with the contacts that it finds.
bool has_no_memory(const Scene& scene, const TrialResult& settled) {
  return settled.engine == EngineKind::fast && settled.handover == Handover::none &&
         std::holds_alternative<BoxPart>(scene.rock().parts.front());
}

}  // namespace

std::unique_ptr<World> world_with_rock(const std::shared_ptr<const Scene>& scene, Drive drive,
                                       const Pose& X_WB) {
  std::unique_ptr<World> world = make_world(scene, drive);
  world->spawn_rock(X_WB);
  return world;
}

void reserve_rows(std::vector<double>& log, std::int64_t steps, std::int64_t every,
                  std::int64_t doubles_a_row) {
  if (every > 0) log.reserve(log.size() + static_cast<std::size_t>((steps / every + 1) * doubles_a_row));
}

TrialWorld::TrialWorld(std::unique_ptr<World> world, const std::shared_ptr<const Scene>& scene,
                       Drive drive, const std::atomic<bool>& cancel, TrialResult& result)
    : world_(std::move(world)),
      engine_(choose_engine(*scene)),
      cancel_(cancel),
      result_(result),
      pedestal_spec_(scene->pedestal()),
      spatial_(drive == Drive::prescribed_spatial),
      dt_(scene->engine().time_step) {
  read();
}

void TrialWorld::note_engine() const {
  result_.engine = engine_;
  result_.handover = world_->handover();
}

Pose TrialWorld::on_pedestal() const {
  if (!spatial_) return {rock_.p_WB - Eigen::Vector3d(pedestal_.position, 0, 0), rock_.q_WB};
  const PedestalMotion motion = pedestal_motion();
  return {pedestal_spec_.p_WP0 + motion.R_WP.transpose() * (rock_.p_WB - motion.p_WP),
          Eigen::Quaterniond(motion.R_WP).conjugate() * rock_.q_WB};
}

bool TrialWorld::advance(const DriveTarget& target) {
  world_->step(target);
  ++result_.steps;
  read();
  if (!finite(rock_)) return end(Status::diverged);
  return !cancel_.load(std::memory_order_relaxed) || end(Status::cancelled);
}

void TrialWorld::carry(const DriveTarget& from, const DriveTarget& to) {
  world_->carry(from, to);
  read();
}

bool TrialWorld::settle(const RestCriterion& criterion, double timeout,
                        const DriveTarget& hold, std::int64_t log_every) {
  RestClock rest(criterion, dt_, swings());
  const std::int64_t limit = steps_in(timeout, dt_);
  reserve_rows(result_.log, limit, log_every, kLogColumns);
  if (spatial_) reserve_rows(result_.excursions, limit, log_every, kExcursionColumns);
  bool settled = limit == 0;
  for (std::int64_t i = 0; i < limit && !settled; ++i) {
    if (log_every > 0 && i % log_every == 0)
      log(static_cast<double>(i) * dt_, hold);
    if (!advance(hold)) return false;
    settled = rest.at_rest(rock_, pedestal_motion());
  }
  result_.settling_time = static_cast<double>(result_.steps) * dt_;
  for (std::size_t row = 0; row < result_.log.size(); row += kLogColumns)
    result_.log[row + kTime] -= result_.settling_time;
  return settled || end(Status::settling_timeout);
}

bool TrialWorld::stands_still() const {
  const PedestalMotion pedestal = pedestal_motion();
  return (rock_.v_WB - pedestal.velocity_at(rock_.p_WB)).norm() < kRest.standing_speed &&
         (rock_.w_WB - pedestal.w_WP).norm() < kRest.standing_rate;
}

bool TrialWorld::end(Status status) {
  result_.status = status;
  return false;
}

void TrialWorld::log(double time, const DriveTarget& target) {
  append_row(result_.log, time, target.position, target.velocity, pedestal_, rock_);
  if (!spatial_) return;
  const Excursion& x = pedestal_.excursion;
  result_.excursions.insert(result_.excursions.end(), {x.transverse, x.vertical, x.pitch});
}

void TrialWorld::read() {
  rock_ = world_->rock();
  pedestal_ = world_->pedestal();
}

SettledStart::SettledStart(std::shared_ptr<const Scene> scene, Drive drive, const Pose& X_WB0,
                           const RestCriterion& rest, double timeout, std::int64_t log_every)
    : scene_(std::move(scene)),
      drive_(drive),
      X_WB0_(X_WB0),
      rest_(rest),
      timeout_(timeout),
      log_every_(log_every) {
  if (!scene_) throw InvalidInput("the start has no scene");
  if (!(timeout >= 0)) throw InvalidInput("the settling time-out must be at least 0 s");
  if (log_every < 0) throw InvalidInput("log intervals must be at least 0");
}

const TrialResult& SettledStart::settle(const std::atomic<bool>& cancel) {
  std::call_once(once_, [&] {
    try {
      if (timeout_ == 0.0) {
        settled_.X_WB_settled = X_WB0_;
        settled_.settling_time = 0.0;
        settled_.status = Status::ok;
        return;
      }
      TrialWorld run(world_with_rock(scene_, drive_, X_WB0_), scene_, drive_, cancel, settled_);
      const bool rests = run.settle(rest_, timeout_, {}, log_every_);
      run.note_engine();
      if (!rests) return;
      settled_.X_WB_settled = {run.rock().p_WB, run.rock().q_WB};
      settled_.status = Status::ok;
      if (scene_->engine().skip_quiet && has_no_memory(*scene_, settled_) && run.stands_still())
        world_ = run.release();
    } catch (const std::exception& error) {
      settled_.status = Status::error;
      settled_.message = error.what();
    }
  });
  return settled_;
}

}  // namespace vsr2
