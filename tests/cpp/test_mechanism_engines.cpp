// Mechanisms in every engine: the same response, and nothing left of one rock in the next.

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "allocation_count.hpp"
#include "engine_scenes.hpp"

namespace vsr2 {
namespace {

using test::Engine;
using test::kEngines;
using test::make;
using test::RockKind;

Mechanisms everything() {
  Mechanisms m;
  m.impact_energy_ratio = 0.8;
  m.rocking_damping = 0.02;
  m.rolling_resistance = 0.003;
  m.friction_ratio = 1.3;
  m.adhesion = 2e3;
  m.catch_slack = 0.3;
  return m;
}

std::shared_ptr<const Scene> scene_of(RockKind kind, const Mechanisms& mechanisms, int substeps = 1,
                                      const PedestalSpec& pedestal = test::pedestal()) {
  return std::make_shared<Scene>(EngineSettings{.substeps = substeps}, pedestal, test::rock(kind), mechanisms);
}

std::vector<Mechanisms> each() {
  const Mechanisms all = everything();
  std::vector<Mechanisms> out(6);
  out[0].impact_energy_ratio = all.impact_energy_ratio;
  out[1].rocking_damping = all.rocking_damping;
  out[2].rolling_resistance = all.rolling_resistance;
  out[3].friction_ratio = all.friction_ratio;
  out[4].adhesion = all.adhesion;
  out[5].catch_slack = 0.05;
  return out;
}

std::vector<RockState> response(World& world, RockKind kind, int steps = 2500) {
  world.spawn_rock(test::start(kind));
  std::vector<RockState> out;
  const test::Pulse pulse{0.25, 1.5};
  for (int i = 0; i < steps; ++i) {
    world.step(pulse.at(i));
    out.push_back(world.rock());
  }
  return out;
}

bool same(const std::vector<RockState>& a, const std::vector<RockState>& b) {
  for (std::size_t i = 0; i < a.size(); ++i)
    if (!test::same_bits(a[i], b[i])) return false;
  return a.size() == b.size();
}

// A tether that never comes taut, a bond too weak to count and friction of one value: the paths of
// the mechanisms are walked, and no bit changes.
TEST(Mechanisms, ChangeNoBitWhereTheyDoNotAct) {
  Mechanisms idle;
  idle.catch_slack = 3.0;
  Mechanisms values;
  values.friction_speed = 0.5;
  for (const Engine engine : kEngines) {
    for (const RockKind kind : {RockKind::box, RockKind::hull_off_centre}) {
      const auto plain = response(*make(engine, scene_of(kind, {})), kind, 1200);
      EXPECT_TRUE(same(plain, response(*make(engine, scene_of(kind, idle)), kind, 1200)));
      EXPECT_TRUE(same(plain, response(*make(engine, scene_of(kind, values)), kind, 1200)));
    }
  }
}

TEST(Mechanisms, EachChangesTheResponse) {
  for (const Engine engine : {Engine::exact, Engine::fast}) {
    for (const RockKind kind : {RockKind::box, RockKind::hull}) {
      const auto plain = response(*make(engine, scene_of(kind, {})), kind);
      for (const Mechanisms& one : each()) {
        // An ellipsoid has no footprint.
        if (kind == RockKind::hull && one.adhesion > 0) continue;
        const auto changed = response(*make(engine, scene_of(kind, one)), kind);
        double apart = 0.0;
        for (std::size_t i = 0; i < plain.size(); ++i)
          apart = std::max(apart, (plain[i].p_WB - changed[i].p_WB).norm());
        EXPECT_GT(apart, 1e-3) << static_cast<int>(engine) << test::name(kind);
      }
    }
  }
}

TEST(Mechanisms, GiveTheSameBitsInExactAsInParity) {
  std::vector<Mechanisms> sets = each();
  sets.push_back(everything());
  for (const Mechanisms& mechanisms : sets) {
    for (const RockKind kind : {RockKind::box, RockKind::hull_off_centre}) {
      const auto scene = scene_of(kind, mechanisms);
      EXPECT_TRUE(same(response(*make_bullet_world(scene, Drive::motor_position), kind, 1500),
                       response(*make_exact_world(scene, Drive::motor_position), kind, 1500)))
          << test::name(kind);
    }
  }
  const auto scene = scene_of(RockKind::hull, everything(), 3);
  EXPECT_TRUE(same(response(*make_bullet_world(scene, Drive::prescribed), RockKind::hull, 800),
                   response(*make_exact_world(scene, Drive::prescribed), RockKind::hull, 800)));
}

// Over the edge of a small pedestal: bond, tether and open impact go on in Bullet.
TEST(Mechanisms, ChangeEnginesWithTheRock) {
  Mechanisms m = everything();
  m.catch_slack = NAN;
  const auto scene = scene_of(RockKind::hull, m, 1, test::pedestal({2.5, 2.5, 0.5}));
  const auto parity = make_bullet_world(scene, Drive::prescribed);
  const auto fast = make_fast_world(scene, Drive::prescribed);
  for (World* world : {parity.get(), static_cast<World*>(fast.get())}) {
    world->spawn_rock(test::start(RockKind::hull));
    world->set_rock_velocity({5.0, 0.4, 0}, {0, 0, 0});
  }
  for (int i = 0; i < 600 && fast->handover() == Handover::none; ++i) {
    parity->step({});
    fast->step({});
    ASSERT_LT((parity->rock().p_WB - fast->rock().p_WB).norm(), 1e-7) << i;
    if (fast->handover() != Handover::none) {
      EXPECT_GT(i, 50) << "it was to come in motion";
    }
  }
  EXPECT_EQ(fast->handover(), Handover::off_the_top);
  for (int i = 0; i < 20; ++i) {
    parity->step({});
    fast->step({});
    ASSERT_LT((parity->rock().p_WB - fast->rock().p_WB).norm(), 1e-7) << i;
  }
}

TEST(Mechanisms, StartAfreshWithEachRock) {
  for (const Engine engine : kEngines) {
    const auto scene = scene_of(RockKind::box, everything());
    const auto fresh = make(engine, scene);
    const auto used = make(engine, scene);
    response(*used, RockKind::box, 700);
    used->delete_rock();
    for (int i = 0; i < 50; ++i) used->step({});
    used->spawn_rock(test::start(RockKind::box));
    fresh->spawn_rock(test::start(RockKind::box));
    for (int i = 0; i < 600; ++i) {
      used->step({});
      fresh->step({});
    }
    EXPECT_LT((used->rock().p_WB - fresh->rock().p_WB).norm(), 1e-9);
  }
}

TEST(Mechanisms, StepWithoutAllocating) {
  test::count_bullet_allocations();
  for (const RockKind kind : {RockKind::box, RockKind::hull}) {
    for (const Engine engine : {Engine::exact, Engine::fast}) {
      for (const int substeps : {1, 2}) {
        const auto world = make(engine, scene_of(kind, everything(), substeps));
        world->spawn_rock(test::start(kind));
        const test::Pulse pulse{0.2, 1.5};
        for (int i = 0; i < 50; ++i) world->step(pulse.at(i));
        const long before = test::allocation_count();
        for (int i = 50; i < 1500; ++i) world->step(pulse.at(i));
        EXPECT_EQ(test::allocation_count() - before, 0) << test::name(kind) << substeps;
      }
    }
  }
}

}  // namespace
}  // namespace vsr2
