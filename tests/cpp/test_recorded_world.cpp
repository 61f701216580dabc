// A world saved and restored goes on with the bits of one that was not interrupted.

#include <gtest/gtest.h>

#include "engine_scenes.hpp"
#include "vsr2/engines.hpp"
#include "vsr2/recorded_world.hpp"
#include "vsr2/trial.hpp"

namespace vsr2 {
namespace {

using test::RockKind;

std::shared_ptr<const Scene> scene(EngineKind kind, bool sprung, bool mechanisms, double amplitude_top = 10) {
  EngineSettings engine;
  engine.kind = kind;
  engine.substeps = sprung ? 2 : 1;
  PedestalSpec pedestal = test::pedestal({amplitude_top, 10, 0.5});
  if (sprung) pedestal.pitch_spring = PitchSpring{8.0, 0.05, 1e-4, 5e3};
  Mechanisms on;
  if (mechanisms) {
    on.impact_energy_ratio = 0.8;
    on.rocking_damping = 0.02;
    on.rolling_resistance = 0.002;
    on.friction_ratio = 1.4;
    on.adhesion = 1000;
    on.catch_slack = 0.2;
  }
  return std::make_shared<Scene>(engine, pedestal, test::rock(RockKind::hull_flat), on);
}

void expect_same(const World& a, const World& b) {
  ASSERT_TRUE(test::same_bits(a.rock(), b.rock()));
  ASSERT_TRUE(test::same_bits(a.pedestal(), b.pedestal()));
  std::vector<ContactPoint> left;
  std::vector<ContactPoint> right;
  a.contacts(left);
  b.contacts(right);
  ASSERT_EQ(left.size(), right.size());
  for (std::size_t i = 0; i < left.size(); ++i) ASSERT_TRUE(test::same_bits(left[i], right[i]));
}

TEST(RecordedWorld, GoesOnWithTheSameBits) {
  const Pose start = test::start(RockKind::hull_flat);
  const test::Pulse pulse{0.15, 1.1};
  for (const EngineKind kind : {EngineKind::parity, EngineKind::exact, EngineKind::fast})
    for (const bool sprung : {false, true})
      for (const bool mechanisms : {false, true}) {
        SCOPED_TRACE(testing::Message() << static_cast<int>(kind) << sprung << mechanisms);
        const auto common = scene(kind, sprung, mechanisms);
        const Drive drive = sprung ? Drive::prescribed_spatial : Drive::motor_position_velocity;
        const auto plain = make_world(common, drive);
        plain->spawn_rock(start);
        RecordedWorld world(common, drive);
        world.spawn_rock(start);
        // Into the rocking, with contacts that came and went.
        for (int i = 0; i < 700; ++i) {
          plain->step(pulse.at(i));
          world.step(pulse.at(i));
        }
        world.set_rock_velocity({0.1, 0, 0}, {0, 0.3, 0});
        plain->set_rock_velocity({0.1, 0, 0}, {0, 0.3, 0});
        const WorldState state = world.save_state();
        RecordedWorld other(common, drive);
        other.restore_state(state);
        expect_same(*plain, other);
        for (int i = 700; i < 900; ++i) {
          plain->step(pulse.at(i));
          world.step({0.0, 0.0, {}});  // a branch, left again
          other.step(pulse.at(i));
          expect_same(*plain, other);
        }
        ASSERT_FALSE(test::same_bits(plain->rock(), world.rock()));
        world.restore_state(state);
        for (int i = 700; i < 900; ++i) world.step(pulse.at(i));
        expect_same(*plain, world);
      }
}

TEST(RecordedWorld, ComesBackAcrossAHandOver) {
  const auto common = scene(EngineKind::fast, false, false, 1.2);
  RecordedWorld world(common, Drive::prescribed);
  world.spawn_rock(test::start(RockKind::hull_flat));
  const WorldState before = world.save_state();
  const auto accelerate = [&world](int steps) {
    for (int i = 1; i <= steps; ++i) world.step({-4.5 * 1e-6 * i * i, 0.0, {}});
  };
  accelerate(900);
  ASSERT_EQ(world.handover(), Handover::off_the_top);
  const RockState end = world.rock();
  const WorldState after = world.save_state();
  world.restore_state(before);
  EXPECT_EQ(world.handover(), Handover::none);
  accelerate(900);
  EXPECT_TRUE(test::same_bits(world.rock(), end));
  world.restore_state(after);
  EXPECT_EQ(world.handover(), Handover::off_the_top);
  EXPECT_TRUE(test::same_bits(world.rock(), end));
}

TEST(RecordedWorld, KeepsOneEntryForStepsToTheSameSetPoint) {
  RecordedWorld world(scene(EngineKind::fast, false, false), Drive::prescribed);
  world.spawn_rock(test::start(RockKind::hull_flat));
  for (int i = 0; i < 500; ++i) world.step({});
  EXPECT_EQ(world.save_state().actions.size(), 2U);
}

TEST(RecordedWorld, SettlesByTheTrialsCriterion) {
  const auto common = scene(EngineKind::fast, false, false);
  const RestCriterion rest;
  RecordedWorld world(common, Drive::prescribed);
  EXPECT_THROW(world.settle(rest, 5.0), InvalidInput);
  world.spawn_rock(test::start(RockKind::hull_flat));
  const auto [steps, rests] = world.settle(rest, 20.0);
  EXPECT_TRUE(rests);
  SettledStart start(common, Drive::prescribed, test::start(RockKind::hull_flat), rest, 20.0, 0);
  const std::atomic<bool> run_on{false};
  EXPECT_EQ(start.settle(run_on).settling_time, static_cast<double>(steps) * 1e-3);
  EXPECT_TRUE(test::same_bits(start.settle(run_on).X_WB_settled.position, world.rock().p_WB));
  EXPECT_EQ(world.settle(rest, 0.01), std::make_pair(std::int64_t{10}, false));
}

TEST(RecordedWorld, RefusesAStateOfAnotherDrive) {
  const auto common = scene(EngineKind::fast, false, false);
  RecordedWorld world(common, Drive::prescribed);
  world.spawn_rock(test::start(RockKind::hull_flat));
  const RockState before = world.rock();
  EXPECT_THROW(world.restore_state(RecordedWorld(common, Drive::motor_position).save_state()), InvalidInput);
  WorldState broken = world.save_state();
  broken.actions.push_back(broken.actions.front());
  EXPECT_THROW(world.restore_state(broken), InvalidInput);
  WorldState empty_step = world.save_state();
  empty_step.actions.push_back({WorldState::step, 0, {}});
  EXPECT_THROW(world.restore_state(empty_step), InvalidInput);
  WorldState longest = world.save_state();
  longest.actions.push_back({WorldState::step, WorldState::kMaxSteps, {}});
  EXPECT_NO_THROW(longest.check());
  longest.actions.push_back({WorldState::step, 1, {}});
  EXPECT_THROW(world.restore_state(longest), InvalidInput);
  EXPECT_TRUE(test::same_bits(world.rock(), before));
}

}  // namespace
}  // namespace vsr2
