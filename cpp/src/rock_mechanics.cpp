#include "rock_mechanics.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "vsr2/constants.hpp"

namespace vsr2 {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

}  // namespace

RockMechanics::RockMechanics(const Scene& scene)
    : mechanisms_(scene.mechanisms()),
      mass_(scene.rock().mass),
      gravity_(scene.engine().gravity),
      inertia_(scene.rock_inertia()),
      outline_(std::make_shared<Outline>()) {
  outline_->vertices = scene.rock_hull_vertices();
  outline_->footprint.reserve(3 * outline_->vertices.size() + 2);
}

bool RockMechanics::needed(const Scene& scene) {
  return scene.mechanisms().moves_rock() || scene.mechanisms().sets_friction();
}

RockMechanics::Velocity RockMechanics::relative(const RockState& rock,
                                                const PedestalMotion& pedestal) {
  return {rock.v_WB - pedestal.velocity_at(rock.p_WB), rock.w_WB - pedestal.w_WP};
}

Matrix3d RockMechanics::inertia_W(const RockState& rock) const {
  const Matrix3d R = rock.q_WB.toRotationMatrix();
  return R * inertia_.asDiagonal() * R.transpose();
}

void RockMechanics::start(const RockState& rock, const PedestalMotion& pedestal) {
  pedestal_ = pedestal;
  before_ = rock;
  normal_force_ = 0.0;
  bond_ = Bond::none;
  rested_ = 0.0;
  impact_ = {};
  const Vector3d up = pedestal.R_WP.col(2);
  up_B_ = rock.q_WB.conjugate() * up;
  double lowest = 0.0;
  for (const Vector3d& vertex : outline_->vertices) lowest = std::min(lowest, up_B_.dot(vertex));
  start_height_ = -lowest;
}

void RockMechanics::carry(const RockState& rock, const PedestalMotion& pedestal, const Vector3d& way) {
  pedestal_ = pedestal;
  before_ = rock;
  centre_W_ += way;
}

RockMechanics RockMechanics::independent() const {
  RockMechanics out = *this;
  out.outline_ = std::make_shared<Outline>(*outline_);
  out.outline_->footprint.reserve(outline_->footprint.capacity());
  return out;
}

bool RockMechanics::begin_step(RockState& rock, double dt) {
  before_ = rock;
  bool changed = resist_rocking(rock, dt);
  changed = pull_bond(rock, dt) || changed;
  return pull_tether(rock, dt) || changed;
}

bool RockMechanics::resist_rocking(RockState& rock, double dt) const {
  if (!(mechanisms_.rocking_damping > 0 || mechanisms_.rolling_resistance > 0)) return false;
  if (!(normal_force_ > 0)) return false;
  const Vector3d up = pedestal_.R_WP.col(2);
  Vector3d w = relative(before_, pedestal_).w;
  w -= up.dot(w) * up;
  const double rate = w.norm();
  if (!(rate > 0)) return false;
  const Vector3d axis = w / rate;
  const Matrix3d I = inertia_W(rock);
  const double distance = (centre_W_ - rock.p_WB).cross(axis).norm();
  const double I_O = axis.dot(I * axis) + mass_ * distance * distance;
  const double p = std::sqrt(mass_ * gravity_ * distance / I_O);
  const double moment =
      2.0 * mechanisms_.rocking_damping * p * I_O * rate +
      normal_force_ * mechanisms_.rolling_resistance * rate / std::hypot(rate, kRolling.fading_rate);
  // No more than what stops the rocking.
  w = axis * (-std::min(moment * dt, I_O * rate));
  rock.w_WB += I.ldlt().solve(w);
  return true;
}

bool RockMechanics::pull_bond(RockState& rock, double dt) const {
  if (bond_ != Bond::holds) return false;
  const Vector3d force = -strength_ * (pedestal_.R_WP * bond_normal_P_);
  rock.v_WB += (dt / mass_) * force;
  rock.w_WB += inertia_W(rock).ldlt().solve(Vector3d(dt * (rock.q_WB * bond_B_).cross(force)));
  return true;
}

