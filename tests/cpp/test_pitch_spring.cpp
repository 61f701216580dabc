// The pedestal's sprung pitch joint, against closed forms and conservation laws.

#include <atomic>
#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "allocation_count.hpp"
#include "engine_scenes.hpp"
#include "scenes.hpp"
#include "vsr2/engines.hpp"

namespace vsr2 {
namespace {

using test::RockKind;
using testing::standing;

constexpr Drive kSpatial = Drive::prescribed_spatial;
constexpr double kG = 9.81;
constexpr double kDt = 1e-3;
constexpr double kAxis = 2.0;  // height of the pitch axis; the top is at 2.5 m

struct Options {
  PitchSpring spring;
  Eigen::Vector3d size{0.6, 0.6, 0.2};  ///< of the block, a flat one stays down
  double gravity = kG;
  double friction = 2.0;
  double slope = 0.0;  ///< of the top about x [rad]
  int substeps = 1;
  Mechanisms mechanisms = {};
};

std::shared_ptr<const Scene> table(const Options& o) {
  EngineSettings engine;
  engine.linear_damping = engine.angular_damping = 0.0;
  engine.gravity = o.gravity;
  engine.substeps = o.substeps;
  PedestalSpec pedestal;
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(o.slope, Eigen::Vector3d::UnitX()));
  pedestal.parts = {BoxPart{{10, 10, 0.5}, {Eigen::Vector3d::Zero(), turn}}};
  pedestal.material["lateral_friction"] = o.friction;
  pedestal.pitch_pivot = kAxis;
  pedestal.pitch_spring = o.spring;
  const Eigen::Vector3d s = o.size;
  RockSpec rock;
  rock.parts = {BoxPart{s, {}}};
  rock.mass = 2700 * s.prod();
  rock.principal_inertia = rock.mass / 12 *
                           Eigen::Vector3d(s.y() * s.y() + s.z() * s.z(), s.x() * s.x() + s.z() * s.z(),
                                           s.x() * s.x() + s.y() * s.y());
  rock.material["lateral_friction"] = o.friction;
  return std::make_shared<Scene>(engine, pedestal, rock, o.mechanisms);
}

/// One of each engine.
std::vector<std::unique_ptr<World>> worlds(const std::shared_ptr<const Scene>& scene) {
  std::vector<std::unique_ptr<World>> out;
  out.push_back(make_bullet_world(scene, kSpatial));
  out.push_back(make_exact_world(scene, kSpatial));
  out.push_back(make_fast_world(scene, kSpatial));
  return out;
}

double pitch(const World& world) { return world.pedestal().excursion.pitch; }

/// Shakes the table by one period of A (1 - cos) with the given greatest acceleration.
void shake(World& world, double acceleration, double frequency) {
  const double w = 2 * M_PI * frequency;
  const int steps = static_cast<int>(std::lround(1.0 / frequency / kDt));
  for (int i = 1; i <= steps; ++i)
    world.step({acceleration / (w * w) * (1 - std::cos(2 * M_PI * i / steps))});
}

struct Swing {
  double frequency;  ///< [Hz]
  double damping;    ///< ratio, from the logarithmic decrement
};

/// Of free swings about `centre`.
Swing swing(World& world, double centre, int cycles) {
  std::vector<double> crossings;
  std::vector<double> peaks;
  double last = pitch(world) - centre;
  for (int i = 0; static_cast<int>(crossings.size()) < 2 * cycles + 1; ++i) {
    world.step({});
    const double now = pitch(world) - centre;
    if ((now > 0) != (last > 0)) {
      crossings.push_back(i + last / (last - now));
      peaks.push_back(0.0);
    }
    if (!peaks.empty()) peaks.back() = std::max(peaks.back(), std::fabs(now));
    last = now;
    if (i > 20000) return {};
  }
  const double time = (crossings.back() - crossings.front()) * kDt;
  const auto n = static_cast<double>(peaks.size() - 2);
  const double decrement = std::log(peaks.front() / peaks[peaks.size() - 2]) / n;
  return {cycles / time, decrement / std::hypot(M_PI, decrement)};
}

constexpr double kPerG = 0.005 / kG;

TEST(PitchSpring, SwingsFreelyWithoutARock) {
  const PitchSpring spring{.frequency = 6.0, .damping = 0.05, .compliance = kPerG, .inertia = 500};
  for (const auto& world : worlds(table({.spring = spring}))) {
    shake(*world, 2.0, 3.0);
    const Swing found = swing(*world, 0.0, 8);
    // The joint's swinging is exact; crossings and peaks are taken from samples.
    EXPECT_NEAR(found.frequency, 6.0 * std::sqrt(1 - 0.05 * 0.05), 1e-3);
    EXPECT_NEAR(found.damping, 0.05, 1e-3);
  }
}

// Between samples the pedestal goes straight, so blows at the samples stand for the acceleration:
// amplitudes at the samples are off by up to a twelfth of (w dt)^2 and (W dt)^2.
TEST(PitchSpring, AnswersASineAsAnOscillatorDoes) {
  const PitchSpring spring{.frequency = 8.0, .damping = 0.1, .compliance = kPerG, .inertia = 500};
  const double w = 2 * M_PI * spring.frequency;
  for (const double frequency : {2.0, 8.0, 14.0}) {
    const double W = 2 * M_PI * frequency;
    const double acceleration = 1.5;
    const double amplitude = w * w * kPerG * acceleration /
                             std::hypot(w * w - W * W, 2 * spring.damping * w * W);
    for (const auto& world : worlds(table({.spring = spring}))) {
      double greatest = 0.0;
      for (int i = 1; i <= 6000; ++i) {
        world->step({acceleration / (W * W) * std::sin(W * i * kDt)});
        if (i > 5000) greatest = std::max(greatest, std::fabs(pitch(*world)));
      }
      EXPECT_NEAR(greatest, amplitude, 2e-3 * amplitude) << frequency;
    }
  }
}

TEST(PitchSpring, LeansBackUnderAConstantAcceleration) {
  const PitchSpring spring{.frequency = 10.0, .damping = 0.3, .compliance = kPerG, .inertia = 500};
  for (const int substeps : {1, 4}) {
    for (const auto& world : worlds(table({.spring = spring, .substeps = substeps}))) {
      for (int i = 1; i <= 2000; ++i) world->step({0.5 * 1.2 * i * kDt * i * kDt});
      EXPECT_NEAR(pitch(*world), -1.2 * kPerG, 1e-3 * 1.2 * kPerG);
    }
  }
}

// A table of infinite inertia does not feel the rock.
TEST(PitchSpring, FeelsNoRockIfInfinite) {
  const PitchSpring spring{.compliance = kPerG};
  const auto empty = worlds(table({.spring = spring}));
  const auto loaded = worlds(table({.spring = spring}));
  for (std::size_t k = 0; k < empty.size(); ++k) {
    loaded[k]->spawn_rock({{0.4, 0, 2.61}, Eigen::Quaterniond::Identity()});
    for (int i = 1; i <= 800; ++i) {
      const DriveTarget target{0.02 * (1 - std::cos(0.01 * i))};
      empty[k]->step(target);
      loaded[k]->step(target);
      ASSERT_NEAR(pitch(*empty[k]), pitch(*loaded[k]), 1e-15) << k << " " << i;
    }
    EXPECT_GT(std::fabs(pitch(*empty[k])), 1e-5);
  }
}

TEST(PitchSpring, TurnsUnderAnEccentricWeight) {
  for (const Mechanisms& mechanisms : {Mechanisms{}, Mechanisms{.adhesion = 2e4}}) {
    const Options o{.spring = {.frequency = 6.0, .damping = 0.5, .inertia = 200},
                    .mechanisms = mechanisms};
    const auto scene = table(o);
    const double w = 2 * M_PI * 6.0;
    const double stiffness = 200 * w * w;
    for (const auto& world : worlds(scene)) {
      world->spawn_rock({{0.5, 0.1, 2.6005}, Eigen::Quaterniond::Identity()});
      for (int i = 0; i < 4000; ++i) world->step({});
      const double moment = scene->rock().mass * kG * world->rock().p_WB.x();
      // Samples are taken at the blows, where a swinging joint is (w dt)^2 / 12 short of the mean.
      EXPECT_NEAR(pitch(*world), moment / stiffness, 3e-4 * moment / stiffness);
      EXPECT_GT(pitch(*world), 1e-3);
      EXPECT_LT(world->rock().v_WB.norm(), 1e-5);
      // Put down again as it rests, it stays so: nothing jumps.
      const RockState rest = world->rock();
      const double before = pitch(*world);
      world->delete_rock();
      world->spawn_rock({rest.p_WB, rest.q_WB});
      EXPECT_NEAR(pitch(*world), before, 1e-8);
      for (int i = 0; i < 200; ++i) {
        world->step({});
        ASSERT_NEAR(pitch(*world), before, 2e-6) << i;
      }
    }
  }
}

// Table and block swing as one: I + I_O about the axis, against the spring less the block's m g h.
TEST(PitchSpring, SwingsSlowerWithABlockOnIt) {
  const double inertia = 50.0;
  const double damping = 0.03;
  for (const double slope : {0.0, 0.05}) {
    const Options o{.spring = {.frequency = 6.0, .damping = damping, .compliance = kPerG, .inertia = inertia},
                    .slope = slope};
    const auto scene = table(o);
    const double w = 2 * M_PI * 6.0;
    for (const auto& world : worlds(scene)) {
      const Eigen::Quaterniond turn(Eigen::AngleAxisd(slope, Eigen::Vector3d::UnitX()));
      world->spawn_rock({{0, 0, 2.25 + (0.25 + 0.1) / std::cos(slope)}, turn});
      for (int i = 0; i < 1000; ++i) world->step({});
      const double centre = pitch(*world);
      const Eigen::Vector3d arm = world->rock().p_WB - Eigen::Vector3d(0, 0, kAxis);
      const double m = scene->rock().mass;
      const double total =
          inertia + scene->rock_inertia().y() + m * (arm.x() * arm.x() + arm.z() * arm.z());
      const double own = std::sqrt((inertia * w * w - m * kG * arm.z()) / total);
      const double ratio = damping * w * inertia / (total * own);
      shake(*world, 1.0, 4.0);
      const Swing found = swing(*world, centre, 6);
      const double expected = own * std::sqrt(1 - ratio * ratio) / (2 * M_PI);
      EXPECT_LT(expected, 0.7 * 6.0);
      EXPECT_NEAR(found.frequency, expected, 2e-3 * expected) << slope;
      EXPECT_NEAR(found.damping, ratio, 1e-3) << slope;
    }
  }
}

/// Angular momentum of table and rock about the pitch axis [kg m^2/s].
double angular_momentum(const World& world, const Scene& scene) {
  const RockState rock = world.rock();
  const Eigen::Matrix3d R = rock.q_WB.toRotationMatrix();
  const Eigen::Vector3d spin = R * scene.rock_inertia().cwiseProduct(R.transpose() * rock.w_WB);
  const Eigen::Vector3d arm = rock.p_WB - pitch_axis(scene.pedestal(), world.pedestal());
  return scene.pedestal().pitch_spring->inertia * world.pedestal().excursion_rate.pitch +
         (arm.cross(scene.rock().mass * rock.v_WB) + spin).y();
}

// Without weight and spring a hit leaves it: what the rock loses the table gets.
TEST(PitchSpring, KeepsTheAngularMomentumOfAHit) {
  for (const bool set : {false, true}) {
    Options o{.spring = {.frequency = 1e-4, .damping = 0, .inertia = 80},
              .size = {0.4, 0.5, 0.9},
              .gravity = 0.0,
              .friction = 0.6};
    if (set) o.mechanisms.impact_energy_ratio = 0.9;
    const auto scene = table(o);
    const auto all = worlds(scene);
    for (std::size_t k = 0; k < all.size(); ++k) {
      World& world = *all[k];
      world.spawn_rock({{0.6, 0.0, 3.05},
                        Eigen::Quaterniond(Eigen::AngleAxisd(0.2, Eigen::Vector3d(0.1, 1, 0.2).normalized()))});
      world.set_rock_velocity({0.3, 0.1, -1.0}, {0.2, -0.4, 0.1});
      const double before = angular_momentum(world, *scene);
      for (int i = 0; i < 400; ++i) world.step({});
      const double of_table = 80 * world.pedestal().excursion_rate.pitch;
      EXPECT_GT(of_table, 0.05 * std::fabs(before)) << k;
      // The two points of a contact lie a penetration apart.
      EXPECT_NEAR(angular_momentum(world, *scene), before, 1e-4 * std::fabs(before)) << k;
    }
  }
}

// Contacts and joint are solved together, so a table 200 times lighter than the rock is as steady.
TEST(PitchSpring, CarriesARockMuchHeavierThanItself) {
  const double w = 2 * M_PI * 50;
  const PitchSpring spring{.frequency = 50, .damping = 0.5, .compliance = kPerG, .inertia = 0.4};
  const auto scene = table({.spring = spring});
  const double m = scene->rock().mass;
  const double total = 0.4 + scene->rock_inertia().y() + m * 0.6 * 0.6;
  const double own = std::sqrt((0.4 * w * w - m * kG * 0.6) / total);
  const double ratio = 0.5 * w * 0.4 / (total * own);
  for (const auto& world : worlds(scene)) {
    world->spawn_rock(standing(0.1));
    for (int i = 0; i < 1000; ++i) world->step({});
    // So gently that no corner lifts off, which damps besides: at ten times as much by up to a fifth.
    shake(*world, 0.1, 4.0);
    const Swing found = swing(*world, 0.0, 5);
    // Blows once a step see a spring stiffer by (w dt)^2 / 12, 0.8 %.
    EXPECT_NEAR(found.frequency, own / (2 * M_PI), 0.01 * own / (2 * M_PI));
    // The dashpot acts within steps: to the first order in dt, 1.2 % here and 0.3 % at half the step.
    EXPECT_NEAR(found.damping, ratio, 0.02 * ratio);
  }
}

TEST(PitchSpring, CarriesSuchARockWhereItsCornersLift) {
  const double w = 2 * M_PI * 50;
  const PitchSpring spring{.frequency = 50, .damping = 0.5, .compliance = kPerG, .inertia = 0.4};
  const auto level = table({.spring = spring});
  // Of so light a table 150 sweeps are short of the solution, in all engines.
  EngineSettings engine;
  engine.solver_iterations = 3000;
  const auto scene = std::make_shared<Scene>(engine, level->pedestal(), level->rock());
  const double total = 0.4 + scene->rock_inertia().y() + scene->rock().mass * 0.6 * 0.6;
  const double own = std::sqrt((0.4 * w * w - scene->rock().mass * kG * 0.6) / total);
  const double ratio = 0.5 * w * 0.4 / (total * own);
  for (const auto& world : worlds(scene)) {
    world->spawn_rock(standing(0.1));
    for (int i = 0; i < 1000; ++i) world->step({});
    shake(*world, 1.0, 4.0);
    const Swing found = swing(*world, 0.0, 5);
    EXPECT_NEAR(found.frequency, own / (2 * M_PI), 0.01 * own / (2 * M_PI));
    // Corners that lift damp besides the dashpot.
    EXPECT_NEAR(found.damping, ratio, 0.1 * ratio);
  }
}

TEST(PitchSpring, GivesTheSameBitsInExactAsInParity) {
  Mechanisms all;
  all.impact_energy_ratio = 0.9;
  all.rocking_damping = 0.02;
  all.friction_ratio = 1.2;
  for (const RockKind kind : {RockKind::box, RockKind::box_off_centre, RockKind::hull_off_centre}) {
    for (const int substeps : {1, 2}) {
      for (const Mechanisms& mechanisms : {Mechanisms{}, all}) {
        PedestalSpec pedestal = test::pedestal();
        pedestal.pitch_spring = PitchSpring{6.0, 0.05, kPerG, 300};
        const auto scene = std::make_shared<Scene>(EngineSettings{.substeps = substeps}, pedestal,
                                                   test::rock(kind), mechanisms);
        const auto parity = make_bullet_world(scene, kSpatial);
        const auto exact = make_exact_world(scene, kSpatial);
        parity->spawn_rock(test::start(kind));
        exact->spawn_rock(test::start(kind));
        const test::Pulse pulse;
        for (int i = 1; i <= 800; ++i) {
          const DriveTarget target{pulse.at(i).position, 0, {0.2 * pulse.at(i).position, 0, 0}};
          parity->step(target);
          exact->step(target);
          ASSERT_TRUE(test::same_bits(parity->rock(), exact->rock())) << test::name(kind) << i;
          ASSERT_TRUE(test::same_bits(parity->pedestal(), exact->pedestal())) << i;
        }
      }
    }
  }
}

TEST(PitchSpring, FastFollowsParity) {
  for (const RockKind kind : {RockKind::box, RockKind::hull}) {
    for (const double slope : {0.0, 0.03}) {
      PedestalSpec pedestal = test::pedestal();
      std::get<BoxPart>(pedestal.parts[0]).pose.orientation =
          Eigen::Quaterniond(Eigen::AngleAxisd(slope, Eigen::Vector3d::UnitX()));
      pedestal.pitch_spring = PitchSpring{6.0, 0.05, kPerG, 60};
      pedestal.pitch_pivot = 1.8;
      const auto scene = std::make_shared<Scene>(EngineSettings{}, pedestal, test::rock(kind));
      const auto parity = make_bullet_world(scene, kSpatial);
      const auto fast = make_fast_world(scene, kSpatial);
      parity->spawn_rock(test::start(kind));
      fast->spawn_rock(test::start(kind));
      double apart = 0.0;
      double turned = 0.0;
      double greatest = 0.0;
      const test::Pulse pulse;
      for (int i = 1; i <= 700; ++i) {
        parity->step(pulse.at(i));
        fast->step(pulse.at(i));
        apart = std::max(apart, (parity->rock().p_WB - fast->rock().p_WB).norm());
        turned = std::max(turned, std::fabs(pitch(*parity) - pitch(*fast)));
        greatest = std::max(greatest, std::fabs(pitch(*parity)));
      }
      EXPECT_EQ(fast->handover(), Handover::none);
      EXPECT_GT(greatest, 1e-3);
      EXPECT_LT(apart, 2e-5) << test::name(kind) << slope;
      EXPECT_LT(turned, 2e-6) << test::name(kind) << slope;
    }
  }
}

// A rock that leaves the top is Bullet's from there on, and so is the joint.
TEST(PitchSpring, GoesOnAcrossAHandover) {
  PedestalSpec pedestal = test::pedestal({0.9, 0.9, 0.5});
  pedestal.pitch_spring = PitchSpring{6.0, 0.02, kPerG, 300};
  const auto scene = std::make_shared<Scene>(EngineSettings{}, pedestal, test::rock(RockKind::box));
  const auto exact = make_exact_world(scene, kSpatial);
  const auto fast = make_fast_world(scene, kSpatial);
  exact->spawn_rock(test::start(RockKind::box));
  fast->spawn_rock(test::start(RockKind::box));
  int i = 0;
  for (; i < 3000 && fast->handover() == Handover::none; ++i) {
    const DriveTarget target{i < 300 ? 0.0 : 1.5e-3 * (i - 300) * (i < 900 ? 1.0 : 0.0)};
    exact->step(target);
    fast->step(target);
  }
  ASSERT_EQ(fast->handover(), Handover::off_the_top);
  EXPECT_NEAR(pitch(*fast), pitch(*exact), 1e-6);
  const DriveTarget there{fast->pedestal().position};
  for (int k = 0; k < 30; ++k) {
    exact->step(there);
    fast->step(there);
    ASSERT_NEAR(pitch(*fast), pitch(*exact), 1e-5) << k;
  }
}

TEST(PitchSpring, StartsATrialAtRest) {
  const auto scene = table({.spring = {.frequency = 6.0, .damping = 0.1, .compliance = kPerG, .inertia = 100}});
  const std::atomic<bool> run_on{false};
  TrialSpec spec = testing::trial_of(scene, {{0.3, 0, 2.602}, Eigen::Quaterniond::Identity()},
                                     std::vector<double>(500, 0.0), kSpatial);
  spec.log_every = 1;
  spec.tail = 0.5;
  const TrialResult result = run_trial(spec, run_on);
  ASSERT_EQ(result.outcome, Outcome::stable) << result.message;
  const double w = 2 * M_PI * 6.0;
  const double expected =
      scene->rock().mass * kG * result.X_WB_settled.position.x() / (100 * w * w);
  const std::size_t rows = result.excursions.size() / kExcursionColumns;
  ASSERT_EQ(rows, result.log.size() / kLogColumns);
  for (std::size_t row = 0; row < rows; ++row) {
    const double now = result.excursions[(row + 1) * kExcursionColumns - 1];
    // At the rest speed of 2 mrad/s it may swing by that over w.
    ASSERT_NEAR(now, expected, 2e-3 / w) << row;
  }
}

TEST(PitchSpring, RefusesWhatItCannotDo) {
  const auto message = [](auto&& act) -> std::string {
    try {
      act();
    } catch (const InvalidInput& error) {
      return error.what();
    }
    return {};
  };
  const auto with = [&](const PitchSpring& spring) {
    return message([&] { table({.spring = spring}); });
  };
  EXPECT_NE(with({.frequency = 250.0}).find("frequency"), std::string::npos);
  EXPECT_NE(with({.frequency = -1.0}).find("frequency"), std::string::npos);
  EXPECT_NE(with({.damping = -0.1}).find("damping"), std::string::npos);
  EXPECT_NE(with({.compliance = std::nan("")}).find("compliance"), std::string::npos);
  EXPECT_NE(with({.inertia = 0.0}).find("inertia"), std::string::npos);

  const auto scene = table({.spring = {.inertia = 500}});
  for (const auto make : {&make_bullet_world, &make_exact_world})
    EXPECT_NE(message([&] { make(scene, Drive::prescribed); }).find("prescribed_spatial"),
              std::string::npos);
  EXPECT_NE(message([&] { make_fast_world(scene, Drive::motor_position); }).find("prescribed_spatial"),
            std::string::npos);
  // 194 kg, 0.6 m over the axis: m g h = 1144 N m.
  const double w = 2 * M_PI * 10.0;
  for (const double stiffness : {1100.0, 1200.0}) {
    for (const auto& world : worlds(table({.spring = {.inertia = stiffness / (w * w)}}))) {
      const std::string refusal = message([&] { world->spawn_rock(standing(0.1)); });
      EXPECT_EQ(refusal.find("does not carry the rock") != std::string::npos, stiffness < 1144);
      EXPECT_EQ(world->has_rock(), stiffness > 1144);
    }
  }
  for (const auto& world : worlds(scene)) {
    EXPECT_NE(message([&] { world->step({0, 0, {0, 0, 0.01}}); }).find("pitch"), std::string::npos);
  }
  const std::atomic<bool> run_on{false};
  TrialSpec spec = testing::trial_of(scene, standing(0.1), {0.0, 0.0}, kSpatial);
  spec.pitch = std::make_shared<const std::vector<double>>(2, 0.0);
  EXPECT_NE(run_trial(spec, run_on).message.find("pitches on a spring"), std::string::npos);
}

TEST(PitchSpring, StepsWithoutAllocating) {
  test::count_bullet_allocations();
  for (const RockKind kind : {RockKind::box, RockKind::hull}) {
    PedestalSpec pedestal = test::pedestal();
    pedestal.pitch_spring = PitchSpring{6.0, 0.05, kPerG, 300};
    const auto scene = std::make_shared<Scene>(EngineSettings{}, pedestal, test::rock(kind));
    const auto all = worlds(scene);
    const test::Pulse pulse;
    for (std::size_t k = 1; k < all.size(); ++k) {
      all[k]->spawn_rock(test::start(kind));
      for (int i = 1; i < 300; ++i) all[k]->step(pulse.at(i));
      const long before = test::allocation_count();
      for (int i = 300; i < 1000; ++i) all[k]->step(pulse.at(i));
      EXPECT_EQ(test::allocation_count() - before, 0) << k;
    }
  }
}

TEST(PitchSpring, LogsATrialWithoutAllocating) {
  test::count_bullet_allocations();
  const std::atomic<bool> run_on{false};
  const auto scene = table({.spring = {.frequency = 6.0, .compliance = kPerG, .inertia = 300}});
  long allocations[2];
  for (const bool longer : {false, true}) {
    TrialSpec spec = testing::trial_of(scene, standing(0.101),
                                       std::vector<double>(longer ? 4000 : 1000, 0.0), kSpatial);
    spec.stop_early = false;
    spec.tail = 0.5;
    spec.log_every = 1;
    const long before = test::allocation_count();
    const TrialResult result = run_trial(spec, run_on);
    allocations[longer] = test::allocation_count() - before;
    EXPECT_EQ(result.excursions.size(), kExcursionColumns * (longer ? 4500U : 1500U));
  }
  EXPECT_EQ(allocations[0], allocations[1]);
}

}  // namespace
}  // namespace vsr2
