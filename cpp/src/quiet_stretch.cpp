#include "quiet_stretch.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Eigenvalues>

#include "vsr2/constants.hpp"

namespace vsr2 {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

// Greatest answer of a linear oscillator to an input of size 1, over its static answer [1].
double overshoot(double damping_ratio) {
  if (damping_ratio >= 1.0) return 1.0;
  const double r = damping_ratio / std::sqrt(1.0 - damping_ratio * damping_ratio);
  return 1.0 / std::tanh(0.5 * M_PI * r);
}

// Rate at which the slower part of its free motion fades [1/s].
double fading(double damping_ratio, double frequency) {
  const double z = damping_ratio;
  return z < 1.0 ? z * frequency : frequency / (z + std::sqrt(z * z - 1.0));
}

}  // namespace

Bearing::Bearing(const Foothold& foothold, double gravity)
    : friction_(foothold.friction),
      R_TW_(foothold.R_WT.transpose()),
      rest_T_(R_TW_ * Vector3d(0, 0, gravity)) {
  const auto& r = foothold.r_T;
  for (int i = 0; i < foothold.count; ++i) {
    for (int j = i + 1; j < foothold.count; ++j) {
      const Vector2d along = (r[j] - r[i]).head<2>();
      if (!(along.squaredNorm() > 0)) continue;
      Vector2d inward = Vector2d(-along.y(), along.x()).normalized();
      double least = 0.0;
      double greatest = 0.0;
      for (int k = 0; k < foothold.count; ++k) {
        const double inside = inward.dot((r[k] - r[i]).head<2>());
        least = std::min(least, inside);
        greatest = std::max(greatest, inside);
      }
      if (least < -kQuietStretch.on_line && greatest > kQuietStretch.on_line) continue;
      if (least < -kQuietStretch.on_line) inward = -inward;
      if (std::max(-least, greatest) <= kQuietStretch.on_line) continue;
      edges_[count_++] = {inward, -0.5 * (r[i].z() + r[j].z()), -inward.dot(r[i].head<2>())};
    }
  }
  if (count_ < 3) return;
  // The three ways to move over sticking contacts of sticking_contacts.hpp: tilts a, b, rise c.
  double z = 0.0;
  for (int i = 0; i < foothold.count; ++i) z += r[i].z() / foothold.count;
  Matrix3d inertia = Matrix3d::Zero();
  inertia.topLeftCorner<2, 2>() = foothold.inertia_T.topLeftCorner<2, 2>();
  inertia.diagonal() += foothold.mass * Vector3d(z * z, z * z, 1.0);
  Matrix3d unit_springs = Matrix3d::Zero();
  for (int i = 0; i < foothold.count; ++i) {
    const Vector3d rise(r[i].y(), -r[i].x(), 1.0);
    unit_springs += rise * rise.transpose();
  }
  const Vector3d modes = Eigen::GeneralizedSelfAdjointEigenSolver<Matrix3d>(unit_springs, inertia,
                                                                            Eigen::EigenvaluesOnly)
                             .eigenvalues();
  for (const double mode : modes) {
    const double frequency = foothold.normal.frequency(std::max(mode, 0.0));
    const double ratio = foothold.normal.damping_ratio(frequency);
    gain_ = std::max(gain_, overshoot(ratio));
    memory_ = std::max(memory_, 1.0 / fading(ratio, frequency));
  }
  gain_ *= kQuietStretch.safety;
}

bool Bearing::bears(const Vector3d& a_W) const {
  const Vector3d f = rest_T_ + gain_ * (R_TW_ * a_W);
  const Vector2d lateral = f.head<2>();
  if (count_ < 3 || !(f.z() > 0) || !(lateral.norm() <= friction_.lateral(f.z()))) return false;
  for (int i = 0; i < count_; ++i)
    if (!(edges_[i].height * edges_[i].inward.dot(lateral) <= edges_[i].room * f.z())) return false;
  return true;
}

QuietStretches::QuietStretches(const TrialSpec& spec)
    : spec_(spec),
      dt_(spec.start->scene()->engine().time_step),
      substep_(dt_ / spec.start->scene()->engine().substeps) {}

// Of the pedestal in the first solver step towards a set-point, which takes all of a change of speed.
Vector3d QuietStretches::acceleration(std::int64_t k) const {
  const auto size = static_cast<std::int64_t>(spec_.position.size());
  const auto at = [&](const Samples& x, std::int64_t i) {
    return x[static_cast<std::size_t>(std::clamp<std::int64_t>(i, 0, size - 1))];
  };
  const auto of = [&](const Samples& x) {
    return ((at(x, k) - at(x, k - 1)) - (at(x, k - 1) - at(x, k - 2))) / (dt_ * substep_);
  };
  return {of(spec_.position), spec_.transverse ? of(*spec_.transverse) : 0.0,
          spec_.vertical ? of(*spec_.vertical) : 0.0};
}

std::int64_t QuietStretches::last(const Foothold& foothold, std::int64_t k, std::int64_t end,
                                  std::int64_t& next) const {
  next = end + 1;
  if (spec_.pitch) return k;
  const EngineSettings& engine = spec_.start->scene()->engine();
  const Bearing bearing(foothold, engine.gravity);
  std::int64_t i = k + 1;
  while (i <= end && bearing.bears(acceleration(i))) ++i;
  if (i > end) return end;
  next = i + 1;
  const auto faded = static_cast<std::int64_t>(std::ceil(kQuietStretch.faded * bearing.memory() / dt_));
  return std::max(k, i - 1 - faded);
}

}  // namespace vsr2
