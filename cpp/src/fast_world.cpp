// The `fast` engine: FastStepper while the rock stands on the pedestal's top, Bullet from where it
// leaves it.

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "bullet_world.hpp"
#include "drive_law.hpp"
#include "fast_stepper.hpp"
#include "foothold.hpp"
#include "scene_shapes.hpp"
#include "vsr2/constants.hpp"
#include "vsr2/engines.hpp"

namespace vsr2 {
namespace {

class FastWorld final : public World {
 public:
  FastWorld(std::shared_ptr<const Scene> scene, Drive drive)
      : scene_(std::move(scene)),
        drive_(drive),
        stepper_(scene_->shapes().fast_model) {
    check_drive(scene_->pedestal(), drive_);
    const EngineSettings& engine = scene_->engine();
    if (scene_->pedestal().pitch_spring)
      joint_.emplace(*scene_, engine.time_step / engine.substeps);
    touches_.reserve(4);
    const Pose& X_LP = stepper_.model().X_LP;
    p_LP_ = X_LP.position;
    R_LP_ = X_LP.orientation.toRotationMatrix();
    top_is_turned_ = !R_LP_.isIdentity(0.0);
  }

  void spawn_rock(const Pose& X_WB) override {
    require_no_rock(has_rock_);
    check_start(X_WB);
    const RockState rock{X_WB.position, X_WB.orientation.normalized(), Eigen::Vector3d::Zero(),
                         Eigen::Vector3d::Zero()};
    if (joint_) {
      joint_->start(rock, pedestal_);
      pedestal_.excursion.pitch = joint_->pitch();
    }
    stepper_.clear();
    stepper_.state = rock;
    has_rock_ = true;
    if (RockMechanics::needed(*scene_)) {
      mechanics_.emplace(*scene_);
      mechanics_->start(stepper_.state, pedestal_motion(scene_->pedestal(), pedestal_));
    }
  }

  void delete_rock() override {
    require_rock(has_rock_);
    has_rock_ = false;
    diverged_ = false;
    mechanics_.reset();
    if (!bullet_) return;
    pedestal_ = bullet_->pedestal();
    joint_ = bullet_->pitch_joint();
    bullet_.reset();
    handover_ = Handover::none;
  }

  bool has_rock() const override { return has_rock_; }

  void set_rock_velocity(const Eigen::Vector3d& v_WB, const Eigen::Vector3d& w_WB) override {
    require_rock(has_rock_);
    if (bullet_) {
      bullet_->set_rock_velocity(v_WB, w_WB);
    } else {
      stepper_.state.v_WB = v_WB;
      stepper_.state.w_WB = w_WB;
    }
  }

  void step(const DriveTarget& target) override {
    if (bullet_) return bullet_->step(target);
    check_target(scene_->pedestal(), drive_, target);
    const EngineSettings& engine = scene_->engine();
    const double dt = engine.time_step / engine.substeps;
    const PedestalState start = pedestal_;
    FastStepper::Snapshot before;
    std::optional<RockMechanics> mechanics_before;
    std::optional<PitchJoint> joint_before;
    if (engine.substeps > 1) {
      before = stepper_.snapshot();
      mechanics_before = mechanics_;
      joint_before = joint_;
    }
    for (int i = 1; i <= engine.substeps; ++i) {
      if (substep(target, dt, start, i)) continue;
      // Bullet takes whole steps, so this one is its from the start.
      if (i > 1) {
        stepper_.restore(before);
        mechanics_ = mechanics_before;
        joint_ = joint_before;
        pedestal_ = start;
      }
      return hand_over(target);
    }
  }

  PedestalState pedestal() const override { return bullet_ ? bullet_->pedestal() : pedestal_; }

  RockState rock() const override {
    require_rock(has_rock_);
    if (bullet_) return bullet_->rock();
    RockState state = stepper_.state;
    // The sign Bullet's conversion from a matrix gives: w positive if it is large, else the largest
    // other component.
    Eigen::Quaterniond& q = state.q_WB;
    double decisive = q.w();
    if (q.w() * q.w() <= 0.25) {
      int largest = 0;
      q.vec().cwiseAbs().maxCoeff(&largest);
      decisive = q.vec()[largest];
    }
    if (decisive < 0) q.coeffs() = -q.coeffs();
    return state;
  }