bool RockMechanics::pull_tether(RockState& rock, double dt) const {
  if (!mechanisms_.catches()) return false;
  const Vector3d up = pedestal_.R_WP.col(2);
  const Vector3d now = rock.q_WB * up_B_;
  const Vector3d across = up.cross(now);
  const double sine = across.norm();
  const double tilt = std::atan2(sine, up.dot(now));
  if (!(tilt > mechanisms_.catch_slack) || !(sine > 0)) return false;
  const Vector3d axis = across / sine;
  const Matrix3d I = inertia_W(rock);
  const double least = inertia_.minCoeff();
  const double k = std::min(kTether.stiffness * mass_ * gravity_ * start_height_,
                            kTether.step * least / (dt * dt));
  const double c = 2.0 * kTether.damping * std::sqrt(k * least);
  const double couple = k * (tilt - mechanisms_.catch_slack) +
                        c * axis.dot(relative(before_, pedestal_).w);
  if (!(couple > 0)) return false;
  rock.w_WB -= I.ldlt().solve(Vector3d((dt * couple) * axis));
  return true;
}

double RockMechanics::friction_scale(const Vector3d& p_W, const Vector3d& normal_W) const {
  Vector3d slip = before_.v_WB + before_.w_WB.cross(p_W - before_.p_WB) - pedestal_.velocity_at(p_W);
  slip -= normal_W.dot(slip) * normal_W;
  return 1.0 + (mechanisms_.friction_ratio - 1.0) * std::exp(-slip.norm() / mechanisms_.friction_speed);
}

bool RockMechanics::end_step(RockState& rock, const PedestalMotion& pedestal,
                             const std::vector<Touch>& touches, double dt) {
  bool changed = false;
  if (mechanisms_.sets_impacts()) changed = follow_impact(rock, pedestal, touches, dt);
  pedestal_ = pedestal;
  normal_force_ = 0.0;
  centre_W_.setZero();
  for (const Touch& touch : touches) {
    normal_force_ += touch.impulse;
    centre_W_ += touch.impulse * touch.p_W;
  }
  if (normal_force_ > 0) centre_W_ /= normal_force_;
  normal_force_ /= dt;
  if (mechanisms_.adhesion > 0) follow_bond(rock, touches, dt);
  return changed;
}

double RockMechanics::height_of_bond(const RockState& rock) const {
  const Vector3d p_W = rock.p_WB + rock.q_WB * bond_B_ - pedestal_.p_WP;
  return (pedestal_.R_WP * bond_normal_P_).dot(p_W);
}

void RockMechanics::follow_bond(const RockState& rock, const std::vector<Touch>& touches,
                                double dt) {
  if (bond_ == Bond::holds && height_of_bond(rock) > bond_height_ + kBond.opening) bond_ = Bond::broken;
  if (bond_ != Bond::none) return;
  const Velocity velocity = relative(rock, pedestal_);
  const bool rests = touches.size() >= 3 && normal_force_ > 0 && velocity.v.norm() < kBond.rest_speed &&
                     velocity.w.norm() < kBond.rest_rate;
  rested_ = rests ? rested_ + dt : 0.0;
  if (rested_ > kBond.rest) form_bond(rock, touches);
}

// The footprint's hull by Andrew's monotone chain, its area and centroid; seen along the normal.
void RockMechanics::form_bond(const RockState& rock, const std::vector<Touch>& touches) {
  std::vector<Vector2d>& footprint = outline_->footprint;
  Vector3d normal = Vector3d::Zero();
  for (const Touch& touch : touches) normal += touch.normal_W;
  bond_normal_P_ = pedestal_.R_WP.transpose() * normal.normalized();
  const Matrix3d R_TP =
      Eigen::Quaterniond::FromTwoVectors(bond_normal_P_, Vector3d::UnitZ()).toRotationMatrix();
  const Matrix3d R_TB = R_TP * pedestal_.R_WP.transpose() * rock.q_WB.toRotationMatrix();
  double lowest = std::numeric_limits<double>::infinity();
  for (const Vector3d& vertex : outline_->vertices) lowest = std::min(lowest, R_TB.row(2).dot(vertex));
  footprint.clear();
  for (const Vector3d& vertex : outline_->vertices)
    if (R_TB.row(2).dot(vertex) <= lowest + kBond.footprint_depth)
      footprint.emplace_back(R_TB.row(0).dot(vertex), R_TB.row(1).dot(vertex));
  std::sort(footprint.begin(), footprint.end(), [](const Vector2d& a, const Vector2d& b) {
    return a.x() < b.x() || (a.x() == b.x() && a.y() < b.y());
  });
  const auto turn = [](const Vector2d& o, const Vector2d& a, const Vector2d& b) {
    return (a.x() - o.x()) * (b.y() - o.y()) - (a.y() - o.y()) * (b.x() - o.x());
  };
  // The hull goes behind the sorted points; there is room for it.
  const std::size_t count = footprint.size();
  const auto push = [&](const Vector2d& point, std::size_t floor) {
    while (footprint.size() >= floor + 2 &&
           turn(footprint[footprint.size() - 2], footprint.back(), point) <= 0)
      footprint.pop_back();
    footprint.push_back(point);
  };
  for (std::size_t i = 0; i < count; ++i) push(Vector2d(footprint[i]), count);
  const std::size_t upper = footprint.size() - 1;
  for (std::size_t i = count; i-- > 0;) push(Vector2d(footprint[i]), upper);
  double area = 0.0;
  Vector2d moment = Vector2d::Zero();
  const Vector2d& origin = footprint[count];
  for (std::size_t i = count; i + 1 < footprint.size(); ++i) {
    const double part = 0.5 * turn(origin, footprint[i], footprint[i + 1]);
    area += part;
    moment += part * (origin + footprint[i] + footprint[i + 1]) / 3.0;
  }
  bond_ = Bond::holds;
  strength_ = mechanisms_.adhesion * area;
  const Vector2d centroid = area > 0 ? Vector2d(moment / area) : origin;
  bond_B_ = R_TB.transpose() * Vector3d(centroid.x(), centroid.y(), lowest);
  bond_height_ = height_of_bond(rock);
}

