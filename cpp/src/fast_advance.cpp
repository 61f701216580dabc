// The second half of FastStepper's step: velocities, impulses, positions.

#include <algorithm>
#include <cmath>

#include "contact_sweeps.hpp"
#include "fast_stepper.hpp"
#include "sticking_contacts.hpp"
#include "velocity_damping.hpp"

namespace vsr2 {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// PyBullet's allowance before a contact's distance counts [m], and Bullet's bounds on every velocity
// component [m/s], [rad/s] (btMultiBody) and on a turn (btTransformUtil).
constexpr double kLinearSlop = 1e-5;
constexpr double kGreatestVelocity = 100.0;
constexpr double kGreatestTurn = 0.25 * M_PI;  // per step [rad]

// sin(h) / h and cos(h): series near 0, where every rock but a tumbling one is and where the last
// bit of the maths library would depend on the machine; the library beyond. At h = 0.05 the terms left
// out are below 1e-19.
void half_turn(double h, double& sinc, double& cosine) {
  if (h < 0.05) {
    const double q = h * h;
    sinc = 1.0 + q * (-1.0 / 6 + q * (1.0 / 120 + q * (-1.0 / 5040 + q / 362880)));
    cosine = 1.0 + q * (-0.5 + q * (1.0 / 24 + q * (-1.0 / 720 + q / 40320)));
  } else {
    sinc = std::sin(h) / h;
    cosine = std::cos(h);
  }
}

double bounded_velocity(double v) { return std::clamp(v, -kGreatestVelocity, kGreatestVelocity); }
Vector3d bounded_velocity(const Vector3d& v) {
  return {bounded_velocity(v.x()), bounded_velocity(v.y()), bounded_velocity(v.z())};
}

// The support's pitch axis, along the support's axes and from its origin; 0 where there is no joint.
struct PitchAxis {
  Vector3d along = Vector3d::Zero();
  Vector3d place = Vector3d::Zero();  // [m]

  PitchAxis(const Support& support, const SupportMotor& motor) {
    if (!(motor.pitch_response > 0)) return;
    along = support.R_WP.row(1).transpose();
    place = support.R_WP.transpose() * (motor.p_WA - support.p_WP);
  }
};

}  // namespace

// A step's velocities along the support's axes, and what its contacts' normals ask of them: both ways to
// find impulses take it from here.
struct FastStepper::ContactStep {
  NormalLaw law;
  double threshold;  // of the speed of approach, for restitution [m/s]
  double dt;
  double softness;  // of normal rows [1/kg]
  double erp;       // part of a penetration that is undone in a step [1]
  bool turns;       // the support, or it is turned
  Matrix3d R_PB;
  Vector3d v, w;                  // of the rock's mass centre
  Vector3d support_v, support_w;  // of the support's origin

  ContactStep(const FastModel& m, const Matrix3d& R_WB, const Support& support, const Vector3d& v_W,
              const Vector3d& w_W, double time_step)
      : law(NormalLaw::of(m.pair)),
        threshold(m.engine.restitution_velocity_threshold),
        dt(time_step),
        softness(law.softness(dt)),
        erp(law.erp(dt)),
        turns(!support.level),
        R_PB(R_WB),
        v(v_W),
        w(w_W),
        support_v(support.v_WP),
        support_w(support.w_WP) {
    if (!turns) return;
    const Matrix3d R_PW = support.R_WP.transpose();
    R_PB = R_PW * R_PB;
    v = R_PW * v_W;
    w = R_PW * w_W;
    support_v = R_PW * support.v_WP;
    support_w = R_PW * support.w_WP;
  }

  // Of the rock over the support.
  Vector3d slip(const Contact& at) const {
    Vector3d support_speed = support_v;
    if (turns) support_speed += support_w.cross(at.s_P);
    return v + w.cross(at.r_P) - support_speed;
  }
  // The normal velocity that a contact wants is the sum of both [m/s].
  double rebound(double approach) const { return law.rebound(approach, threshold); }
  double closing(const Contact& at) const {
    const double distance = at.distance + kLinearSlop;
    return distance > 0 ? -distance / dt : -distance * erp / dt;
  }
};

