// The exact engine's claim is equality of bits with the parity engine, so no tolerance occurs here.

#include <limits>
#include <tuple>

#include "engine_scenes.hpp"
#include "hull_scan.hpp"
#include "scene_shapes.hpp"
#include "vsr2/engines.hpp"

namespace vsr2 {
namespace {

using test::RockKind;
using test::scene;

// Steps both worlds and demands equal bits of all that a world shows. Returns the number of steps
// in which the rock had contacts.
template <typename Targets>
int expect_equal_bits(World& parity, World& exact, int steps, Targets target) {
  std::vector<ContactPoint> a;
  std::vector<ContactPoint> b;
  int touching = 0;
  for (int i = 0; i < steps; ++i) {
    parity.step(target(i));
    exact.step(target(i));
    parity.contacts(a);
    exact.contacts(b);
    touching += a.empty() ? 0 : 1;
    bool same = test::same_bits(parity.rock(), exact.rock()) &&
                test::same_bits(parity.pedestal(), exact.pedestal()) && a.size() == b.size();
    for (std::size_t k = 0; same && k < a.size(); ++k) same = test::same_bits(a[k], b[k]);
    EXPECT_TRUE(same) << "first differing step: " << i;
    if (!same) break;
  }
  return touching;
}

class ExactWorldBits : public ::testing::TestWithParam<std::tuple<RockKind, Drive>> {};

TEST_P(ExactWorldBits, EqualParityThroughAPulseThatOverturns) {
  const auto [kind, drive] = GetParam();
  const auto common = scene(kind);
  const auto parity = make_bullet_world(common, drive);
  const auto exact = make_exact_world(common, drive);
  parity->spawn_rock(test::start(kind));
  exact->spawn_rock(test::start(kind));
  const test::Pulse pulse{0.25, 1.5};
  EXPECT_GT(expect_equal_bits(*parity, *exact, 2500, [&](int i) { return pulse.at(i); }), 1000);
}

TEST_P(ExactWorldBits, EqualParityWhileTumbling) {
  const auto [kind, drive] = GetParam();
  const auto common = scene(kind);
  const auto parity = make_bullet_world(common, drive);
  const auto exact = make_exact_world(common, drive);
  for (World* world : {parity.get(), exact.get()}) {
    Pose high = test::start(kind);
    high.position.z() += 0.2;
    world->spawn_rock(high);
    world->set_rock_velocity({0.8, -0.3, 0.1}, {3.0, 5.0, -2.0});
  }
  expect_equal_bits(*parity, *exact, 2000, [](int) { return DriveTarget{}; });
}

INSTANTIATE_TEST_SUITE_P(
    All, ExactWorldBits,
    ::testing::Combine(::testing::Values(RockKind::box, RockKind::box_off_centre, RockKind::hull,
                                         RockKind::hull_off_centre),
                       ::testing::Values(Drive::prescribed, Drive::motor_position,
                                         Drive::motor_position_velocity)),
    [](const auto& parameters) {
      return std::string(test::name(std::get<0>(parameters.param))) +
             test::name(std::get<1>(parameters.param));
    });

// The rock slides off a small pedestal onto the base and from there to the ground: contacts with
// bodies that have no degree of freedom, and several manifolds at once.
TEST(ExactWorld, EqualsParityOffThePedestal) {
  PedestalSpec small = test::pedestal({1.2, 1.2, 0.5});
  small.base_size = {3, 3, 2};
  for (const RockKind kind : {RockKind::box, RockKind::hull, RockKind::hull_off_centre}) {
    const auto common = scene(kind, {}, small);
    const auto parity = make_bullet_world(common, Drive::motor_position);
    const auto exact = make_exact_world(common, Drive::motor_position);
    for (World* world : {parity.get(), exact.get()}) {
      world->spawn_rock(test::start(kind));
      world->set_rock_velocity({4.0, 0.5, 0}, {0, 1, 0});
    }
    expect_equal_bits(*parity, *exact, 3000, [](int) { return DriveTarget{}; });
    EXPECT_LT(exact->rock().p_WB.z(), 1.0) << "the rock was to reach the ground";
  }
}

// What the flattened solver does not take goes to Bullet's; a threshold ends iterations early.
TEST(ExactWorld, EqualsParityForOtherSettings) {
  std::vector<EngineSettings> settings(5);
  settings[0].cone_friction = false;
  settings[1].residual_threshold = 1e-10;
  settings[2].solver_iterations = 1;
  settings[3].solver_iterations = 1000;
  settings[4].substeps = 3;
  for (std::size_t k = 0; k < settings.size(); ++k) {
    for (const RockKind kind : {RockKind::box, RockKind::hull}) {
      SCOPED_TRACE(k);
      const auto common = scene(kind, settings[k]);
      const auto parity = make_bullet_world(common, Drive::motor_position);
      const auto exact = make_exact_world(common, Drive::motor_position);
      parity->spawn_rock(test::start(kind));
      exact->spawn_rock(test::start(kind));
      const test::Pulse pulse{0.25, 1.5};
      expect_equal_bits(*parity, *exact, 800, [&](int i) { return pulse.at(i); });
    }
  }
}

TEST(ExactWorld, EqualsParityWithRollingFriction) {
  RockSpec rock = test::rock(RockKind::hull);
  rock.material["rolling_friction"] = 0.1;
  PedestalSpec pedestal = test::pedestal();
  pedestal.material["rolling_friction"] = 0.1;
  const auto common = std::make_shared<Scene>(EngineSettings{}, pedestal, rock);
  const auto parity = make_bullet_world(common, Drive::prescribed);
  const auto exact = make_exact_world(common, Drive::prescribed);
  parity->spawn_rock(test::start(RockKind::hull));
  exact->spawn_rock(test::start(RockKind::hull));
  const test::Pulse pulse{0.25, 1.5};
  expect_equal_bits(*parity, *exact, 1500, [&](int i) { return pulse.at(i); });
}

TEST(ExactWorld, EqualsParityOnATriangleSurface) {
  PedestalSpec surface = test::pedestal();
  TrianglesPart triangles;
  // A shallow bowl of four triangles.
  triangles.vertices = {{-5, -5, 0.3}, {5, -5, 0.3}, {5, 5, 0.3}, {-5, 5, 0.3}, {0, 0, 0.2}};
  triangles.faces = {{0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4}};
  surface.parts = {triangles};
  for (const RockKind kind : {RockKind::box, RockKind::hull, RockKind::hull_off_centre}) {
    const auto common = scene(kind, {}, surface);
    const auto parity = make_bullet_world(common, Drive::prescribed);
    const auto exact = make_exact_world(common, Drive::prescribed);
    parity->spawn_rock(test::start(kind));
    exact->spawn_rock(test::start(kind));
    const test::Pulse pulse{0.25, 1.5};
    EXPECT_GT(expect_equal_bits(*parity, *exact, 1200, [&](int i) { return pulse.at(i); }), 300);
  }
}

TEST(ExactWorld, EqualsItselfWithoutVectorInstructions) {
  if (instruction_set() != InstructionSet::avx2) GTEST_SKIP() << "this processor has no AVX2";
  const auto common = scene(RockKind::hull);
  std::vector<RockState> states[2];
  for (const bool portable : {false, true}) {
    set_instruction_set(portable ? InstructionSet::portable : InstructionSet::automatic);
    const auto world = make_exact_world(common, Drive::prescribed);
    world->spawn_rock(test::start(RockKind::hull));
    const test::Pulse pulse{0.25, 1.5};
    for (int i = 0; i < 1000; ++i) {
      world->step(pulse.at(i));
      states[portable].push_back(world->rock());
    }
  }
  set_instruction_set(InstructionSet::automatic);
  for (std::size_t i = 0; i < states[0].size(); ++i)
    ASSERT_TRUE(test::same_bits(states[0][i], states[1][i])) << "step " << i;
}

// The index of the support point is that of Bullet's own scan, ties included.
TEST(HullScan, FindsTheFirstGreatestProduct) {
  std::mt19937 generator(7);
  std::uniform_int_distribution<int> coarse(-2, 2);  // many ties
  for (const auto set : {InstructionSet::portable, InstructionSet::avx2}) {
    set_instruction_set(set);
    for (std::size_t count = 1; count < 140; ++count) {
      std::vector<btVector3> points;
      for (std::size_t i = 0; i < count; ++i)
        points.emplace_back(coarse(generator), coarse(generator), coarse(generator));
      const PointColumns columns(points.data(), count);
      for (int trial = 0; trial < 20; ++trial) {
        const btVector3 direction(coarse(generator), coarse(generator), coarse(generator));
        btScalar product = 0;
        const long expected = direction.maxDot(points.data(), static_cast<long>(count), product);
        ASSERT_EQ(first_support(columns.view(), to_eigen(direction)),
                  static_cast<std::size_t>(expected));
      }
      // A direction that is not a number must not lead outside the points.
      ASSERT_LT(first_support(columns.view(), {std::numeric_limits<double>::quiet_NaN(), 1, 0}), count);
    }
  }
  set_instruction_set(InstructionSet::automatic);
}

}  // namespace
}  // namespace vsr2