  void contacts(std::vector<ContactPoint>& out) const override {
    if (bullet_) return bullet_->contacts(out);
    out.clear();
    if (!has_rock_ || diverged_) return;
    // Bullet's second lateral direction depends on which body it takes first.
    const FastModel& model = stepper_.model();
    const double sign = model.rock_is_first ? 1.0 : -1.0;
    for (int i = 0; i < stepper_.contact_count(); ++i) {
      const FastStepper::Contact& c = stepper_.contact(i);
      out.push_back({
          .p_W_rock = last_rock_ + last_turn_ * c.r_P,
          .p_W_pedestal = last_support_ + last_turn_ * c.s_P,
          .normal_W = last_turn_.col(2),
          .distance = c.distance,
          .normal_impulse = c.normal_impulse,
          .lateral_impulse_1 = c.lateral_impulse_1,
          .lateral_impulse_2 = sign * c.lateral_impulse_2,
          .direction_1 = -last_turn_.col(1),
          .direction_2 = sign * last_turn_.col(0),
          .pair = in_force(model.pair, stepper_.friction_scale[i]),
      });
    }
  }

  Handover handover() const override { return handover_; }

  bool foothold(Foothold& out) const override {
    if (!stands()) return false;
    const FastModel& model = stepper_.model();
    const Eigen::Matrix3d R_TB = last_turn_.transpose() * stepper_.state.q_WB.toRotationMatrix();
    out.R_WT = last_turn_;
    out.friction = FrictionBounds::of(model.pair, std::min(1.0, scene_->mechanisms().friction_ratio));
    out.normal = NormalLaw::of(model.pair);
    out.mass = model.mass;
    out.inertia_T = R_TB * model.inertia.asDiagonal() * R_TB.transpose();
    out.count = 0;
    for (int i = 0; i < stepper_.contact_count(); ++i) {
      const FastStepper::Contact& c = stepper_.contact(i);
      if (c.normal_impulse > 0) out.r_T[out.count++] = c.r_P;
    }
    out.low.clear();
    out.same_height = model.same_height;
    return true;
  }

  // While n contacts with springs k hold on a top that rises by no more than g, they press by d_i with a sum
  // of at most 2 m g / k, and so has the change of all d_i. By least squares the rock then tilts by no more
  // than that over the root of the lesser moment of the contacts.
  void add_low_vertices(Foothold& out) const override {
    const FastModel& model = stepper_.model();
    if (model.is_box) return;
    const Eigen::Matrix3d R_TB = last_turn_.transpose() * stepper_.state.q_WB.toRotationMatrix();
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    for (int i = 0; i < out.count; ++i) middle += out.r_T[i] / out.count;
    Eigen::Matrix2d moments = Eigen::Matrix2d::Zero();
    Eigen::Vector2d heights = Eigen::Vector2d::Zero();
    for (int i = 0; i < out.count; ++i) {
      const Eigen::Vector3d from = out.r_T[i] - middle;
      moments += from.head<2>() * from.head<2>().transpose();
      heights += from.z() * from.head<2>();
    }
    const double half_trace = 0.5 * moments.trace();
    const double lesser = half_trace - std::sqrt(std::max(
                              0.0, half_trace * half_trace - moments.determinant()));
    const double tilts =
        2.0 * model.mass * scene_->engine().gravity / (out.normal.stiffness * std::sqrt(lesser));
    const Eigen::Vector2d slope = moments.inverse() * heights;
    if (!std::isfinite(tilts) || !slope.allFinite()) return;
    const PointView vertices = model.vertices.view();
    for (std::size_t i = 0; i < vertices.size; ++i) {
      const Eigen::Vector3d r_T = R_TB * vertices.at(i);
      const Eigen::Vector3d from = r_T - middle;
      const double offset = from.z() - model.margin - slope.dot(from.head<2>());
      if (offset < kQuietStretch.safety * tilts * from.head<2>().norm() && !stepper_.keeps(r_T))
        out.low.push_back({r_T, offset});
    }
  }

  std::int64_t steps_held() const override {
    return bullet_ || !moves() ? 0 : stepper_.held() / scene_->engine().substeps;
  }

  void carry(const DriveTarget& from, const DriveTarget& to) override {
    if (!stands() || to.excursion.pitch != pedestal_.excursion.pitch) return World::carry(from, to);
    const PedestalState start{from.position, 0.0, from.excursion, {}};
    const Eigen::Vector3d before = motion_now().p_WP;
    pedestal_ = on_the_way(drive_, start, start, to, 1, 1, scene_->engine().time_step);
    const Eigen::Vector3d way = motion_now().p_WP - before;
    stepper_.state.p_WB += way;
    last_rock_ += way;
    last_support_ += way;
    const PedestalMotion motion = pedestal_motion(scene_->pedestal(), pedestal_);
    stepper_.state.v_WB = motion.velocity_at(stepper_.state.p_WB);
    stepper_.state.w_WB = motion.w_WP;
    if (mechanics_) mechanics_->carry(stepper_.state, motion, way);
  }

