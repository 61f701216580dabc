#include "vsr2/trial.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>

#include "drive_law.hpp"
#include "quiet_stretch.hpp"
#include "trial_world.hpp"
#include "vsr2/constants.hpp"
#include "vsr2/engines.hpp"

namespace vsr2 {
namespace {

// Bullet keeps at most so many contact points between two convex parts.
constexpr std::int64_t kManifoldPoints = 4;

void check(const TrialSpec& spec) {
  if (!spec.start) throw InvalidInput("the trial has no start");
  const std::size_t size = spec.position.size();
  if (size == 0) throw InvalidInput("the motion is empty");
  if (spec.velocity && spec.velocity->size() != size)
    throw InvalidInput("the motion's position and velocity differ in length");
  const auto all_finite = [](const Samples& values) {
    return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
  };
  if (!all_finite(spec.position) || (spec.velocity && !all_finite(*spec.velocity)))
    throw InvalidInput("the motion has a value that is not finite");
  for (const auto& channel : {spec.transverse, spec.vertical, spec.pitch}) {
    if (!channel) continue;
    if (spec.start->drive() != Drive::prescribed_spatial)
      throw InvalidInput("the motion has channels besides x; they need the drive prescribed_spatial",
                         Fault::drive);
    if (channel->size() != size)
      throw InvalidInput("the motion's channels differ in length");
    if (!all_finite(*channel)) throw InvalidInput("the motion has a value that is not finite");
  }
  check_drive(spec.start->scene()->pedestal(), spec.start->drive());
  if (spec.pitch && spec.start->scene()->pedestal().pitch_spring)
    throw InvalidInput(
        "the motion pitches, and the pedestal pitches on a spring; leave one of them out",
        Fault::drive);
  if (spec.log_every < 0 || spec.contacts_every < 0)
    throw InvalidInput("log intervals must be at least 0");
  if (!(spec.tail >= 0)) throw InvalidInput("the tail must be at least 0 s");
}

DriveTarget set_point(const TrialSpec& spec, std::size_t k, double velocity) {
  const auto at = [k](const auto& channel) { return channel ? (*channel)[k] : 0.0; };
  return {spec.position[k], velocity, {at(spec.transverse), at(spec.vertical), at(spec.pitch)}};
}

// The world in which the rock settled, unless the motion starts elsewhere.
std::unique_ptr<World> settled_world(const TrialSpec& spec) {
  const DriveTarget at = set_point(spec, 0, 0.0);
  const Excursion& x = at.excursion;
  const bool starts_there = at.position == 0 && x.transverse == 0 && x.vertical == 0 && x.pitch == 0;
  return starts_there ? spec.start->settled_world() : nullptr;
}

class Trial {
 public:
  Trial(const TrialSpec& spec, const std::atomic<bool>& cancel, const TrialResult& settled,
        TrialResult& result)
      : Trial(spec, settled_world(spec), cancel, settled, result) {}

  void run(const TrialResult& settled) {
    if (goes_on_) {
      result_.settling_time = 0.0;
    } else if (!settle_again()) {
      return;
    }
    // The shared settling came before this trial's own.
    std::vector<double> earlier = settled.log;
    for (std::size_t row = 0; row < earlier.size(); row += kLogColumns)
      earlier[row + kTime] -= result_.settling_time;
    result_.log.insert(result_.log.begin(), earlier.begin(), earlier.end());
    result_.excursions.insert(result_.excursions.begin(), settled.excursions.begin(),
                              settled.excursions.end());
    result_.settling_time += settled.settling_time;
    begin();
    if (shake() && (rests_to_end_ ? rest_through_tail() : come_to_rest())) judge();
    result_.log.shrink_to_fit();
    result_.excursions.shrink_to_fit();
    result_.contacts.shrink_to_fit();
    world_.note_engine();
  }

