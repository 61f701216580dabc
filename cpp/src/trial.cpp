#include "vsr2/trial.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <sstream>

#include "vsr2/engines.hpp"

namespace vsr2 {
namespace {

// Bullet keeps at most so many contact points between two convex parts.
constexpr std::int64_t kManifoldPoints = 4;

// A rock that leans may be about to leave its point of balance, where its speed grows as
// exp(sqrt(m g r / I) t); it must keep still for so many windows before the trial is stopped early.
constexpr std::int64_t kLeaningWindows = 8;

std::string seconds(double value) {
  std::ostringstream text;
  text << value;
  return text.str();
}

bool finite(const RockState& rock) {
  return rock.p_WB.allFinite() && rock.q_WB.coeffs().allFinite() && rock.v_WB.allFinite() &&
         rock.w_WB.allFinite();
}

std::int64_t steps_in(double time, double time_step) {
  return static_cast<std::int64_t>(std::llround(time / time_step));
}

// Makes room for the rows of so many time steps, so that stepping allocates nothing. Memory that is
// never written to is not resident.
void reserve_rows(std::vector<double>& log, std::int64_t steps, std::int64_t every,
                  std::int64_t doubles_a_row) {
  if (every > 0) log.reserve(log.size() + static_cast<std::size_t>((steps / every + 1) * doubles_a_row));
}

// Counts how long the rock has been slow relative to the pedestal without a break.
class RestClock {
 public:
  RestClock(const RestCriterion& criterion, double time_step)
      : criterion_(criterion),
        needed_(std::max<std::int64_t>(1, std::llround(criterion.window / time_step))) {}
  bool at_rest(const RockState& rock, const PedestalState& pedestal) {
    const Eigen::Vector3d v = rock.v_WB - Eigen::Vector3d(pedestal.velocity, 0, 0);
    const bool slow = v.norm() < criterion_.linear_speed && rock.w_WB.norm() < criterion_.angular_speed;
    quiet_ = slow ? quiet_ + 1 : 0;
    return at_rest_for(1);
  }
  bool at_rest_for(std::int64_t windows) const { return quiet_ >= windows * needed_; }