  std::unique_ptr<World> copy() const override {
    if (bullet_) return nullptr;
    auto out = std::make_unique<FastWorld>(scene_, drive_);
    out->stepper_ = stepper_;
    out->pedestal_ = pedestal_;
    out->last_rock_ = last_rock_;
    out->last_support_ = last_support_;
    out->last_turn_ = last_turn_;
    out->joint_ = joint_;
    if (mechanics_) out->mechanics_ = mechanics_->independent();
    out->has_rock_ = has_rock_;
    out->diverged_ = diverged_;
    return out;
  }

 private:
  bool moves() const { return has_rock_ && !diverged_; }

  // Whether the rock stands on a top whose motion is given.
  bool stands() const {
    if (bullet_ || joint_ || !prescribes(drive_) || !moves()) return false;
    for (int i = 0; i < stepper_.contact_count(); ++i)
      if (stepper_.contact(i).normal_impulse > 0) return true;
    return false;
  }

  // Solver step `i`, from 1; false: the contact geometry does not hold, and nothing was done.
  bool substep(const DriveTarget& target, double dt, const PedestalState& start, int i) {
    const PedestalMotion now = motion_now();
    Support support = top_of(now);
    handover_ = find_contacts(support);
    if (handover_ != Handover::none) return false;
    if (moves() && mechanics_)
      mechanise([&](RockState& rock) { return mechanics_->begin_step(rock, dt); });
    PedestalState next = pedestal_;
    if (prescribes(drive_))
      next = on_the_way(drive_, start, pedestal_, target, i, scene_->engine().substeps, dt);
    SupportMotor motor = drive(target, dt, now, next, support);
    last_support_ = support.p_WP;
    last_turn_ = support.R_WP;
    if (moves()) {
      last_rock_ = stepper_.state.p_WB;
      if (mechanics_ && scene_->mechanisms().sets_friction()) set_friction();
      stepper_.advance(support, motor, dt);
    } else if (motor.inverse_mass > 0) {
      const MotorRow row = motor.row(next.velocity);
      VelocityChange<double> change;
      row.apply(row.bounded(row.demanded(0.0, change)), change);
      motor.velocity_change = change.joint;
    }
    if (joint_) {
      next.excursion_rate.pitch = support.w_WP.y() + motor.velocity_change;
      joint_->finish(next.excursion_rate.pitch);
      next.excursion.pitch = joint_->pitch();
    }
    if (drive_ != Drive::prescribed_spatial) {
      next.velocity += motor.velocity_change;
      next.position = pedestal_.position + dt * next.velocity;
    }
    pedestal_ = next;
    if (moves()) end_mechanics(dt);
    return true;
  }

  // The pedestal's pose, without its velocity where it moves along x only.
  PedestalMotion motion_now() const {
    if (drive_ == Drive::prescribed_spatial) return pedestal_motion(scene_->pedestal(), pedestal_);
    PedestalMotion now;
    now.p_WP = scene_->pedestal().p_WP0;
    now.p_WP.x() += pedestal_.position;
    return now;
  }

  // The top, without its velocity.
  Support top_of(const PedestalMotion& now) const {
    Support support;
    if (drive_ == Drive::prescribed_spatial) {
      support.p_WP = now.p_WP + now.R_WP * p_LP_;
      support.R_WP = top_is_turned_ ? Eigen::Matrix3d(now.R_WP * R_LP_) : now.R_WP;
      support.level = false;
    } else {
      support.p_WP = now.p_WP + p_LP_;
      support.R_WP = R_LP_;
      support.level = !top_is_turned_;
    }
    return support;
  }

  // What ends the stepper's domain, if anything does.
  Handover find_contacts(const Support& support) {
    if (!moves()) return Handover::none;
    if (top_is_turned_ && !prescribes(drive_)) return Handover::motor_on_a_slope;
    const FastStepper::Verdict verdict = stepper_.detect(support);
    if (verdict == FastStepper::Verdict::in_domain) return Handover::none;
    // A state that is not a number stays as it is: Bullet would take none.
    const RockState& rock = stepper_.state;
    diverged_ = !rock.p_WB.allFinite() || !rock.q_WB.coeffs().allFinite() ||
                !rock.v_WB.allFinite() || !rock.w_WB.allFinite();
    if (diverged_) return Handover::none;
    return verdict == FastStepper::Verdict::too_deep ? Handover::too_deep : Handover::off_the_top;
  }