bool RockMechanics::follow_impact(RockState& rock, const PedestalMotion& pedestal,
                                  const std::vector<Touch>& touches, double dt) {
  Impact& impact = impact_;
  // Speeds of approach before the step, when the pedestal moved as in the step before.
  const Velocity before = relative(before_, pedestal_);
  double blow = 0.0;
  double first_blow = 0.0;
  for (const Touch& touch : touches) {
    if (!(touch.impulse > 0)) continue;
    const double speed = -touch.normal_W.dot(before.at(touch.p_W - before_.p_WB));
    blow = std::max(blow, speed);
    if (support_at(before_.q_WB.conjugate() * (touch.p_W - before_.p_WB)) == impact.supports)
      first_blow = std::max(first_blow, speed);
  }
  const Vector3d acceleration =
      (pedestal.velocity_at(rock.p_WB) - pedestal_.velocity_at(rock.p_WB)) / dt;
  const Vector3d force = mass_ * (Vector3d(0, 0, -gravity_) - acceleration);
  if (!impact.open && first_blow > kImpact.blow) {
    impact.open = true;
    impact.elapsed = impact.quiet = impact.work = impact.greatest_work = 0.0;
    impact.blow = first_blow;
    impact.before_B = in_body(before_, before);
    impact.energy = kinetic_energy(impact.before_B);
    impact.lead = 0.5 * dt * force.dot(before.v);
  }
  note_support(touches, dt);
  if (!impact.open) return false;
  impact.work += dt * force.dot(relative(rock, pedestal).v);
  impact.greatest_work = std::max(impact.greatest_work, impact.work);
  impact.elapsed += dt;
  impact.quiet = blow > kImpact.after_blow ? 0.0 : impact.quiet + dt;
  if (impact.quiet > kImpact.quiet - 0.5 * dt) return close_impact(rock, pedestal, force, dt);
  if (impact.elapsed > kImpact.longest) impact.open = false;
  return false;
}

std::size_t RockMechanics::support_at(const Vector3d& p_B) const {
  std::size_t i = impact_.supports;
  while (i-- > 0)
    if ((impact_.support[i].p_B - p_B).squaredNorm() < kImpact.same_point * kImpact.same_point) return i;
  return impact_.supports;
}

void RockMechanics::note_support(const std::vector<Touch>& touches, double dt) {
  Impact& impact = impact_;
  for (std::size_t i = impact.supports; i-- > 0;) {
    impact.support[i].idle += dt;
    if (impact.support[i].idle > kImpact.forget) impact.support[i] = impact.support[--impact.supports];
  }
  for (const Touch& touch : touches) {
    if (!(touch.impulse > 0)) continue;
    const Vector3d p_B = before_.q_WB.conjugate() * (touch.p_W - before_.p_WB);
    const std::size_t slot = support_at(p_B);
    if (slot == impact.support.size()) continue;
    if (slot == impact.supports) ++impact.supports;
    impact.support[slot] = {p_B, 0.0};
  }
}

RockMechanics::Velocity RockMechanics::in_body(const RockState& rock, const Velocity& velocity) {
  return {rock.q_WB.conjugate() * velocity.v, rock.q_WB.conjugate() * velocity.w};
}