 private:
  Trial(const TrialSpec& spec, std::unique_ptr<World> world, const std::atomic<bool>& cancel,
        const TrialResult& settled, TrialResult& result)
      : spec_(spec),
        result_(result),
        goes_on_(world != nullptr),
        world_(world ? std::move(world)
                   : world_with_rock(spec.start->scene(), spec.start->drive(), settled.X_WB_settled),
             spec.start->scene(), spec.start->drive(), cancel, result),
        dt_(world_.dt()),
        size_(static_cast<std::int64_t>(spec.position.size())),
        tail_rest_(spec.tail_rest, dt_, world_.swings()),
        skips_(spec.start->scene()->engine().skip_quiet && spec.contacts_every == 0),
        quiet_(spec),
        still_({kQuietStretch.still_speed, kQuietStretch.still_rate, kQuietStretch.still_window}, dt_,
               world_.swings()) {
    if (goes_on_) still_.rested(still_.window_steps());
  }

  bool settle_again() {
    const SettledStart& start = *spec_.start;
    const bool rests =
        world_.settle(start.rest(), start.timeout(), set_point(spec_, 0, 0.0), start.log_every());
    world_.note_engine();
    return rests;
  }

  void begin() {
    const RockState& rock = world_.rock();
    result_.X_WB_settled = {rock.p_WB, rock.q_WB};
    double lowest = 0.0;
    for (const Eigen::Vector3d& vertex : spec_.start->scene()->rock_hull_vertices())
      lowest = std::min(lowest, (rock.q_WB * vertex).z());
    height_ = -lowest;
    result_.p_B_foot = rock.q_WB.conjugate() * Eigen::Vector3d(0, 0, lowest);
    settled_ = world_.on_pedestal();
    result_.peak_tilt = 0.0;
    result_.peak_tracking_error = 0.0;
    const auto steps = static_cast<std::int64_t>(spec_.position.size()) + steps_in(spec_.tail, dt_);
    reserve_rows(result_.log, steps, spec_.log_every, kLogColumns);
    if (spec_.start->drive() == Drive::prescribed_spatial)
      reserve_rows(result_.excursions, steps, spec_.log_every, kExcursionColumns);
    reserve_rows(result_.contacts, steps, spec_.contacts_every, kManifoldPoints * kContactColumns);
    contacts_.reserve(kManifoldPoints);
    observe(0, set_point(spec_, 0, 0.0));
  }

  // At step `k`, 0 at the start; past the motion it is held at its last set-point.
  DriveTarget target_at(std::int64_t k) const {
    if (k >= size_) return set_point(spec_, static_cast<std::size_t>(size_ - 1), 0.0);
    const auto i = static_cast<std::size_t>(k);
    if (i == 0) return set_point(spec_, i, 0.0);
    const Samples& x = spec_.position;
    return set_point(spec_, i, spec_.velocity ? (*spec_.velocity)[i] : (x[i] - x[i - 1]) / dt_);
  }

  bool shake() {
    while (true) {
      skip_quiet();
      if (shaken_ == size_ - 1) return true;
      const DriveTarget target = target_at(shaken_ + 1);
      if (!world_.advance(target)) return false;
      ++shaken_;
      observe(shaken_, target);
      if (overturned_ && spec_.stop_early) return true;
      if (skips_) still_.at_rest(world_.rock(), world_.pedestal_motion());
    }
  }

  // Passes over steps in which a rock at rest is bound to stay so.
  void skip_quiet() {
    if (!skips_) return;
    if (shaken_ < ask_from_) return;
    std::optional<std::int64_t> held;
    if (!still_.at_rest_for(1)) {
      held = world_.steps_held();
      if (*held < still_.window_steps()) return;
    }
    const QuietStretch quiet = quiet_.from(world_.world(), held, shaken_, size_);
    ask_from_ = quiet.ask_from;
    rests_to_end_ = quiet.last == size_;
    rest_until(std::min(quiet.last, size_ - 1));
  }

  void rest_until(std::int64_t k) {
    if (k <= shaken_) return;
    const auto carry_to = [&](std::int64_t at) { world_.carry(target_at(at - 1), target_at(at)); };
    const std::int64_t every = spec_.log_every;
    for (std::int64_t at = every > 0 ? (shaken_ / every + 1) * every : k; at < k; at += every) {
      carry_to(at);
      world_.log(static_cast<double>(at) * dt_, target_at(at));
    }
    carry_to(k);
    shaken_ = k;
    observe(k, target_at(k));
  }