void FastStepper::advance(const Support& support, SupportMotor& motor, double dt) {
  const FastModel& m = *model_;
  Vector3d v = state.v_WB;
  Vector3d w = state.w_WB;

  const Matrix3d R_WB = state.q_WB.toRotationMatrix();
  // Weight, gyroscopic moment and Bullet's damping.
  {
    const Vector3d w_B = R_WB.transpose() * w;
    const Vector3d turn = -m.inverse_inertia.cwiseProduct(w_B.cross(m.inertia.cwiseProduct(w_B))) -
                          w_B * damping_rate(m.engine.angular_damping, w_B.norm());
    w = bounded_velocity(Vector3d(w + dt * (R_WB * turn)));
    const Vector3d drag = v * damping_rate(m.engine.linear_damping, v.norm());
    v = bounded_velocity(Vector3d(v + dt * (Vector3d(0, 0, -m.engine.gravity) - drag)));
  }

  motor.velocity_change = 0.0;
  iterations_ = 0;
  if (count_ == 0) note_closed(false);
  if (count_ > 0 || motor.inverse_mass > 0) {
    const ContactStep step(m, R_WB, support, v, w, dt);
    VelocityChange<double> change;
    const bool solves = m.engine.converged_contacts && !(motor.inverse_mass > 0) &&
                        !(m.engine.residual_threshold > 0);
    if (!solves || !stick(step, support, motor, change))
      sweep(step, support, motor, change);
    Vector3d dw(change.angular);
    Vector3d dv(change.linear);
    if (!support.level) {
      dw = support.R_WP * dw;
      dv = support.R_WP * dv;
    }
    w = bounded_velocity(Vector3d(w + dw));
    v = bounded_velocity(Vector3d(v + dv));
    motor.velocity_change = change.joint;
  }
  move(v, w, dt);
}

// Impulses of contacts that all stick; false: some slide.
bool FastStepper::stick(const ContactStep& step, const Support& support, const SupportMotor& motor,
                        VelocityChange<double>& change) {
  const FastModel& m = *model_;
  StickingProblem problem;
  problem.count = count_;
  problem.mass = m.mass;
  problem.inertia = step.R_PB * m.inertia.asDiagonal() * step.R_PB.transpose();
  problem.softness = step.softness;
  problem.angular = step.w - step.support_w;
  problem.linear = step.v - step.support_v;
  if (step.turns) {
    const Vector3d p_PB = support.R_WP.transpose() * (state.p_WB - support.p_WP);
    problem.linear -= step.support_w.cross(p_PB);
    if (motor.pitch_response > 0) {
      const PitchAxis axis(support, motor);
      problem.joint = {motor.pitch_response, axis.along, step.support_w,
                       axis.along.cross(p_PB - axis.place)};
      for (int i = 0; i < count_; ++i)
        problem.contacts[i].gap = p_PB + contacts_[i].r_P - contacts_[i].s_P;
    }
  }
  for (int i = 0; i < count_; ++i) {
    const Contact& c = contacts_[i];
    StickingContact& at = problem.contacts[i];
    at.x = c.r_P.x();
    at.y = c.r_P.y();
    at.z = c.r_P.z();
    at.target = step.rebound(step.slip(c).z()) + step.closing(c);
    at.bounds = FrictionBounds::of(m.pair, friction_scale[i]);
    at.normal = c.normal_impulse;
  }
  if (!solve_sticking(problem)) return false;
  int pressed = 0;
  bool same = true;
  for (int i = 0; i < count_; ++i) {
    pressed += contacts_[i].normal_impulse > 0;
    same = same && (contacts_[i].normal_impulse > 0) == (problem.contacts[i].normal > 0);
  }
  same = same && pressed == closed_;
  for (int k = 0; k < 3; ++k) {
    change.angular[k] = problem.angular[k];
    change.linear[k] = problem.linear[k];
  }
  change.joint = problem.pitch_rate;
  for (int i = 0; i < count_; ++i) {
    contacts_[i].normal_impulse = problem.contacts[i].normal;
    contacts_[i].lateral_impulse_1 = -problem.contacts[i].lateral_y;
    contacts_[i].lateral_impulse_2 = problem.contacts[i].lateral_x;
  }
  note_closed(same);
  return true;
}

