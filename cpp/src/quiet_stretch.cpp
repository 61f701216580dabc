#include "quiet_stretch.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Eigenvalues>

#include "vsr2/constants.hpp"

namespace vsr2 {
namespace {

using Eigen::Array3d;
using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

// Greatest factor of a free motion over a step v' = (v - restoring q) decay, q' = q + h v'.
double factor(double decay, double restoring, double h) {
  const double half_trace = 0.5 * (1.0 + decay * (1.0 - h * restoring));
  const double discriminant = half_trace * half_trace - decay;
  if (discriminant < 0) return std::sqrt(decay);
  return std::fabs(half_trace) + std::sqrt(discriminant);
}

}  // namespace

Bearing::Bearing(const Foothold& foothold, double gravity, double substep, int substeps)
    : foothold_(foothold),
      count_(foothold.count),
      h_(substep),
      substeps_(substeps),
      mass_(foothold.mass),
      friction_(foothold.friction),
      R_TW_(foothold.R_WT.transpose()) {
  if (count_ < 3) return;
  const auto& r = foothold.r_T;
  double z = 0.0;
  for (int i = 0; i < count_; ++i) z += r[i].z() / count_;
  Matrix3d inertia = Matrix3d::Zero();
  inertia.topLeftCorner<2, 2>() = foothold.inertia_T.topLeftCorner<2, 2>();
  inertia.diagonal() += mass_ * Vector3d(z * z, z * z, 1.0);
  Matrix3d unit_springs = Matrix3d::Zero();
  for (int i = 0; i < count_; ++i) {
    const Vector3d rise(r[i].y(), -r[i].x(), 1.0);
    unit_springs += rise * rise.transpose();
  }
  const Eigen::GeneralizedSelfAdjointEigenSolver<Matrix3d> solver(unit_springs, inertia);
  shapes_ = solver.eigenvectors();
  const Matrix3d& shapes = shapes_;
  damper_ = 1.0 / foothold.normal.softness(h_);
  spring_ = damper_ * foothold.normal.erp(h_) / h_;
  const Array3d springs = solver.eigenvalues().array();
  modes_.decay = (1.0 + springs * damper_).inverse();
  modes_.restoring = springs * spring_;
  // The mass centre moves along the top by (-z b, z a) where the rock tilts by (a, b).
  Matrix3d pull = Matrix3d::Zero();
  pull(0, 1) = mass_ * z;
  pull(1, 0) = -mass_ * z;
  pull(2, 2) = mass_;
  modes_.driven = -shapes.transpose() * pull;
  swing_.row(0) = -z * shapes.row(1);
  swing_.row(1) = z * shapes.row(0);
  const Vector3d fall_T = h_ * (R_TW_ * Vector3d(0, 0, -gravity));
  lateral_ = -mass_ * fall_T.head<2>();
  rest_ = ((shapes.transpose() * pull * fall_T).array() / modes_.restoring).matrix();
  stands_ = true;
  for (int i = 0; i < count_; ++i) {
    Contact& c = contacts_[i];
    c.rise = Vector3d(r[i].y(), -r[i].x(), 1.0).transpose() * shapes;
    c.deflection = c.rise * rest_;
    c.impulse = -spring_ * c.deflection;
    stands_ = stands_ && c.impulse > 0;
  }
  for (int j = 0; j < 3; ++j)
    memory_ = std::max(memory_, -h_ / std::log(factor(modes_.decay[j], modes_.restoring[j], h_)));
  stands_ = stands_ && std::isfinite(memory_);
}

bool Bearing::advance(const Vector3d& dv_W) {
  bool holds = substep(R_TW_ * dv_W);
  for (int i = 1; i < substeps_; ++i) holds = substep(Vector3d::Zero()) && holds;
  return holds;
}

bool Bearing::substep(const Vector3d& dv_T) {
  const Array3d before = modes_.velocity;
  const Vector3d place = modes_.place;
  modes_.velocity =
      modes_.decay * (before + (modes_.driven * dv_T).array() - modes_.restoring * modes_.place);
  modes_.place += h_ * modes_.velocity;
  const Vector3d velocity = modes_.velocity;
  const Vector3d after = modes_.place;
  bool holds = true;
  double normal = 0.0;
  double lowest = 0.0;
  for (int i = 0; i < count_; ++i) {
    const Contact& c = contacts_[i];
    const double change = -spring_ * c.rise.dot(place) - damper_ * c.rise.dot(velocity);
    const double impulse = c.impulse + kQuietStretch.safety * change;
    const double deflection = c.deflection + kQuietStretch.safety * c.rise.dot(after);
    holds = holds && impulse > 0 && deflection < 0;
    lowest = std::min(lowest, deflection);
    normal += impulse;
  }
  const Vector2d pushed = dv_T.head<2>() + swing_ * (modes_.velocity - before).matrix();
  const Vector2d lateral = lateral_ + kQuietStretch.safety * mass_ * pushed;
  return holds && lateral.norm() <= friction_.lateral(normal) && !gains_contact(lowest, after);
}

// Whether a vertex is below `lowest`, the lowest contact, where the modes are at `place`.
bool Bearing::gains_contact(double lowest, const Vector3d& place) const {
  const Vector3d moved = shapes_ * (rest_ + kQuietStretch.safety * place);
  return std::any_of(foothold_.low.begin(), foothold_.low.end(), [&](const Foothold::Low& v) {
    return v.r_T.y() * moved.x() - v.r_T.x() * moved.y() + moved.z() + v.offset <
           lowest - foothold_.same_height;
  });
}

QuietStretches::QuietStretches(const TrialSpec& spec)
    : spec_(spec),
      dt_(spec.start->scene()->engine().time_step),
      substeps_(spec.start->scene()->engine().substeps) {
  const Scene& scene = *spec.start->scene();
  if (scene.engine().skip_quiet) foothold_.low.reserve(scene.rock_hull_vertices().size());
}

// Of the pedestal, in the time step that leads to a set-point [m/s].
Vector3d QuietStretches::velocity_change(std::int64_t k) const {
  const auto size = static_cast<std::int64_t>(spec_.position.size());
  const auto at = [&](const Samples& x, std::int64_t i) {
    return x[static_cast<std::size_t>(std::clamp<std::int64_t>(i, 0, size - 1))];
  };
  const auto of = [&](const Samples& x) {
    return ((at(x, k) - at(x, k - 1)) - (at(x, k - 1) - at(x, k - 2))) / dt_;
  };
  return {of(spec_.position), spec_.transverse ? of(*spec_.transverse) : 0.0,
          spec_.vertical ? of(*spec_.vertical) : 0.0};
}

QuietStretch QuietStretches::from(const World& world, std::optional<std::int64_t> held, std::int64_t k,
                                  std::int64_t end) {
  if (spec_.pitch) return {k, end + 1};
  if (!world.foothold(foothold_)) return {k, k + 1};
  QuietStretch found = predict(world, held, k, end);
  const auto longest = static_cast<std::int64_t>(kQuietStretch.still_window / dt_);
  wait_ = found.last > k ? 1 : std::clamp<std::int64_t>(2 * wait_, 1, longest);
  found.ask_from = std::max(found.ask_from, found.last + wait_);
  return found;
}

QuietStretch QuietStretches::predict(const World& world, std::optional<std::int64_t> held,
                                     std::int64_t k, std::int64_t end) {
  const EngineSettings& engine = spec_.start->scene()->engine();
  Bearing bearing(foothold_, engine.gravity, dt_ / substeps_, substeps_);
  if (!bearing.stands()) return {k, k + 1};
  const auto faded = static_cast<std::int64_t>(std::ceil(kQuietStretch.faded * bearing.memory() / dt_));
  if (held && *held < faded) return {k, k + faded - *held};
  world.add_low_vertices(foothold_);
  // What the rock still answers to; its contacts have held.
  if (held)
    for (std::int64_t i = k - faded + 1; i <= k; ++i) bearing.advance(velocity_change(i));
  std::int64_t i = k + 1;
  while (i <= end && bearing.advance(velocity_change(i))) ++i;
  return {i > end ? end : std::max(k, i - 1 - faded), i + 1};
}

}  // namespace vsr2
