#include <array>
#include <limits>
#include <thread>
#include <tuple>

#include "allocation_count.hpp"
#include "engine_scenes.hpp"
#include "fast_stepper.hpp"
#include "vsr2/engines.hpp"

namespace vsr2 {
namespace {

using test::angle_between;
using test::RockKind;
using test::scene;
using test::swept;

class FastWorldAgreement : public ::testing::TestWithParam<std::tuple<RockKind, Drive>> {};

// Both compute the same model in doubles; what differs is rounding, and Bullet's normals, which
// lean by some 1e-13. 1e-10 m over 1000 steps leaves room for its growth while the rock rocks.
TEST_P(FastWorldAgreement, FollowsParityStepForStep) {
  const auto [kind, drive] = GetParam();
  const auto common = scene(kind, swept());
  const auto parity = make_bullet_world(common, drive);
  const auto fast = make_fast_world(common, drive);
  parity->spawn_rock(test::start(kind));
  fast->spawn_rock(test::start(kind));
  const test::Pulse pulse;
  std::vector<ContactPoint> a;
  std::vector<ContactPoint> b;
  for (int i = 0; i < 1000; ++i) {
    parity->step(pulse.at(i));
    fast->step(pulse.at(i));
    ASSERT_LT((parity->rock().p_WB - fast->rock().p_WB).norm(), 1e-10) << "step " << i;
    ASSERT_LT((parity->rock().q_WB.coeffs() - fast->rock().q_WB.coeffs()).norm(), 1e-10)
        << "step " << i;
    ASSERT_NEAR(parity->pedestal().position, fast->pedestal().position, 1e-12);
    ASSERT_NEAR(parity->pedestal().velocity, fast->pedestal().velocity, 1e-10);
    parity->contacts(a);
    fast->contacts(b);
    ASSERT_EQ(a.size(), b.size()) << "step " << i;
    for (std::size_t k = 0; k < a.size(); ++k) {
      ASSERT_LT((a[k].p_W_rock - b[k].p_W_rock).norm(), 1e-9) << "step " << i;
      ASSERT_LT((a[k].p_W_pedestal - b[k].p_W_pedestal).norm(), 1e-9);
      ASSERT_LT((a[k].normal_W - b[k].normal_W).norm(), 1e-9);
      ASSERT_NEAR(a[k].distance, b[k].distance, 1e-10);
      // 353.8 kg at 1e-6 m/s.
      ASSERT_NEAR(a[k].normal_impulse, b[k].normal_impulse, 4e-4) << "step " << i;
      ASSERT_LT(
          (a[k].lateral_impulse_1 * a[k].direction_1 - b[k].lateral_impulse_1 * b[k].direction_1)
              .norm(),
          4e-4);
      ASSERT_LT(
          (a[k].lateral_impulse_2 * a[k].direction_2 - b[k].lateral_impulse_2 * b[k].direction_2)
              .norm(),
          4e-4);
      for (std::size_t j = 0; j < kContactParameters.size(); ++j)
        ASSERT_DOUBLE_EQ(a[k].pair.all[j], b[k].pair.all[j]) << kContactParameters[j].name;
    }
  }
  EXPECT_EQ(fast->handover(), Handover::none);
}

// Spinning, bouncing and sliding on impact.
TEST_P(FastWorldAgreement, FollowsParityThroughAnImpact) {
  const auto [kind, drive] = GetParam();
  const auto common = scene(kind);
  const auto parity = make_bullet_world(common, drive);
  const auto fast = make_fast_world(common, drive);
  for (World* world : {parity.get(), static_cast<World*>(fast.get())}) {
    Pose high = test::start(kind);
    high.position.z() += 0.05;
    world->spawn_rock(high);
    world->set_rock_velocity({0.4, -0.3, 0.0}, {0.3, 0.2, 1.0});
  }
  for (int i = 0; i < 250; ++i) {
    parity->step({});
    fast->step({});
    ASSERT_LT((parity->rock().p_WB - fast->rock().p_WB).norm(), 1e-9) << "step " << i;
  }
}

INSTANTIATE_TEST_SUITE_P(
    All, FastWorldAgreement,
    ::testing::Combine(::testing::Values(RockKind::box, RockKind::box_off_centre, RockKind::hull,
                                         RockKind::hull_off_centre, RockKind::hull_flat),
                       ::testing::Values(Drive::prescribed, Drive::motor_position,
                                         Drive::motor_position_velocity)),
    [](const auto& parameters) {
      return std::string(test::name(std::get<0>(parameters.param))) +
             test::name(std::get<1>(parameters.param));
    });

TEST(FastWorld, FollowsParityWithSubsteps) {
  EngineSettings engine;
  engine.substeps = 3;
  for (const Drive drive : {Drive::prescribed, Drive::motor_position_velocity}) {
    const auto common = scene(RockKind::hull, engine);
    const auto parity = make_bullet_world(common, drive);
    const auto fast = make_fast_world(common, drive);
    parity->spawn_rock(test::start(RockKind::hull));
    fast->spawn_rock(test::start(RockKind::hull));
    const test::Pulse pulse;
    for (int i = 0; i < 600; ++i) {
      parity->step(pulse.at(i));
      fast->step(pulse.at(i));
      ASSERT_LT((parity->rock().p_WB - fast->rock().p_WB).norm(), 1e-10) << "step " << i;
    }
  }
}

// The rock slides over the edge of a small pedestal. The world that takes over starts from the same
// state and contacts: the motion goes on as parity's, and no step jumps.
TEST(FastWorld, HandsOverAtTheEdgeWithoutAJump) {
  for (const RockKind kind :
       {RockKind::box, RockKind::hull, RockKind::hull_off_centre, RockKind::box_off_centre}) {
    for (const Drive drive : {Drive::prescribed, Drive::motor_position}) {
      SCOPED_TRACE(test::name(kind));
      const auto common = scene(kind, {}, test::pedestal({2.5, 2.5, 0.5}));
      const auto parity = make_bullet_world(common, drive);
      const auto fast = make_fast_world(common, drive);
      for (World* world : {parity.get(), static_cast<World*>(fast.get())}) {
        world->spawn_rock(test::start(kind));
        world->set_rock_velocity({3.5, 0.4, 0}, {0, 0, 0});
      }
      int at = -1;
      for (int i = 0; i < 900; ++i) {
        const RockState before = fast->rock();
        parity->step({1e-4 * i, 0.1});
        fast->step({1e-4 * i, 0.1});
        const RockState after = fast->rock();
        // The new position is that of the new velocity.
        ASSERT_LT((after.p_WB - before.p_WB - 1e-3 * after.v_WB).norm(), 1e-12) << "step " << i;
        ASSERT_LT(angle_between(after.q_WB, before.q_WB), 1.1e-3 * after.w_WB.norm() + 1e-7);
        if (at < 0 && fast->handover() != Handover::none) at = i;
        if (at < 0 || i < at + 20) {
          ASSERT_LT((parity->rock().p_WB - after.p_WB).norm(), 1e-8) << "step " << i;
          ASSERT_LT((parity->rock().v_WB - after.v_WB).norm(), 1e-6) << "step " << i;
          ASSERT_NEAR(parity->pedestal().position, fast->pedestal().position, 1e-10);
        }
      }
      EXPECT_EQ(fast->handover(), Handover::off_the_top);
      EXPECT_GT(at, 50) << "the hand-over was to come in motion";
    }
  }
}

TEST(FastWorld, HandsOverWhenTheRockIsDeepInThePedestal) {
  const auto common = scene(RockKind::hull);
  const auto exact = make_exact_world(common, Drive::prescribed);
  const auto fast = make_fast_world(common, Drive::prescribed);
  Pose deep = test::start(RockKind::hull);
  deep.position.z() = 2.7;
  exact->spawn_rock(deep);
  fast->spawn_rock(deep);
  for (int i = 0; i < 50; ++i) {
    exact->step({});
    fast->step({});
    // The start orientation went through a normalisation.
    ASSERT_LT((exact->rock().p_WB - fast->rock().p_WB).norm(), 1e-9) << "step " << i;
  }
  EXPECT_EQ(fast->handover(), Handover::too_deep);
  std::vector<ContactPoint> a;
  std::vector<ContactPoint> b;
  exact->contacts(a);
  fast->contacts(b);
  EXPECT_EQ(a.size(), b.size());
}

// Bullet takes over whole time steps: one that leaves the domain in a later substep is done again.
TEST(FastWorld, HandsOverBetweenTimeSteps) {
  EngineSettings engine;
  engine.substeps = 7;
  const auto common = scene(RockKind::hull, engine, test::pedestal({2.5, 2.5, 0.5}));
  const auto parity = make_bullet_world(common, Drive::prescribed);
  const auto fast = make_fast_world(common, Drive::prescribed);
  for (World* world : {parity.get(), static_cast<World*>(fast.get())}) {
    world->spawn_rock(test::start(RockKind::hull));
    world->set_rock_velocity({3.5, 0.4, 0}, {0, 0, 0});
  }
  for (int i = 0; i < 600 && fast->handover() == Handover::none; ++i) {
    const DriveTarget target{1e-4 * i, 0.1};
    parity->step(target);
    fast->step(target);
    ASSERT_LT((parity->rock().p_WB - fast->rock().p_WB).norm(), 1e-8) << "step " << i;
    ASSERT_NEAR(parity->pedestal().position, fast->pedestal().position, 1e-12);
  }
  EXPECT_EQ(fast->handover(), Handover::off_the_top);
}

// What a trial reports as diverged: the state stays not a number, and nothing throws.
TEST(FastWorld, KeepsAStateThatIsNotANumber) {
  const auto fast = make_fast_world(scene(RockKind::hull), Drive::prescribed);
  fast->spawn_rock(test::start(RockKind::hull));
  fast->set_rock_velocity({std::numeric_limits<double>::quiet_NaN(), 0, 0}, {0, 0, 0});
  for (int i = 0; i < 5; ++i) fast->step({0.1, 0});
  EXPECT_FALSE(fast->rock().v_WB.allFinite());
  EXPECT_NEAR(fast->pedestal().position, 0.1, 1e-12);
}

TEST(FastWorld, GivesTheSameBitsOnEveryThread) {
  for (const RockKind kind : {RockKind::hull, RockKind::box_off_centre}) {
    const auto common = scene(kind, {}, test::pedestal({2.5, 2.5, 0.5}));
    constexpr std::size_t kThreads = 4;
    std::array<std::vector<RockState>, kThreads> states;
    const auto run = [&](std::vector<RockState>& out) {
      const auto fast = make_fast_world(common, Drive::motor_position);
      fast->spawn_rock(test::start(kind));
      fast->set_rock_velocity({3.0, 0.4, 0}, {0, 0, 0});  // over the edge: Bullet's part counts too
      for (int i = 0; i < 900; ++i) {
        fast->step({});
        out.push_back(fast->rock());
      }
    };
    std::vector<std::thread> threads;
    for (auto& out : states) threads.emplace_back(run, std::ref(out));
    for (std::thread& thread : threads) thread.join();
    for (std::size_t k = 1; k < kThreads; ++k)
      for (std::size_t i = 0; i < states[0].size(); ++i)
        ASSERT_TRUE(test::same_bits(states[0][i], states[k][i])) << "step " << i;
  }
}

TEST(FastWorld, EqualsItselfWithoutVectorInstructions) {
  if (instruction_set() != InstructionSet::avx2) GTEST_SKIP() << "this processor has no AVX2";
  // With the powers of sweeps (contact_jump.cpp) and without, with a motor among their variables too.
  for (const bool swept : {false, true}) {
    for (const Drive drive : {Drive::prescribed, Drive::motor_position}) {
      EngineSettings engine;
      engine.converged_contacts = !swept;
      const auto common = scene(RockKind::hull, engine);
      std::vector<RockState> states[2];
      for (const bool portable : {false, true}) {
        set_instruction_set(portable ? InstructionSet::portable : InstructionSet::automatic);
        const auto world = make_fast_world(common, drive);
        world->spawn_rock(test::start(RockKind::hull));
        const test::Pulse pulse{0.25, 1.5};
        for (int i = 0; i < 1500; ++i) {
          world->step(pulse.at(i));
          states[portable].push_back(world->rock());
        }
      }
      set_instruction_set(InstructionSet::automatic);
      for (std::size_t i = 0; i < states[0].size(); ++i)
        ASSERT_TRUE(test::same_bits(states[0][i], states[1][i])) << "step " << i;
    }
  }
}

TEST(FastWorld, StartsAfreshAfterDeletion) {
  const auto common = scene(RockKind::hull);
  const auto used = make_fast_world(common, Drive::prescribed);
  const auto fresh = make_fast_world(common, Drive::prescribed);
  EXPECT_THROW(used->delete_rock(), InvalidInput);
  EXPECT_THROW(used->rock(), InvalidInput);
  for (const double z : {2.96, 2.7}) {  // the second hands over
    Pose start = test::start(RockKind::hull);
    start.position.z() = z;
    used->spawn_rock(start);
    EXPECT_THROW(used->spawn_rock(start), InvalidInput);
    for (int i = 0; i < 100; ++i) used->step({});
    used->delete_rock();
    EXPECT_EQ(used->handover(), Handover::none);
    std::vector<ContactPoint> none;
    used->contacts(none);
    EXPECT_TRUE(none.empty());
    used->step({});
  }
  used->spawn_rock(test::start(RockKind::hull));
  fresh->spawn_rock(test::start(RockKind::hull));
  for (int i = 0; i < 300; ++i) {
    used->step({});
    fresh->step({});
    ASSERT_TRUE(test::same_bits(used->rock(), fresh->rock())) << "step " << i;
  }
}

// A pedestal whose top slopes, its box off the centre of its frame.
PedestalSpec sloping_pedestal() {
  PedestalSpec pedestal = test::pedestal();
  auto& top = std::get<BoxPart>(pedestal.parts[0]);
  top.pose.orientation = Eigen::AngleAxisd(0.02, Eigen::Vector3d(0.6, 0.8, 0).normalized());
  top.pose.position = {0.05, -0.1, 0.01};
  return pedestal;
}

TEST(FastWorld, FollowsParityOnASlope) {
  for (const RockKind kind : {RockKind::box, RockKind::box_off_centre, RockKind::hull,
                              RockKind::hull_off_centre}) {
    for (const Drive drive : {Drive::prescribed, Drive::prescribed_spatial}) {
      const auto common = scene(kind, swept(), sloping_pedestal());
      const auto parity = make_bullet_world(common, drive);
      const auto fast = make_fast_world(common, drive);
      Pose start = test::start(kind);
      start.position.z() += 0.02;
      parity->spawn_rock(start);
      fast->spawn_rock(start);
      const test::Pulse pulse;
      for (int i = 0; i < 700; ++i) {
        DriveTarget target = pulse.at(i);
        if (drive == Drive::prescribed_spatial) target.excursion.pitch = 0.1 * target.position;
        parity->step(target);
        fast->step(target);
        // Measured: hulls 3e-11 m; boxes, dropped askew, 9e-8 m.
        const bool is_box = kind == RockKind::box || kind == RockKind::box_off_centre;
        ASSERT_LT((parity->rock().p_WB - fast->rock().p_WB).norm(), is_box ? 3e-7 : 1e-9)
            << test::name(kind) << " " << test::name(drive) << " step " << i;
      }
      EXPECT_EQ(fast->handover(), Handover::none);
    }
  }
}

TEST(FastWorld, LeavesAMotorOnASlopeToBullet) {
  const auto common = scene(RockKind::hull, {}, sloping_pedestal());
  const auto exact = make_exact_world(common, Drive::motor_position);
  const auto fast = make_fast_world(common, Drive::motor_position);
  for (World* world : {exact.get(), static_cast<World*>(fast.get())}) {
    world->spawn_rock(test::start(RockKind::hull));
    for (int i = 0; i < 300; ++i) world->step({});
  }
  EXPECT_EQ(fast->handover(), Handover::motor_on_a_slope);
  EXPECT_LT((exact->rock().p_WB - fast->rock().p_WB).norm(), 1e-9);
}

TEST(FastWorld, NamesWhatItDoesNotTake) {
  const auto refusal = [](const EngineSettings& engine, const PedestalSpec& pedestal,
                          const RockSpec& rock) {
    const auto common = std::make_shared<Scene>(engine, pedestal, rock);
    const FastRefusal reason = fast_refusal(*common);
    if (reason != FastRefusal::none) {
      EXPECT_THROW(make_fast_world(common, Drive::prescribed), InvalidInput);
    }
    return reason;
  };
  const RockSpec hull = test::rock(RockKind::hull);
  EXPECT_EQ(refusal({}, test::pedestal(), hull), FastRefusal::none);
  EXPECT_EQ(refusal({}, test::pedestal(), test::rock(RockKind::box_off_centre)), FastRefusal::none);

  RockSpec two = hull;
  two.parts.emplace_back(BoxPart{});
  EXPECT_EQ(refusal({}, test::pedestal(), two), FastRefusal::several_parts);

  PedestalSpec surface = test::pedestal();
  TrianglesPart triangles;
  triangles.vertices = {{-5, -5, 0.2}, {5, -5, 0.2}, {0, 5, 0.2}};
  triangles.faces = {{0, 1, 2}};
  surface.parts = {triangles};
  EXPECT_EQ(refusal({}, surface, hull), FastRefusal::pedestal_not_a_box);

  EngineSettings pyramid;
  pyramid.cone_friction = false;
  EXPECT_EQ(refusal(pyramid, test::pedestal(), hull), FastRefusal::no_friction_cone);

  RockSpec rolling = hull;
  rolling.material["rolling_friction"] = 0.1;
  EXPECT_EQ(refusal({}, test::pedestal(), rolling), FastRefusal::contact_parameter);

  EngineSettings bare;
  bare.collision_margin = 0;
  EXPECT_EQ(refusal(bare, test::pedestal(), hull), FastRefusal::no_margin);
}

TEST(FastWorld, StepsWithoutAllocating) {
  test::count_bullet_allocations();
  for (const RockKind kind : {RockKind::box, RockKind::hull, RockKind::hull_off_centre}) {
    const auto common = scene(kind);
    for (const bool exact : {false, true}) {
      const std::unique_ptr<World> world = exact ? make_exact_world(common, Drive::motor_position)
                                                 : make_fast_world(common, Drive::motor_position);
      world->spawn_rock(test::start(kind));
      const test::Pulse pulse{0.2, 1.5};
      for (int i = 0; i < 300; ++i) world->step(pulse.at(i));
      const long before = test::allocation_count();
      for (int i = 300; i < 2000; ++i) {
        world->step(pulse.at(i));
        (void)world->rock();
        (void)world->pedestal();
      }
      EXPECT_EQ(test::allocation_count() - before, 0)
          << test::name(kind) << (exact ? " exact" : " fast");
    }
  }
}

TEST(FastWorld, TakesLittleMemory) { EXPECT_LT(sizeof(FastStepper), 8192U); }

double energy(const FastModel& model, const RockState& rock) {
  const Eigen::Vector3d w_B = rock.q_WB.conjugate() * rock.w_WB;
  return 0.5 * model.mass * rock.v_WB.squaredNorm() +
         0.5 * w_B.dot(model.inertia.cwiseProduct(w_B)) +
         model.mass * model.engine.gravity * rock.p_WB.z();
}

// On a pedestal at rest the rock only loses energy. What may come back is the work of the contacts
// lifting the rock out of its penetration, not counted here: m g times a depth of less than 5e-5 m.
TEST(FastWorld, CreatesNoEnergy) {
  for (const RockKind kind : {RockKind::box, RockKind::hull, RockKind::hull_off_centre}) {
    const auto common = scene(kind);
    const FastModel model(*common);
    const auto fast = make_fast_world(common, Drive::prescribed);
    Pose high = test::start(kind);
    high.position.z() += 0.1;
    fast->spawn_rock(high);
    fast->set_rock_velocity({0.5, 0.2, 0}, {1.0, -2.0, 0.5});
    const double start = energy(model, fast->rock());
    double least = start;
    for (int i = 0; i < 5000; ++i) {
      fast->step({});
      const double now = energy(model, fast->rock());
      ASSERT_LT(now, least + model.mass * model.engine.gravity * 5e-5)
          << test::name(kind) << " step " << i;
      least = std::min(least, now);
    }
    if (kind == RockKind::box) {
      EXPECT_LT(fast->rock().v_WB.norm(), 1e-3);
    }
  }
}

}  // namespace
}  // namespace vsr2