  // Gives the support its velocity over a step and returns what of it yields to the contacts.
  SupportMotor drive(const DriveTarget& target, double dt, const PedestalMotion& now,
                     PedestalState& next, Support& support) {
    SupportMotor motor;
    switch (drive_) {
      case Drive::prescribed:
        support.v_WP.x() = next.velocity;
        break;
      case Drive::prescribed_spatial:
        if (joint_) {
          const double rate = joint_->blow(next.velocity - pedestal_.velocity);
          motor.pitch_response = joint_->inverse_inertia();
          motor.p_WA = pitch_axis(scene_->pedestal(), pedestal_);
          support.w_WP = {0, rate, 0};
          support.v_WP = Eigen::Vector3d(next.velocity, next.excursion_rate.transverse,
                                         next.excursion_rate.vertical) +
                         support.w_WP.cross(support.p_WP - motor.p_WA);
        } else {
          const PedestalMotion goal = pedestal_motion(scene_->pedestal(), next);
          support.w_WP = goal.w_WP;
          support.v_WP = (goal.p_WP - now.p_WP) / dt +
                         support.w_WP.cross(Eigen::Vector3d(now.R_WP * p_LP_));
        }
        break;
      case Drive::motor_position:
      case Drive::motor_position_velocity:
        next.velocity = MotorLaw::damped(scene_->engine(), next.velocity, dt);
        motor.inverse_mass = 1.0 / scene_->pedestal().mass;
        motor.target_velocity = MotorLaw::speed(drive_, next, target, dt);
        motor.maximum_impulse = MotorLaw::maximum_impulse(scene_->engine());
        support.v_WP.x() = next.velocity;
    }
    return motor;
  }

  // Lets the mechanisms change the rock's velocity, and the joint feel it.
  template <typename Act>
  void mechanise(Act act) {
    const RockState before = stepper_.state;
    if (act(stepper_.state) && joint_) joint_->react(before, stepper_.state, pedestal_);
  }

  void end_mechanics(double dt) {
    if (!mechanics_) return;
    touches_.clear();
    for (int k = 0; k < stepper_.contact_count(); ++k) {
      const FastStepper::Contact& c = stepper_.contact(k);
      touches_.push_back({last_rock_ + last_turn_ * c.r_P, last_turn_.col(2), c.normal_impulse});
    }
    mechanise([&](RockState& rock) {
      return mechanics_->end_step(rock, pedestal_motion(scene_->pedestal(), pedestal_), touches_, dt);
    });
  }

  void set_friction() {
    for (int k = 0; k < stepper_.contact_count(); ++k)
      stepper_.friction_scale[k] = mechanics_->friction_scale(
          last_rock_ + last_turn_ * stepper_.contact(k).r_P, last_turn_.col(2));
  }

  void hand_over(const DriveTarget& target) {
    HandedOver state{pedestal_, joint_, stepper_.state, {}, mechanics_};
    const Eigen::Vector3d normal_W =
        pedestal_motion(scene_->pedestal(), pedestal_).R_WP * R_LP_.col(2);
    for (int i = 0; i < stepper_.contact_count(); ++i) {
      const FastStepper::Contact& c = stepper_.contact(i);
      state.contacts.push_back({c.p_B, p_LP_ + R_LP_ * c.p_P, normal_W});
    }
    bullet_ = make_exact_bullet_world(scene_, drive_);
    bullet_->take_over(state);
    bullet_->step(target);
  }

  std::shared_ptr<const Scene> scene_;
  Drive drive_;
  FastStepper stepper_;
  PedestalState pedestal_;
  Eigen::Vector3d last_rock_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d last_support_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d last_turn_ = Eigen::Matrix3d::Identity();
  // Of the support's box in the pedestal's frame.
  Eigen::Vector3d p_LP_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d R_LP_ = Eigen::Matrix3d::Identity();
  bool top_is_turned_ = false;
  std::optional<PitchJoint> joint_;
  std::optional<RockMechanics> mechanics_;
  std::vector<Touch> touches_;
  bool has_rock_ = false;
  bool diverged_ = false;
  Handover handover_ = Handover::none;
  std::unique_ptr<BulletWorldBase> bullet_;
};

}  // namespace

std::unique_ptr<World> make_fast_world(std::shared_ptr<const Scene> scene, Drive drive) {
  require_fast(*scene);
  return std::make_unique<FastWorld>(std::move(scene), drive);
}

}  // namespace vsr2
