#include "pitch_joint.hpp"

#include <cmath>
#include <sstream>

namespace vsr2 {
namespace {

// cos x and sin x / x, for an x^2 that may be negative; near 0 series, whose terms left out are below
// 1e-20.
void cosine_and_sinc(double square, double& cosine, double& sinc) {
  const double x = std::sqrt(std::fabs(square));
  if (x < 1e-3) {
    cosine = 1.0 - square / 2 + square * square / 24;
    sinc = 1.0 - square / 6 + square * square / 120;
  } else if (square > 0) {
    cosine = std::cos(x);
    sinc = std::sin(x) / x;
  } else {
    cosine = std::cosh(x);
    sinc = std::sinh(x) / x;
  }
}

}  // namespace

PitchJoint::PitchJoint(const Scene& scene, double dt)
    : pedestal_(scene.pedestal()),
      dt_(dt),
      weight_(scene.rock().mass * scene.engine().gravity),
      mass_(scene.rock().mass),
      rock_inertia_(scene.rock_inertia()) {
  const PitchSpring& spring = scene.pedestal().pitch_spring.value();
  const double w = 2 * M_PI * spring.frequency;
  const double zeta = spring.damping;
  inverse_inertia_ = 1.0 / spring.inertia;
  stiffness_ = w * w * spring.inertia;
  drive_ = -w * w * spring.compliance;
  double cosine;
  double sinc;
  cosine_and_sinc((1.0 - zeta * zeta) * (w * dt) * (w * dt), cosine, sinc);
  const double decay = std::exp(-zeta * w * dt);
  pitch_from_rate_ = decay * sinc * dt;
  pitch_from_pitch_ = decay * cosine + zeta * w * pitch_from_rate_;
  rate_from_pitch_ = -w * w * pitch_from_rate_;
  rate_from_rate_ = decay * cosine - zeta * w * pitch_from_rate_;
  chord_ = pitch_from_rate_ / dt;
}

void PitchJoint::start(const RockState& rock, const PedestalState& pedestal) {
  const Eigen::Vector3d arm = rock.p_WB - pitch_axis(pedestal_, pedestal);
  if (weight_ * arm.z() >= stiffness_) {
    std::ostringstream text;
    text << "the pedestal's sprung pitch joint does not carry the rock: its stiffness, "
         << stiffness_ << " N m/rad, is not above m g h = " << weight_ * arm.z()
         << " N m; give it more inertia or a higher frequency";
    throw InvalidInput(text.str());
  }
  // The deflection and the rate before each blow that blows of the weight in every step lead to.
  const double blow = weight_ * arm.x() * dt_ * inverse_inertia_;
  const double trace = pitch_from_pitch_ + rate_from_rate_;
  const double determinant =
      pitch_from_pitch_ * rate_from_rate_ - pitch_from_rate_ * rate_from_pitch_;
  pitch_ = blow * pitch_from_rate_ / (1.0 - trace + determinant);
  rate_ = (1.0 - pitch_from_pitch_) / pitch_from_rate_ * pitch_ - blow;
  pending_ = 0.0;
}

void PitchJoint::react(const RockState& before, const RockState& after,
                       const PedestalState& pedestal) {
  const Eigen::Vector3d p = mass_ * (after.v_WB - before.v_WB);
  const Eigen::Matrix3d R = before.q_WB.toRotationMatrix();
  const Eigen::Vector3d spin =
      R * rock_inertia_.cwiseProduct(R.transpose() * (after.w_WB - before.w_WB));
  const Eigen::Vector3d arm = before.p_WB - pitch_axis(pedestal_, pedestal);
  pending_ -= (arm.cross(p).y() + spin.y()) * inverse_inertia_;
}

double PitchJoint::blow(double velocity_change) {
  rate_ += drive_ * velocity_change + pending_;
  pending_ = 0.0;
  free_rate_ = ((pitch_from_pitch_ - 1.0) * pitch_ + pitch_from_rate_ * rate_) / dt_;
  return free_rate_;
}

void PitchJoint::finish(double rate) {
  // Of the contacts' blow; the rock is nothing to a table of infinite inertia, but for rounding.
  if (inverse_inertia_ > 0) rate_ += (rate - free_rate_) / chord_;
  rate_ = rate_from_pitch_ * pitch_ + rate_from_rate_ * rate_;
  pitch_ += dt_ * rate;
}

}  // namespace vsr2