 private:
  RestCriterion criterion_;
  std::int64_t needed_;
  std::int64_t quiet_ = 0;
};

void check(const TrialSpec& spec) {
  if (!spec.start) throw InvalidInput("the trial has no start");
  if (!spec.position || spec.position->empty()) throw InvalidInput("the motion is empty");
  if (spec.velocity && spec.velocity->size() != spec.position->size())
    throw InvalidInput("the motion's position and velocity differ in length");
  const auto all_finite = [](const std::vector<double>& values) {
    return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
  };
  if (!all_finite(*spec.position) || (spec.velocity && !all_finite(*spec.velocity)))
    throw InvalidInput("the motion has a value that is not finite");
  if (spec.log_every < 0 || spec.contacts_every < 0)
    throw InvalidInput("log intervals must be at least 0");
  if (!(spec.tail >= 0)) throw InvalidInput("the tail must be at least 0 s");
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

// One world with a rock in it, and what of its story both settling and shaking need.
class Run {
 public:
  Run(const std::shared_ptr<const Scene>& scene, Drive drive, const Pose& X_WB,
      const std::atomic<bool>& cancel, TrialResult& result)
      : world_(make_world(scene, drive)),
        engine_(choose_engine(*scene)),
        cancel_(cancel),
        result_(result),
        dt_(scene->engine().time_step) {
    world_->spawn_rock(X_WB);
    read();
  }

  const World& world() const { return *world_; }
  std::string engine() const { return engine_in_use(*world_, engine_); }
  const RockState& rock() const { return rock_; }
  const PedestalState& pedestal() const { return pedestal_; }
  double dt() const { return dt_; }

  // Advances one step; false: the trial ends here (diverged or cancelled).
  bool advance(double position, double velocity) {
    world_->step({position, velocity});
    ++result_.steps;
    read();
    if (!finite(rock_)) {
      result_.status = Status::diverged;
      result_.message = "the rock's state became infinite or NaN at step " +
                        std::to_string(result_.steps) +
                        "; check contact stiffness, damping and the time step";
      return false;
    }
    if (cancel_.load(std::memory_order_relaxed)) {
      result_.status = Status::cancelled;
      result_.message = "cancelled";
      return false;
    }
    return true;
  }

  // Holds the pedestal until the rock rests. Log rows get times up to 0 at the end of settling.
  bool settle(const RestCriterion& criterion, double timeout, double position,
              std::int64_t log_every) {
    RestClock rest(criterion, dt_);
    const std::int64_t limit = steps_in(timeout, dt_);
    reserve_rows(result_.log, limit, log_every, kLogColumns);
    bool settled = limit == 0;
    for (std::int64_t i = 0; i < limit && !settled; ++i) {
      if (log_every > 0 && i % log_every == 0)
        append_row(result_.log, static_cast<double>(i) * dt_, position, 0.0, pedestal_, rock_);
      if (!advance(position, 0.0)) return false;
      settled = rest.at_rest(rock_, pedestal_);
    }
    result_.settling_time = static_cast<double>(result_.steps) * dt_;
    for (std::size_t row = 0; row < result_.log.size(); row += kLogColumns)
      result_.log[row + kTime] -= result_.settling_time;
    if (!settled) {
      result_.status = Status::settling_timeout;
      result_.message = "the rock did not come to rest within " + seconds(timeout) +
                        " s before the motion; raise settling.timeout or the rest speeds, or start "
                        "it nearer to equilibrium";
    }
    return settled;
  }

 private:
  void read() {
    rock_ = world_->rock();
    pedestal_ = world_->pedestal();
  }

  std::unique_ptr<World> world_;
  EngineKind engine_;
  const std::atomic<bool>& cancel_;
  TrialResult& result_;
  double dt_;
  RockState rock_;
  PedestalState pedestal_;
};

class Trial {
 public:
  Trial(const TrialSpec& spec, const std::atomic<bool>& cancel, const TrialResult& settled,
        TrialResult& result)
      : spec_(spec),
        result_(result),
        run_(spec.start->scene(), spec.start->drive(), settled.X_WB_settled, cancel, result),
        dt_(run_.dt()),
        tail_rest_(spec.tail_rest, dt_) {}

  void run(const TrialResult& settled) {
    const SettledStart& start = *spec_.start;
    if (!run_.settle(start.rest(), start.timeout(), spec_.position->front(), start.log_every()))
      return;
    // The shared settling came before this trial's own.
    std::vector<double> earlier = settled.log;
    for (std::size_t row = 0; row < earlier.size(); row += kLogColumns)
      earlier[row + kTime] -= result_.settling_time;
    result_.log.insert(result_.log.begin(), earlier.begin(), earlier.end());
    result_.settling_time += settled.settling_time;
    begin();
    if (shake() && come_to_rest()) judge();
    result_.log.shrink_to_fit();
    result_.contacts.shrink_to_fit();
    result_.engine = run_.engine();
  }

 private:
  void begin() {
    const RockState& rock = run_.rock();
    result_.X_WB_settled = {rock.p_WB, rock.q_WB};
    double lowest = 0.0;
    for (const Eigen::Vector3d& vertex : spec_.start->scene()->rock_hull_vertices())
      lowest = std::min(lowest, (rock.q_WB * vertex).z());
    height_ = -lowest;
    result_.p_B_foot = rock.q_WB.conjugate() * Eigen::Vector3d(0, 0, lowest);
    result_.peak_tilt = 0.0;
    result_.peak_tracking_error = 0.0;
    const auto steps = static_cast<std::int64_t>(spec_.position->size()) + steps_in(spec_.tail, dt_);
    reserve_rows(result_.log, steps, spec_.log_every, kLogColumns);
    reserve_rows(result_.contacts, steps, spec_.contacts_every, kManifoldPoints * kContactColumns);
    contacts_.reserve(kManifoldPoints);
    observe(0, spec_.position->front(), 0.0);
  }

  bool shake() {
    const std::vector<double>& x = *spec_.position;
    for (std::size_t k = 1; k < x.size(); ++k) {
      const double v = spec_.velocity ? (*spec_.velocity)[k] : (x[k] - x[k - 1]) / dt_;
      if (!run_.advance(x[k], v)) return false;
      ++shaken_;
      observe(shaken_, x[k], v);
      if (overturned_ && spec_.stop_early) return true;
    }
    return true;
  }

  bool come_to_rest() {
    if (overturned_ && spec_.stop_early) return true;
    const std::int64_t limit = steps_in(spec_.tail, dt_);
    const double position = spec_.position->back();
    bool resting = false;
    for (std::int64_t i = 0; i < limit; ++i) {
      if (!run_.advance(position, 0.0)) return false;
      ++shaken_;
      observe(shaken_, position, 0.0);
      if (overturned_ && spec_.stop_early) return true;
      resting = tail_rest_.at_rest(run_.rock(), run_.pedestal());
      if (spec_.stop_early && tail_rest_.at_rest_for(leans_ ? kLeaningWindows : 1)) return true;
    }
    if (!resting && limit > 0) {
      result_.status = Status::tail_timeout;
      result_.message = "the rock was still moving " + seconds(spec_.tail) +
                        " s after the motion; the outcome is of that state";
    }
    return true;
  }

  void observe(std::int64_t k, double commanded, double commanded_velocity) {
    const double tilt = tilt_from(result_.X_WB_settled.orientation, run_.rock().q_WB);
    result_.peak_tilt = std::max(result_.peak_tilt, tilt);
    leans_ = tilt >= spec_.outcome.rocked_tilt;
    result_.peak_tracking_error =
        std::max(result_.peak_tracking_error, std::abs(run_.pedestal().position - commanded));
    const bool fallen = run_.rock().p_WB.z() < result_.X_WB_settled.position.z() - height_;
    if (!overturned_ && (tilt >= spec_.outcome.overturned_tilt || fallen)) {
      overturned_ = true;
      result_.overturning_time = static_cast<double>(k) * dt_;
    }
    const double time = static_cast<double>(k) * dt_;
    if (spec_.log_every > 0 && k % spec_.log_every == 0)
      append_row(result_.log, time, commanded, commanded_velocity, run_.pedestal(), run_.rock());
    if (spec_.contacts_every > 0 && k % spec_.contacts_every == 0) log_contacts(time);
  }

  void log_contacts(double time) {
    run_.world().contacts(contacts_);
    for (const ContactPoint& c : contacts_) {
      const std::array<double, kContactColumns> row = {
          time, c.p_W_rock.x(), c.p_W_rock.y(), c.p_W_rock.z(), c.p_W_pedestal.x(),
          c.p_W_pedestal.y(), c.p_W_pedestal.z(), c.normal_W.x(), c.normal_W.y(), c.normal_W.z(),
          c.distance, c.normal_impulse, c.lateral_impulse_1, c.lateral_impulse_2,
          c.direction_1.x(), c.direction_1.y(), c.direction_1.z(),
          c.direction_2.x(), c.direction_2.y(), c.direction_2.z()};
      result_.contacts.insert(result_.contacts.end(), row.begin(), row.end());
    }
  }

  void judge() {
    if (result_.status == Status::not_run) result_.status = Status::ok;
    const Pose& settled = result_.X_WB_settled;
    const RockState& rock = run_.rock();
    const OutcomeThresholds& limit = spec_.outcome;
    const Eigen::Vector3d foot = rock.p_WB + rock.q_WB * result_.p_B_foot;
    const Eigen::Vector3d foot0 = settled.position + settled.orientation * result_.p_B_foot;
    Eigen::Vector3d travel = foot - foot0;
    travel.x() -= run_.pedestal().position - spec_.position->front();
    result_.simulated_time = static_cast<double>(shaken_) * dt_;
    result_.final_tilt = tilt_from(settled.orientation, rock.q_WB);
    result_.final_slip = travel.head<2>().norm();
    result_.final_yaw = yaw_from(settled.orientation, rock.q_WB);
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
  Run run_;
  double dt_;
  RestClock tail_rest_;
  std::vector<ContactPoint> contacts_;
  double height_ = 0.0;
  std::int64_t shaken_ = 0;
  bool overturned_ = false;
  bool leans_ = false;
};

}  // namespace

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
      Run run(scene_, drive_, X_WB0_, cancel, settled_);
      if (!run.settle(rest_, timeout_, 0.0, log_every_)) return;
      settled_.X_WB_settled = {run.rock().p_WB, run.rock().q_WB};
      settled_.status = Status::ok;
    } catch (const std::exception& error) {
      settled_.status = Status::error;
      settled_.message = error.what();
    }
  });
  return settled_;
}

TrialResult run_trial(const TrialSpec& spec, const std::atomic<bool>& cancel) {
  TrialResult result;
  try {
    check(spec);
    const TrialResult& settled = spec.start->settle(cancel);
    if (settled.status != Status::ok) {
      result.status = settled.status;
      result.message = settled.message;
      result.settling_time = settled.settling_time;
      result.log = settled.log;
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
