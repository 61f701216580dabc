// Pedestals that move along y and z and in pitch beside x.

#include <atomic>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "allocation_count.hpp"
#include "engine_scenes.hpp"
#include "scenes.hpp"
#include "vsr2/engines.hpp"

namespace vsr2 {
namespace {

using test::RockKind;
using test::undamped;
using testing::block_scene;
using testing::BlockOptions;
using testing::standing;

constexpr Drive kSpatial = Drive::prescribed_spatial;
constexpr double kG = 9.81;

/// One of each engine.
std::vector<std::unique_ptr<World>> worlds(const std::shared_ptr<const Scene>& scene, Drive drive) {
  std::vector<std::unique_ptr<World>> out;
  out.push_back(make_bullet_world(scene, drive));
  out.push_back(make_exact_world(scene, drive));
  out.push_back(make_fast_world(scene, drive));
  return out;
}

/// All directions at once.
DriveTarget wander(int step) {
  const double t = 1e-3 * step;
  const auto wave = [t](double size, double frequency) {
    return size * (1 - std::cos(2 * M_PI * frequency * t));
  };
  return {wave(0.04, 1.5), 0, {wave(0.03, 1.1), wave(0.01, 2.3), wave(0.01, 3.1)}};
}

TEST(PedestalMotion, ArrivesWhereItIsSent) {
  for (const int substeps : {1, 3}) {
    const auto scene = block_scene({.engine = undamped(substeps)});
    for (const auto& world : worlds(scene, kSpatial)) {
      world->spawn_rock(standing(0.4752));
      for (int i = 1; i <= 500; ++i) {
        world->step(wander(i));
        const PedestalState state = world->pedestal();
        const DriveTarget target = wander(i);
        ASSERT_DOUBLE_EQ(state.position, target.position);
        ASSERT_DOUBLE_EQ(state.excursion.transverse, target.excursion.transverse);
        ASSERT_DOUBLE_EQ(state.excursion.vertical, target.excursion.vertical);
        ASSERT_DOUBLE_EQ(state.excursion.pitch, target.excursion.pitch);
      }
    }
  }
}

// Whether Bullet's chain of joints really puts the collision shape there: the contacts lie on it.
TEST(PedestalMotion, CarriesTheContactsAlong) {
  BlockOptions options;
  options.size = {0.6, 0.6, 0.2};
  const auto scene = block_scene(options);
  for (const auto& world : worlds(scene, kSpatial)) {
    world->spawn_rock(standing(0.1));
    PedestalState before = world->pedestal();
    std::vector<ContactPoint> contacts;
    for (int i = 1; i <= 600; ++i) {
      before = world->pedestal();
      world->step(wander(i));
      world->contacts(contacts);
      // Contacts are found where the pedestal was at the start of the step.
      const PedestalMotion motion = pedestal_motion(scene->pedestal(), before);
      for (const ContactPoint& c : contacts) {
        const Eigen::Vector3d p_P = motion.R_WP.transpose() * (c.p_W_pedestal - motion.p_WP);
        ASSERT_NEAR(p_P.z(), 0.25, 1e-9) << i;
        ASSERT_LT((c.normal_W - motion.R_WP.col(2)).norm(), 1e-9) << i;
      }
    }
    EXPECT_FALSE(contacts.empty());
    // The block went along: it still stands on the middle of the top.
    const PedestalMotion motion = pedestal_motion(scene->pedestal(), world->pedestal());
    const Eigen::Vector3d p_P = motion.R_WP.transpose() * (world->rock().p_WB - motion.p_WP);
    EXPECT_LT((p_P - Eigen::Vector3d(0, 0, 0.35)).norm(), 1e-3);
  }
}

TEST(PedestalMotion, PitchesAboutItsPivot) {
  PedestalSpec pedestal;
  pedestal.pitch_pivot = 0.7;
  // The point of the pedestal that lies on the axis stays where it is.
  const PedestalMotion motion = pedestal_motion(pedestal, {.excursion = {0, 0, 0.3}});
  const Eigen::Vector3d axis_P = Eigen::Vector3d(0, 0, 0.7) - pedestal.p_WP0;
  EXPECT_LT((motion.p_WP + motion.R_WP * axis_P - Eigen::Vector3d(0, 0, 0.7)).norm(), 1e-15);
  // The velocity is the place's derivative.
  PedestalState state{0.1, 0.4, {0.2, -0.1, 0.3}, {0.5, 0.6, -0.7}};
  const double dt = 1e-6;
  PedestalState later = state;
  later.position += dt * state.velocity;
  later.excursion.transverse += dt * 0.5;
  later.excursion.vertical += dt * 0.6;
  later.excursion.pitch += dt * -0.7;
  const PedestalMotion now = pedestal_motion(pedestal, state);
  const PedestalMotion then = pedestal_motion(pedestal, later);
  EXPECT_LT(((then.p_WP - now.p_WP) / dt - now.v_WP).norm(), 1e-5);
  EXPECT_NEAR((now.velocity_at(now.p_WP + Eigen::Vector3d(0, 0, 1)) - now.v_WP).x(), -0.7, 1e-12);
}

TEST(PedestalMotion, GivesTheSameBitsInExactAsInParity) {
  for (const RockKind kind : {RockKind::box, RockKind::box_off_centre, RockKind::hull_off_centre}) {
    for (const int substeps : {1, 2}) {
      const auto scene =
          std::make_shared<Scene>(EngineSettings{.substeps = substeps}, test::pedestal(), test::rock(kind));
      const auto parity = make_bullet_world(scene, kSpatial);
      const auto exact = make_exact_world(scene, kSpatial);
      parity->spawn_rock(test::start(kind));
      exact->spawn_rock(test::start(kind));
      for (int i = 1; i <= 800; ++i) {
        parity->step(wander(i));
        exact->step(wander(i));
        ASSERT_TRUE(test::same_bits(parity->rock(), exact->rock())) << test::name(kind) << i;
      }
    }
  }
}

// The drive in space with nothing but x differs from the drive along x by rounding alone.
TEST(PedestalMotion, ReducesToTheMotionAlongX) {
  for (const RockKind kind : {RockKind::box, RockKind::hull}) {
    const auto scene = std::make_shared<Scene>(EngineSettings{}, test::pedestal(), test::rock(kind));
    const auto along = worlds(scene, Drive::prescribed);
    const auto spatial = worlds(scene, kSpatial);
    const test::Pulse pulse;
    for (std::size_t k = 0; k < along.size(); ++k) {
      along[k]->spawn_rock(test::start(kind));
      spatial[k]->spawn_rock(test::start(kind));
      for (int i = 0; i < 700; ++i) {
        along[k]->step(pulse.at(i));
        spatial[k]->step(pulse.at(i));
        ASSERT_LT((along[k]->rock().p_WB - spatial[k]->rock().p_WB).norm(), 1e-9) << k << " " << i;
      }
    }
  }
}

TEST(PedestalMotion, FastFollowsParity) {
  for (const RockKind kind : {RockKind::box, RockKind::hull}) {
    const auto scene = std::make_shared<Scene>(EngineSettings{}, test::pedestal(), test::rock(kind));
    const auto parity = make_bullet_world(scene, kSpatial);
    const auto fast = make_fast_world(scene, kSpatial);
    parity->spawn_rock(test::start(kind));
    fast->spawn_rock(test::start(kind));
    double apart = 0.0;
    for (int i = 1; i <= 500; ++i) {
      parity->step(wander(i));
      fast->step(wander(i));
      apart = std::max(apart, (parity->rock().p_WB - fast->rock().p_WB).norm());
    }
    EXPECT_EQ(fast->handover(), Handover::none);
    // The friction cone's two directions turn with the pedestal here and lie in other axes there.
    EXPECT_LT(apart, 2e-5) << test::name(kind);
  }
}

TEST(PedestalMotion, RefusesAnExcursionAlongX) {
  const auto scene = block_scene();
  for (const Drive drive : {Drive::prescribed, Drive::motor_position})
    for (const auto& world : worlds(scene, drive))
      EXPECT_THROW(world->step({0, 0, {0, 0.1, 0}}), InvalidInput);
  std::atomic<bool> cancel{false};
  TrialSpec spec = testing::trial_of(scene, standing(0.475), testing::cosine(0.01, 2.0));
  spec.pitch = spec.position;
  EXPECT_NE(run_trial(spec, cancel).message.find("prescribed_spatial"), std::string::npos);
}

// A block at rest on a pedestal that rises with an acceleration is borne with m (g + a).
TEST(PedestalMotion, VerticalAccelerationChangesTheNormalForce) {
  BlockOptions options;
  options.engine = undamped();
  const auto scene = block_scene(options);
  for (const double a : {-4.0, 3.0}) {
    for (const auto& world : worlds(scene, kSpatial)) {
      world->spawn_rock(standing(0.475));
      for (int i = 0; i < 500; ++i) world->step({});
      std::vector<ContactPoint> contacts;
      double impulse = 0.0;
      for (int i = 1; i <= 300; ++i) {
        world->step({0, 0, {0, 0.5 * a * std::pow(i * 1e-3, 2), 0}});
        if (i <= 200) continue;
        world->contacts(contacts);
        for (const ContactPoint& c : contacts) impulse += c.normal_impulse / 100;
      }
      const double expected = scene->rock().mass * (kG + a) * 1e-3;
      EXPECT_NEAR(impulse, expected, 1e-3 * expected) << a;
    }
  }
}

// Pitched slowly, a wide block begins to slide at atan(mu), a slender one to overturn at atan(b/h).
double angle_of_first_move(World& world, double limit, double arm) {
  const PedestalSpec pedestal;
  for (int i = 0; i < 400; ++i) world.step({});
  const double x0 = world.rock().p_WB.x();
  for (int i = 1; i < 9000; ++i) {
    const double pitch = 0.05 * i * 1e-3;
    world.step({0, 0, {0, 0, pitch}});
    const PedestalMotion motion = pedestal_motion(pedestal, world.pedestal());
    const Eigen::Vector3d up_P = motion.R_WP.transpose() * (world.rock().q_WB * Eigen::Vector3d::UnitZ());
    const double x_P = motion.R_WP.col(0).dot(world.rock().p_WB - motion.p_WP);
    if (std::abs(x_P - x0) + arm * up_P.head<2>().norm() > limit) return pitch;
  }
  return NAN;
}

TEST(PedestalMotion, PitchTiltsGravity) {
  BlockOptions wide;
  wide.size = {1.0, 1.0, 0.2};
  wide.engine = undamped();
  wide.material = testing::frictional(std::sqrt(0.3));
  BlockOptions slender;
  slender.size = {0.2, 0.8, 1.0};
  slender.engine = undamped();
  slender.material = testing::frictional(1.2);
  // 1 mm of movement comes within 0.02 s of the onset for sliding at 9.81 x 0.05 t m/s^3, and
  // later for the slow growth of overturning: at 0.05 rad/s both are within 0.012 rad.
  for (const auto& world : worlds(block_scene(wide), kSpatial)) {
    world->spawn_rock(standing(0.1));
    const double angle = angle_of_first_move(*world, 1e-3, 0.0);
    EXPECT_GT(angle, std::atan(0.3) - 1e-3);
    EXPECT_LT(angle, std::atan(0.3) + 0.012);
  }
  for (const auto& world : worlds(block_scene(slender), kSpatial)) {
    world->spawn_rock(standing(0.5));
    const double angle = angle_of_first_move(*world, 1e-3, 0.5);
    EXPECT_GT(angle, std::atan(0.2) - 1e-3);
    EXPECT_LT(angle, std::atan(0.2) + 0.012);
  }
}

// A square block does along y what it does along x.
TEST(PedestalMotion, TransverseRocksAboutTheOtherAxis) {
  const auto scene = block_scene({.size = {0.25, 0.25, 1.0}});
  for (int engine = 0; engine < 3; ++engine) {
    double peak[2] = {0, 0};
    for (const int axis : {0, 1}) {
      const auto world = std::move(worlds(scene, kSpatial)[static_cast<std::size_t>(engine)]);
      world->spawn_rock(standing(0.5));
      for (int i = 0; i < 500; ++i) world->step({});
      for (int i = 1; i <= 400; ++i) {
        const double s = 0.08 * (1 - std::cos(2 * M_PI * 1.5 * i * 1e-3));
        world->step(axis == 0 ? DriveTarget{s} : DriveTarget{0, 0, {s, 0, 0}});
        const Eigen::Vector3d up = world->rock().q_WB * Eigen::Vector3d::UnitZ();
        peak[axis] = std::max(peak[axis], std::abs(up[axis]));
        ASSERT_LT(std::abs(up[1 - axis]), 1e-3);
      }
    }
    EXPECT_GT(peak[0], 0.02);
    EXPECT_NEAR(peak[0], peak[1], 1e-3 * peak[0]) << engine;
  }
}

// What a trial reports is relative to the moving pedestal: a wide block that goes along with a
// pedestal that turns and rises has no tilt, no slip and no fall.
TEST(PedestalMotion, TrialsAreRelativeToThePedestal) {
  const auto scene = block_scene({.size = {0.8, 0.8, 0.3}});
  const auto ramp = [](double size) {
    auto out = std::make_shared<std::vector<double>>();
    for (int i = 0; i <= 2000; ++i) out->push_back(0.5 * size * (1 - std::cos(M_PI * i / 2000.0)));
    return out;
  };
  TrialSpec spec = testing::trial_of(scene, standing(0.15), *ramp(0.2), kSpatial);
  spec.transverse = Samples(ramp(-0.3));
  spec.vertical = Samples(ramp(-0.4));
  spec.pitch = Samples(ramp(0.15));
  spec.log_every = 10;
  std::atomic<bool> cancel{false};
  const TrialResult result = run_trial(spec, cancel);
  EXPECT_EQ(result.status, Status::ok) << result.message;
  EXPECT_EQ(result.outcome, Outcome::stable);
  EXPECT_LT(result.peak_tilt, 1e-3);
  EXPECT_LT(result.final_slip, 1e-3);
  ASSERT_EQ(result.excursions.size() / kExcursionColumns, result.log.size() / kLogColumns);
  EXPECT_NEAR(result.excursions.back(), 0.15, 1e-12);
}

TEST(PedestalMotion, StepsWithoutAllocating) {
  test::count_bullet_allocations();
  for (const RockKind kind : {RockKind::box, RockKind::hull}) {
    const auto scene = std::make_shared<Scene>(EngineSettings{}, test::pedestal(), test::rock(kind));
    const auto all = worlds(scene, kSpatial);
    for (std::size_t k = 1; k < all.size(); ++k) {
      all[k]->spawn_rock(test::start(kind));
      for (int i = 1; i < 300; ++i) all[k]->step(wander(i));
      const long before = test::allocation_count();
      for (int i = 300; i < 1000; ++i) all[k]->step(wander(i));
      EXPECT_EQ(test::allocation_count() - before, 0) << k;
    }
  }
}

}  // namespace
}  // namespace vsr2
