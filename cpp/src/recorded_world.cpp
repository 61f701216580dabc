#include "vsr2/recorded_world.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "vsr2/engines.hpp"

namespace vsr2 {
namespace {

using Action = WorldState::Action;

void act(World& world, const Action& action) {
  const auto& v = action.values;
  switch (action.kind) {
    case WorldState::spawn:
      return world.spawn_rock({{v[0], v[1], v[2]}, Eigen::Quaterniond(v[6], v[3], v[4], v[5])});
    case WorldState::remove: return world.delete_rock();
    case WorldState::push: return world.set_rock_velocity({v[0], v[1], v[2]}, {v[3], v[4], v[5]});
    case WorldState::step: return world.step({v[0], v[1], {v[2], v[3], v[4]}});
    default: throw InvalidInput("the state is not one of a world");
  }
}

}  // namespace

bool Action::repeats(const Action& other) const {
  return kind == WorldState::step && kind == other.kind &&
         std::memcmp(values.data(), other.values.data(), sizeof values) == 0;
}

void WorldState::check() const {
  std::int64_t steps = 0;
  for (const Action& action : actions) {
    const bool known = action.kind >= spawn && action.kind <= step;
    const bool counted = action.kind == step ? action.times >= 1 : action.times == 1;
    if (!known || !counted ||
        !std::all_of(action.values.begin(), action.values.end(), [](double v) { return std::isfinite(v); }))
      throw InvalidInput("the state is not one of a world");
    if (action.kind != step) continue;
    if (action.times > kMaxSteps - steps)
      throw InvalidInput("a state of more than " + std::to_string(kMaxSteps) +
                         " time steps is neither saved nor restored");
    steps += action.times;
  }
}

RecordedWorld::RecordedWorld(std::shared_ptr<const Scene> scene, Drive drive)
    : scene_(std::move(scene)),
      drive_(drive),
      engine_(choose_engine(*scene_)),
      world_(make_world(scene_, drive)) {}

void RecordedWorld::note(const Action& action) {
  if (!actions_.empty() && action.repeats(actions_.back())) {
    ++actions_.back().times;
  } else {
    actions_.push_back(action);
  }
}

void RecordedWorld::spawn_rock(const Pose& X_WB) {
  const Eigen::Vector3d& p = X_WB.position;
  const Eigen::Quaterniond& q = X_WB.orientation;
  world_->spawn_rock(X_WB);
  note({WorldState::spawn, 1, {p.x(), p.y(), p.z(), q.x(), q.y(), q.z(), q.w()}});
}

void RecordedWorld::delete_rock() {
  world_->delete_rock();
  note({WorldState::remove, 1, {}});
}

void RecordedWorld::set_rock_velocity(const Eigen::Vector3d& v_WB, const Eigen::Vector3d& w_WB) {
  world_->set_rock_velocity(v_WB, w_WB);
  note({WorldState::push, 1, {v_WB.x(), v_WB.y(), v_WB.z(), w_WB.x(), w_WB.y(), w_WB.z()}});
}

void RecordedWorld::step(const DriveTarget& target) {
  const Excursion& x = target.excursion;
  world_->step(target);
  note({WorldState::step, 1, {target.position, target.velocity, x.transverse, x.vertical, x.pitch}});
}

std::pair<std::int64_t, bool> RecordedWorld::settle(const RestCriterion& criterion, double timeout) {
  require_rock(has_rock());
  const PedestalSpec& spec = scene_->pedestal();
  const PedestalState now = pedestal();
  DriveTarget hold{now.position, 0.0, now.excursion};
  if (spec.pitch_spring) hold.excursion.pitch = 0.0;
  const double dt = scene_->engine().time_step;
  RestClock rest(criterion, dt, spec.pitch_spring.has_value());
  const std::int64_t limit = steps_in(timeout, dt);
  for (std::int64_t i = 1; i <= limit; ++i) {
    step(hold);
    if (rest.at_rest(rock(), pedestal_motion(spec, pedestal()))) return {i, true};
  }
  return {limit, false};
}

WorldState RecordedWorld::save_state() const {
  WorldState state{drive_, actions_};
  state.check();
  return state;
}

void RecordedWorld::restore_state(const WorldState& state) {
  if (state.drive != drive_)
    throw InvalidInput("the state is of a world with another drive", Fault::drive);
  state.check();
  std::vector<Action> actions = state.actions;
  std::unique_ptr<World> world = make_world(scene_, drive_);
  for (const Action& action : actions)
    for (std::int64_t i = 0; i < action.times; ++i) act(*world, action);
  world_ = std::move(world);
  actions_ = std::move(actions);
}

}  // namespace vsr2