  bool rest_through_tail() {
    const std::int64_t limit = steps_in(spec_.tail, dt_);
    const std::int64_t window = tail_rest_.window_steps();
    rest_until(shaken_ + (spec_.stop_early ? std::min(limit, window) : limit));
    if (limit > 0 && limit < window) world_.end(Status::tail_timeout);
    return true;
  }

  bool come_to_rest() {
    if (overturned_ && spec_.stop_early) return true;
    const std::int64_t limit = steps_in(spec_.tail, dt_);
    const DriveTarget hold = target_at(size_);
    bool resting = false;
    for (std::int64_t i = 0; i < limit; ++i) {
      if (!world_.advance(hold)) return false;
      ++shaken_;
      observe(shaken_, hold);
      if (overturned_ && spec_.stop_early) return true;
      resting = tail_rest_.at_rest(world_.rock(), world_.pedestal_motion());
      if (tail_rest_.quiet_steps() <= 1) {
        quiet_since_ = world_.on_pedestal();
        quiet_travel_ = travel();
      }
      if (spec_.stop_early && tail_rest_.at_rest_for(leans_ ? kRest.leaning_windows : 1) &&
          !creeps_on(limit - i - 1))
        return true;
    }
    if (!resting && limit > 0) world_.end(Status::tail_timeout);
    return true;
  }

  void observe(std::int64_t k, const DriveTarget& target) {
    const Pose rock = world_.on_pedestal();
    const double tilt = tilt_from(settled_.orientation, rock.orientation);
    result_.peak_tilt = std::max(result_.peak_tilt, tilt);
    leans_ = tilt >= spec_.outcome.rocked_tilt;
    result_.peak_tracking_error =
        std::max(result_.peak_tracking_error, std::abs(world_.pedestal().position - target.position));
    const bool fallen = rock.position.z() < settled_.position.z() - height_;
    if (!overturned_ && (tilt >= spec_.outcome.overturned_tilt || fallen)) {
      overturned_ = true;
      result_.overturning_time = static_cast<double>(k) * dt_;
    }
    const double time = static_cast<double>(k) * dt_;
    if (spec_.log_every > 0 && k % spec_.log_every == 0) world_.log(time, target);
    if (spec_.contacts_every > 0 && k % spec_.contacts_every == 0) log_contacts(time);
  }

  void log_contacts(double time) {
    world_.world().contacts(contacts_);
    for (const ContactPoint& contact : contacts_) {
      const auto row = contact_row(time, contact);
      result_.contacts.insert(result_.contacts.end(), row.begin(), row.end());
    }
  }

  // Of the foot over the pedestal.
  Eigen::Vector3d travel() const {
    const auto foot = [&](const Pose& X) {
      return Eigen::Vector3d(X.position + X.orientation * result_.p_B_foot);
    };
    if (spec_.start->drive() == Drive::prescribed_spatial)
      return foot(world_.on_pedestal()) - foot(settled_);
    Eigen::Vector3d out =
        foot({world_.rock().p_WB, world_.rock().q_WB}) - foot(result_.X_WB_settled);
    out.x() -= world_.pedestal().position - spec_.position[0];
    return out;
  }

  // Whether so many more steps at the speed of the quiet time so far could change slid or rotated.
  bool creeps_on(std::int64_t steps) const {
    const double times = kRest.creep_allowance * static_cast<double>(steps) /
                         static_cast<double>(std::max<std::int64_t>(1, tail_rest_.quiet_steps() - 1));
    const Eigen::Quaterniond now = world_.on_pedestal().orientation;
    const Eigen::Vector3d gone = travel();
    const double slip = gone.head<2>().norm();
    const double yaw = std::abs(yaw_from(settled_.orientation, now));
    const double crept = (gone - quiet_travel_).head<2>().norm();
    const double turned = std::abs(yaw_from(quiet_since_.orientation, now));
    return times * crept >= std::abs(spec_.outcome.slid_distance - slip) ||
           times * turned >= std::abs(spec_.outcome.rotated_angle - yaw);
  }