// The line through the points that bear the rock after the impact or, where it does not turn about
// that, the one of them that it turns about.
bool RockMechanics::find_pivot(const Velocity& now_B, const Vector3d& up_B, Pivot& pivot) const {
  const Impact& impact = impact_;
  const double enough = (1.0 - kImpact.other_motion) * kinetic_energy(now_B);
  const auto turns_about = [&](const Pivot& candidate) {
    return kinetic_energy(about(candidate, now_B)) > enough;
  };
  std::array<Vector3d, kSupports> point;
  std::size_t count = 0;
  for (std::size_t i = 0; i < impact.supports; ++i) {
    const Support& support = impact.support[i];
    if (support.idle < impact.elapsed && up_B.dot(now_B.at(support.p_B)) < kImpact.opens * impact.blow)
      point[count++] = support.p_B;
  }
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t k = i + 1; k < count; ++k)
      if ((point[k] - point[i]).squaredNorm() > pivot.chord.squaredNorm())
        pivot = {point[i], point[k] - point[i]};
  if (!pivot.chord.isZero()) {
    pivot.chord.normalize();
    bool line = true;
    for (std::size_t i = 0; i < count; ++i)
      line = line && (point[i] - pivot.p_B).cross(pivot.chord).norm() <= kImpact.same_point;
    if (line && turns_about(pivot)) return true;
  }
  double greatest = 0.0;
  for (std::size_t i = 0; i < count; ++i) {
    const Pivot candidate{point[i], Vector3d::Zero()};
    const double energy = kinetic_energy(about(candidate, now_B));
    if (energy > greatest) {
      greatest = energy;
      pivot = candidate;
    }
  }
  return greatest > enough;
}

RockMechanics::Velocity RockMechanics::about(const Pivot& pivot, const Velocity& velocity_B) const {
  const Vector3d& Q = pivot.p_B;
  const Vector3d L = inertia_.cwiseProduct(velocity_B.w) - mass_ * Q.cross(velocity_B.v);
  const Matrix3d I_Q = Matrix3d(inertia_.asDiagonal()) +
                       mass_ * (Q.squaredNorm() * Matrix3d::Identity() - Q * Q.transpose());
  const Vector3d& e = pivot.chord;
  const Vector3d w = e.isZero() ? Vector3d(I_Q.ldlt().solve(L)) : Vector3d(e * (e.dot(L) / e.dot(I_Q * e)));
  return {-w.cross(Q), w};
}

double RockMechanics::kinetic_energy(const Velocity& velocity_B) const {
  return 0.5 * (mass_ * velocity_B.v.squaredNorm() +
                velocity_B.w.dot(inertia_.cwiseProduct(velocity_B.w)));
}

// The engine's step (velocities first, then positions with them) conserves the energy plus half a
// step's work of the forces at the present speed: less than the energy on the way up, more on the
// way down. Without it low swings, slow as they are, would come out too low.
bool RockMechanics::close_impact(RockState& rock, const PedestalMotion& pedestal,
                                 const Vector3d& force, double dt) {
  Impact& impact = impact_;
  impact.open = false;
  const Velocity now_B = in_body(rock, relative(rock, pedestal));
  Pivot pivot;
  if (!find_pivot(now_B, rock.q_WB.conjugate() * pedestal.R_WP.col(2), pivot)) return false;
  const double housner = kinetic_energy(about(pivot, impact.before_B)) / impact.energy;
  const double power = std::clamp((1.0 - housner) / kImpact.full_loss, 0.0, 1.0);
  const double kept = std::min(1.0, std::pow(mechanisms_.impact_energy_ratio, power) * housner);
  // The impact is where the weight had done most work: the rock was lowest there.
  const double wanted = kept * (impact.energy + impact.lead + impact.greatest_work) -
                        (impact.greatest_work - impact.work);
  const Velocity next = about(pivot, now_B);
  const double present = kinetic_energy(next);
  if (!(wanted > 0) || !(present > 0)) return false;
  // present scale^2 + 2 lag scale = wanted
  const double lag = 0.25 * dt * force.dot(rock.q_WB * next.v);
  const double scale = std::min((std::sqrt(lag * lag + present * wanted) - lag) / present,
                                std::sqrt(kImpact.greatest_gain));
  rock.v_WB = pedestal.velocity_at(rock.p_WB) + scale * (rock.q_WB * next.v);
  rock.w_WB = pedestal.w_WP + scale * (rock.q_WB * next.w);
  return true;
}

}  // namespace vsr2