void FastStepper::note_closed(bool held) {
  held_ = held ? held_ + 1 : 0;
  closed_ = 0;
  for (int i = 0; i < count_; ++i) closed_ += contacts_[i].normal_impulse > 0;
}

// Impulses by Bullet's sweeps, with the joint by which the support yields.
void FastStepper::sweep(const ContactStep& step, const Support& support, const SupportMotor& motor,
                        VelocityChange<double>& change) {
  const FastModel& m = *model_;
  const RockResponse rock{1.0 / m.mass, step.R_PB * m.inverse_inertia.asDiagonal() *
                                            step.R_PB.transpose()};
  ContactProblem problem;
  problem.count = count_;
  problem.motor = motor.row(step.support_v.x());
  if (motor.inverse_mass > 0) problem.joint = Joint::motor;
  if (motor.pitch_response > 0) problem.joint = Joint::pitch;
  const PitchAxis axis(support, motor);
  with_joint(problem.joint, [&](auto joint) {
    for (int i = 0; i < count_; ++i) {
      const Contact& c = contacts_[i];
      ContactRows& rows = problem.rows[i];
      rows.bounds = FrictionBounds::of(m.pair, friction_scale[i]);
      JointAtContact yields;
      if constexpr (joint == Joint::motor) yields = {-Vector3d::UnitX(), 0.0, motor.inverse_mass};
      if constexpr (joint == Joint::pitch)
        yields = {-axis.along.cross(c.s_P - axis.place), -axis.along.z(), motor.pitch_response};
      const Vector3d slip = step.slip(c);
      rows.normal.fill<joint>(rock, c.r_P, yields, (step.rebound(slip.z()) - slip.z()) + step.closing(c),
                              step.softness);
      rows.spin.fill<joint>(rock, c.r_P, yields, step.support_w.z() - step.w.z());
      rows.lateral_1.fill<joint>(rock, c.r_P, yields, slip.y());
      rows.lateral_2.fill<joint>(rock, c.r_P, yields, -slip.x());
    }
  });
  iterations_ = solve(problem, m.engine.solver_iterations, m.engine.residual_threshold);
  change = problem.change;
  for (int i = 0; i < count_; ++i) {
    contacts_[i].normal_impulse = problem.rows[i].normal.impulse;
    contacts_[i].lateral_impulse_1 = problem.rows[i].lateral_1.impulse;
    contacts_[i].lateral_impulse_2 = problem.rows[i].lateral_2.impulse;
  }
  note_closed(false);
}

// Velocities and the positions that follow, by Bullet's rule.
void FastStepper::move(const Vector3d& v, const Vector3d& w, double dt) {
  state.v_WB = v;
  state.w_WB = w;
  state.p_WB += dt * v;
  const double speed = std::min(w.norm(), kGreatestTurn / dt);
  double sinc;
  double cosine;
  half_turn(0.5 * speed * dt, sinc, cosine);
  const Vector3d axis = w * (0.5 * dt * sinc);
  const Eigen::Quaterniond& q = state.q_WB;
  Eigen::Quaterniond next(cosine * q.w() - axis.x() * q.x() - axis.y() * q.y() - axis.z() * q.z(),
                          cosine * q.x() + axis.x() * q.w() + axis.y() * q.z() - axis.z() * q.y(),
                          cosine * q.y() + axis.y() * q.w() + axis.z() * q.x() - axis.x() * q.z(),
                          cosine * q.z() + axis.z() * q.w() + axis.x() * q.y() - axis.y() * q.x());
  next.coeffs() *= 1.0 / std::sqrt(next.squaredNorm());
  state.q_WB = next;
}

}  // namespace vsr2