  void judge() {
    if (result_.status == Status::not_run) result_.status = Status::ok;
    const OutcomeThresholds& limit = spec_.outcome;
    const Pose rock = world_.on_pedestal();
    result_.final_slip = travel().head<2>().norm();
    result_.simulated_time = static_cast<double>(shaken_) * dt_;
    result_.final_tilt = tilt_from(settled_.orientation, rock.orientation);
    result_.final_yaw = yaw_from(settled_.orientation, rock.orientation);
    if (overturned_ || result_.final_tilt >= limit.toppled_tilt) {
      result_.outcome = Outcome::overturned;
    } else if (std::abs(result_.final_yaw) >= limit.rotated_angle) {
      result_.outcome = Outcome::rotated;
    } else if (result_.final_slip >= limit.slid_distance) {
      result_.outcome = Outcome::slid;
    } else if (result_.peak_tilt >= limit.rocked_tilt) {
      result_.outcome = Outcome::rocked;
    } else {
      result_.outcome = Outcome::stable;
    }
  }

  const TrialSpec& spec_;
  TrialResult& result_;
  bool goes_on_;  ///< with the world in which the rock settled
  TrialWorld world_;
  double dt_;
  std::int64_t size_;  ///< set-points of the motion
  RestClock tail_rest_;
  bool skips_;  ///< quiet stretches; logs of contacts need every step
  QuietStretches quiet_;
  RestClock still_;
  std::int64_t ask_from_ = 0;  ///< set-point
  bool rests_to_end_ = false;
  std::vector<ContactPoint> contacts_;
  Pose settled_;  ///< on the pedestal
  Pose quiet_since_;  ///< on the pedestal, when the rock was last not slow
  Eigen::Vector3d quiet_travel_ = Eigen::Vector3d::Zero();
  double height_ = 0.0;
  std::int64_t shaken_ = 0;
  bool overturned_ = false;
  bool leans_ = false;
};

}  // namespace

std::array<double, kContactColumns> contact_row(double time, const ContactPoint& c) {
  return {time,
          c.p_W_rock.x(), c.p_W_rock.y(), c.p_W_rock.z(),
          c.p_W_pedestal.x(), c.p_W_pedestal.y(), c.p_W_pedestal.z(),
          c.normal_W.x(), c.normal_W.y(), c.normal_W.z(),
          c.distance, c.normal_impulse, c.lateral_impulse_1, c.lateral_impulse_2,
          c.direction_1.x(), c.direction_1.y(), c.direction_1.z(),
          c.direction_2.x(), c.direction_2.y(), c.direction_2.z()};
}

double tilt_from(const Eigen::Quaterniond& q_WB0, const Eigen::Quaterniond& q_WB) {
  // The turn q = q_WB q_WB0* takes the vertical to a direction with z component
  // 1 - 2 (x^2 + y^2); the half-angle form keeps its digits near 0.
  const Eigen::Quaterniond q = q_WB * q_WB0.conjugate();
  const double sine = std::min(1.0, std::hypot(q.x(), q.y()) / q.norm());
  return 2.0 * std::asin(sine);
}

double yaw_from(const Eigen::Quaterniond& q_WB0, const Eigen::Quaterniond& q_WB) {
  const Eigen::Quaterniond q = q_WB * q_WB0.conjugate();
  double yaw = 2.0 * std::atan2(q.z(), q.w());
  if (yaw > M_PI) yaw -= 2.0 * M_PI;
  if (yaw < -M_PI) yaw += 2.0 * M_PI;
  return yaw;
}

TrialResult run_trial(const TrialSpec& spec, const std::atomic<bool>& cancel) {
  TrialResult result;
  try {
    check(spec);
    const TrialResult& settled = spec.start->settle(cancel);
    if (settled.status != Status::ok) {
      result = settled;
      result.steps = 0;  // those of the shared settling are no trial's own
    } else {
      Trial(spec, cancel, settled, result).run(settled);
    }
  } catch (const std::exception& error) {
    result.status = Status::error;
    result.outcome = Outcome::failed;
    result.message = error.what();
  }
  return result;
}

}  // namespace vsr2
