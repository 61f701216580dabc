#pragma once
// Scenes and motions for tests that compare engines.

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "vsr2/engines.hpp"

namespace vsr2::test {

enum class RockKind { box, box_off_centre, hull, hull_off_centre, hull_flat };

inline const char* name(RockKind kind) {
  constexpr const char* names[] = {"Box", "BoxOffCentre", "Hull", "HullOffCentre", "HullFlat"};
  return names[static_cast<int>(kind)];
}

inline const char* name(Drive drive) {
  constexpr const char* names[] = {"Prescribed", "PrescribedSpatial", "MotorPosition", "MotorPositionVelocity"};
  return names[static_cast<int>(drive)];
}

/// 300 random points on an ellipsoid with half axes 0.3, 0.25, 0.45 m.
inline HullPart ellipsoid() {
  std::mt19937 generator(1);
  std::normal_distribution<double> normal;
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 300; ++i) {
    Eigen::Vector3d p(normal(generator), normal(generator), normal(generator));
    p.normalize();
    points.push_back(p.cwiseProduct(Eigen::Vector3d(0.3, 0.25, 0.45)));
  }
  return HullPart(points);
}

/// A column that stands level on a nine-sided base, its mass centre at the origin.
inline HullPart column() {
  std::vector<Eigen::Vector3d> points;
  for (const double z : {-0.48, 0.5}) {
    for (int i = 0; i < 9; ++i) {
      const double angle = 0.7 * i;
      const double radius = z < 0 ? 0.25 + 0.01 * (i % 3) : 0.2;
      points.emplace_back(radius * std::cos(angle), radius * std::sin(angle), z);
    }
  }
  return HullPart(points);
}

inline RockSpec rock(RockKind kind) {
  RockSpec spec;
  spec.mass = 353.8;
  const bool box = kind == RockKind::box || kind == RockKind::box_off_centre;
  if (box) {
    spec.parts.emplace_back(BoxPart{{0.4, 0.55, 0.95}, {}});
  } else {
    spec.parts.emplace_back(kind == RockKind::hull_flat ? column() : ellipsoid());
  }
  if (kind != RockKind::box_off_centre && kind != RockKind::hull_off_centre) {
    spec.inertia_from_aabb = true;
  } else {
    spec.principal_inertia = {11.8, 18.8, 25.1};
    spec.X_MB.position = {0.003, -0.002, 0.004};
    spec.X_MB.orientation =
        Eigen::Quaterniond(Eigen::AngleAxisd(0.075, Eigen::Vector3d(0.3, 0.5, 0.8).normalized()));
  }
  return spec;
}

inline PedestalSpec pedestal(const Eigen::Vector3d& size = {10, 10, 0.5}) {
  PedestalSpec spec;
  spec.parts.emplace_back(BoxPart{size, {}});
  spec.p_WP0.z() = 2.5 - 0.5 * size.z();
  return spec;
}

inline std::shared_ptr<const Scene> scene(RockKind kind, const EngineSettings& engine = {},
                                          const PedestalSpec& on = pedestal()) {
  return std::make_shared<Scene>(engine, on, rock(kind));
}

inline EngineSettings undamped(int substeps = 1) {
  EngineSettings engine;
  engine.linear_damping = 0.0;
  engine.angular_damping = 0.0;
  engine.substeps = substeps;
  return engine;
}

/// Every step swept, as in Bullet.
inline EngineSettings swept() {
  EngineSettings engine;
  engine.converged_contacts = false;
  return engine;
}

enum class Engine { parity, exact, fast };
inline constexpr Engine kEngines[] = {Engine::parity, Engine::exact, Engine::fast};

inline std::unique_ptr<World> make(Engine engine, const std::shared_ptr<const Scene>& scene,
                                   Drive drive = Drive::prescribed) {
  switch (engine) {
    case Engine::parity: return make_bullet_world(scene, drive);
    case Engine::exact: return make_exact_world(scene, drive);
    default: return make_fast_world(scene, drive);
  }
}

/// Just above the pedestal's top, a little turned; the ellipsoid leans so that it rocks, the others
/// are level.
inline Pose start(RockKind kind) {
  const bool level = kind != RockKind::hull && kind != RockKind::hull_off_centre;
  const Eigen::Vector3d axis =
      level ? Eigen::Vector3d(0, 0, 1) : Eigen::Vector3d(1, 0.4, 0.1).normalized();
  return {{0, 0, level ? 2.985 : 2.96}, Eigen::Quaterniond(Eigen::AngleAxisd(0.2, axis))};
}

/// One cosine pulse, displacement A (1 - cos) [m], after 0.3 s at rest.
struct Pulse {
  double amplitude = 0.12;
  double frequency = 1.2;
  DriveTarget at(int step) const {
    const double t = 1e-3 * step - 0.3;
    if (t < 0 || t > 1 / frequency) return {};
    const double phase = 2 * M_PI * frequency * t;
    return {amplitude * (1 - std::cos(phase)), amplitude * 2 * M_PI * frequency * std::sin(phase)};
  }
};

inline double angle_between(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  return 2.0 * std::asin(std::min(1.0, (a * b.conjugate()).vec().norm()));
}

inline bool same_bits(const Eigen::Ref<const Eigen::VectorXd>& a,
                      const Eigen::Ref<const Eigen::VectorXd>& b) {
  return a.size() == b.size() &&
         std::memcmp(a.data(), b.data(), sizeof(double) * static_cast<std::size_t>(a.size())) == 0;
}

inline bool same_bits(const RockState& a, const RockState& b) {
  return same_bits(a.p_WB, b.p_WB) && same_bits(a.q_WB.coeffs(), b.q_WB.coeffs()) &&
         same_bits(a.v_WB, b.v_WB) && same_bits(a.w_WB, b.w_WB);
}

inline bool same_bits(const PedestalState& a, const PedestalState& b) {
  return std::memcmp(&a, &b, sizeof a) == 0;
}

inline bool same_bits(const ContactPoint& a, const ContactPoint& b) {
  return same_bits(a.p_W_rock, b.p_W_rock) && same_bits(a.p_W_pedestal, b.p_W_pedestal) &&
         same_bits(a.normal_W, b.normal_W) && a.distance == b.distance &&
         a.normal_impulse == b.normal_impulse && a.lateral_impulse_1 == b.lateral_impulse_1 &&
         a.lateral_impulse_2 == b.lateral_impulse_2;
}

}  // namespace vsr2::test
