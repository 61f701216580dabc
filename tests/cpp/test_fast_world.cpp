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

using test::RockKind;

std::shared_ptr<const Scene> scene(RockKind kind, const EngineSettings& engine = {},
                                   const PedestalSpec& pedestal = test::pedestal()) {
  return std::make_shared<Scene>(engine, pedestal, test::rock(kind));
}

double angle_between(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  return 2.0 * std::asin(std::min(1.0, (a * b.conjugate()).vec().norm()));
}

// Every step swept, as in Bullet.
EngineSettings swept() {
  EngineSettings engine;
  engine.converged_contacts = false;
  return engine;
}

class FastWorldAgreement : public ::testing::TestWithParam<std::tuple<RockKind, Drive>> {};

// Both compute the same model in doubles; what differs is rounding, and Bullet's normals, which
// lean by some 1e-13. 1e-10 m over 1000 steps leaves room for its growth while the rock rocks.
TEST_P(FastWorldAgreement, FollowsParityStepForStep) {
  const auto [kind, drive] = GetParam();
  const auto shared = scene(kind, swept());
  const auto parity = make_bullet_world(shared, drive);
  const auto fast = make_fast_world(shared, drive);
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
  const auto shared = scene(kind);
  const auto parity = make_bullet_world(shared, drive);
  const auto fast = make_fast_world(shared, drive);
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
    const auto shared = scene(RockKind::hull, engine);
    const auto parity = make_bullet_world(shared, drive);
    const auto fast = make_fast_world(shared, drive);
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

// A scene's own threshold ends the sweeps early, as in Bullet. The two then part slowly: by at most
// 1e-5 m/s a step and row, that is far less than 1e-5 m in the 0.3 s at rest.
TEST(FastStepper, StopsEarlyWhereTheSceneSaysSo) {
  for (const RockKind kind : {RockKind::box, RockKind::hull}) {
    EngineSettings engine;
    engine.residual_threshold = 1e-10;
    const auto parity = make_bullet_world(scene(kind), Drive::prescribed);
    FastStepper fast(std::make_shared<const FastModel>(*scene(kind, engine)));
    const Pose start = test::start(kind);
    parity->spawn_rock(start);
    fast.state = {start.position, start.orientation};
    Support support;
    support.p_WP = test::pedestal().p_WP0;
    int most = 0;
    int least = 1000;
    for (int i = 0; i < 300; ++i) {
      parity->step({});
      ASSERT_EQ(fast.detect(support), FastStepper::Verdict::in_domain);
      SupportMotor motor;
      fast.advance(support, motor, 1e-3);
      most = std::max(most, fast.iterations());
      if (i > 50) least = std::min(least, fast.iterations());
    }
    EXPECT_LT((parity->rock().p_WB - fast.state.p_WB).norm(), 1e-5);
    EXPECT_LT(angle_between(parity->rock().q_WB, fast.state.q_WB), 1e-4);
    EXPECT_LT(least, 100) << "the threshold was to end iterations early";
    EXPECT_LE(most, 150);
  }
}

// The rock slides over the edge of a small pedestal. The world that takes over starts from the same
// state and contacts: the motion goes on as parity's, and no step jumps.
TEST(FastWorld, HandsOverAtTheEdgeWithoutAJump) {
  for (const RockKind kind :
       {RockKind::box, RockKind::hull, RockKind::hull_off_centre, RockKind::box_off_centre}) {
    for (const Drive drive : {Drive::prescribed, Drive::motor_position}) {
      SCOPED_TRACE(test::name(kind));
      const auto shared = scene(kind, {}, test::pedestal({2.5, 2.5, 0.5}));
      const auto parity = make_bullet_world(shared, drive);
      const auto fast = make_fast_world(shared, drive);
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
  const auto shared = scene(RockKind::hull);
  const auto exact = make_exact_world(shared, Drive::prescribed);
  const auto fast = make_fast_world(shared, Drive::prescribed);
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
  const auto shared = scene(RockKind::hull, engine, test::pedestal({2.5, 2.5, 0.5}));
  const auto parity = make_bullet_world(shared, Drive::prescribed);
  const auto fast = make_fast_world(shared, Drive::prescribed);
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
    const auto shared = scene(kind, {}, test::pedestal({2.5, 2.5, 0.5}));
    constexpr std::size_t kThreads = 4;
    std::array<std::vector<RockState>, kThreads> states;
    const auto run = [&](std::vector<RockState>& out) {
      const auto fast = make_fast_world(shared, Drive::motor_position);
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
  const auto shared = scene(RockKind::hull);
  std::vector<RockState> states[2];
  for (const bool portable : {false, true}) {
    set_instruction_set(portable ? InstructionSet::portable : InstructionSet::automatic);
    const auto world = make_fast_world(shared, Drive::prescribed);
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

TEST(FastWorld, StartsAfreshAfterDeletion) {
  const auto shared = scene(RockKind::hull);
  const auto used = make_fast_world(shared, Drive::prescribed);
  const auto fresh = make_fast_world(shared, Drive::prescribed);
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
      const auto shared = scene(kind, swept(), sloping_pedestal());
      const auto parity = make_bullet_world(shared, drive);
      const auto fast = make_fast_world(shared, drive);
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
  const auto shared = scene(RockKind::hull, {}, sloping_pedestal());
  const auto exact = make_exact_world(shared, Drive::motor_position);
  const auto fast = make_fast_world(shared, Drive::motor_position);
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
    const auto shared = std::make_shared<Scene>(engine, pedestal, rock);
    const FastRefusal reason = fast_refusal(*shared);
    if (reason != FastRefusal::none) {
      EXPECT_THROW(make_fast_world(shared, Drive::prescribed), InvalidInput);
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
  EXPECT_EQ(refusal({}, test::pedestal(), rolling), FastRefusal::rolling_friction);

  EngineSettings bare;
  bare.collision_margin = 0;
  EXPECT_EQ(refusal(bare, test::pedestal(), hull), FastRefusal::no_margin);
}

TEST(FastWorld, StepsWithoutAllocating) {
  test::count_bullet_allocations();
  for (const RockKind kind : {RockKind::box, RockKind::hull, RockKind::hull_off_centre}) {
    const auto shared = scene(kind);
    for (const bool exact : {false, true}) {
      const std::unique_ptr<World> world = exact ? make_exact_world(shared, Drive::motor_position)
                                                 : make_fast_world(shared, Drive::motor_position);
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
    const auto shared = scene(kind);
    const FastModel model(*shared);
    const auto fast = make_fast_world(shared, Drive::prescribed);
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

std::shared_ptr<const FastModel> box_model(const EngineSettings& engine, double friction) {
  RockSpec rock;
  rock.parts.emplace_back(BoxPart{{0.6, 0.6, 0.1}, {}});
  rock.mass = 50;
  rock.inertia_from_aabb = true;
  rock.material["lateral_friction"] = friction;
  PedestalSpec pedestal = test::pedestal();
  pedestal.material["lateral_friction"] = 1.0;
  return std::make_shared<const FastModel>(Scene(engine, pedestal, rock));
}

EngineSettings undamped() {
  EngineSettings engine;
  engine.linear_damping = 0;
  engine.angular_damping = 0;
  return engine;
}

// Support tilted by an angle theta about y: a flat box slides with g (sin theta - mu cos theta), or
// stays where mu exceeds tan theta.
TEST(FastStepper, SlidesOnATiltedSupport) {
  constexpr double theta = 0.3;
  constexpr double dt = 1e-3;
  for (const double mu : {0.1, 0.5}) {
    FastStepper stepper(box_model(undamped(), mu));
    Support support;
    support.R_WP = Eigen::AngleAxisd(theta, Eigen::Vector3d::UnitY()).toRotationMatrix();
    support.p_WP = {0.4, -0.2, 1.0};
    support.level = false;
    stepper.state.q_WB = Eigen::Quaterniond(support.R_WP);
    stepper.state.p_WB = support.p_WP + support.R_WP * Eigen::Vector3d(-2, 0, 0.25 + 0.05);
    stepper.state.v_WB.setZero();
    stepper.state.w_WB.setZero();
    for (int i = 0; i < 1000; ++i) {
      ASSERT_EQ(stepper.detect(support), FastStepper::Verdict::in_domain);
      SupportMotor motor;
      stepper.advance(support, motor, dt);
    }
    const double expected = std::max(0.0, 9.81 * (std::sin(theta) - mu * std::cos(theta)));
    const Eigen::Vector3d v_P = support.R_WP.transpose() * stepper.state.v_WB;
    // The first steps set the box down through the contact's softness of about 1e-5 m.
    EXPECT_NEAR(v_P.x(), expected, 2e-3 * 9.81) << "friction " << mu;
    EXPECT_NEAR(v_P.y(), 0.0, 1e-6);
    EXPECT_NEAR(v_P.z(), 0.0, 1e-3);
    EXPECT_LT(stepper.state.w_WB.norm(), 1e-3);
  }
}

// Support rising with acceleration a: the contacts carry m (g + a) and the box goes along.
TEST(FastStepper, CarriesTheRockOnARisingSupport) {
  constexpr double a = 3.0;
  constexpr double dt = 1e-3;
  FastStepper stepper(box_model(undamped(), 0.7));
  Support support;
  stepper.state = {{0, 0, 0.3},
                   Eigen::Quaterniond::Identity(),
                   Eigen::Vector3d::Zero(),
                   Eigen::Vector3d::Zero()};
  double impulse = 0.0;
  for (int i = 0; i < 500; ++i) {
    ASSERT_EQ(stepper.detect(support), FastStepper::Verdict::in_domain);
    support.v_WP.z() += a * dt;
    SupportMotor motor;
    stepper.advance(support, motor, dt);
    support.p_WP += dt * support.v_WP;
    impulse = 0.0;
    for (int k = 0; k < stepper.contact_count(); ++k) impulse += stepper.contact(k).normal_impulse;
  }
  EXPECT_NEAR(stepper.state.v_WB.z(), support.v_WP.z(), 1e-3);
  EXPECT_NEAR(impulse, 50 * (9.81 + a) * dt, 1e-2 * 50 * (9.81 + a) * dt);
}

// A support turning slowly about the vertical takes the box along.
TEST(FastStepper, TurnsTheRockWithTheSupport) {
  constexpr double rate = 0.2;
  constexpr double dt = 1e-3;
  FastStepper stepper(box_model(undamped(), 0.7));
  Support support;
  support.level = false;
  support.w_WP = {0, 0, rate};
  stepper.state = {{0.5, 0, 0.3}, Eigen::Quaterniond::Identity(), {0, rate * 0.5, 0}, {0, 0, rate}};
  for (int i = 0; i < 1000; ++i) {
    ASSERT_EQ(stepper.detect(support), FastStepper::Verdict::in_domain);
    SupportMotor motor;
    stepper.advance(support, motor, dt);
    support.R_WP =
        Eigen::AngleAxisd(rate * dt * (i + 1), Eigen::Vector3d::UnitZ()).toRotationMatrix();
  }
  const double turned = rate * 1.0;
  EXPECT_NEAR(stepper.state.w_WB.z(), rate, 1e-3);
  EXPECT_NEAR(stepper.state.p_WB.x(), 0.5 * std::cos(turned), 2e-3);
  EXPECT_NEAR(stepper.state.p_WB.y(), 0.5 * std::sin(turned), 2e-3);
}

// Greatest difference of two steppers' velocities; the lever of the angular ones is the rock's [m/s].
double apart(const FastStepper& a, const FastStepper& b) {
  return std::max((a.state.v_WB - b.state.v_WB).norm(), 0.3 * (a.state.w_WB - b.state.w_WB).norm());
}

// Every step of a motion with rest, rocking and impacts whose contacts stick, solved at once and, from
// the same state, sweep by sweep. 3000 sweeps end there: the slowest, of four contacts that close
// together, still have 1e-6 m/s to go, and one step in a hundred more than 1e-7 m/s. 150 sweeps do so
// on few points. On a level base they stop short by some 1e-5 m/s, as they pass loads on slowly.
TEST(FastStepper, SolvesWhereTheSweepsLead) {
  for (const RockKind kind : {RockKind::box, RockKind::box_off_centre, RockKind::hull,
                              RockKind::hull_off_centre, RockKind::hull_flat}) {
    SCOPED_TRACE(test::name(kind));
    const bool level = kind != RockKind::hull && kind != RockKind::hull_off_centre;
    const auto swept_by = [&](int sweeps) {
      EngineSettings engine;
      engine.residual_threshold = std::numeric_limits<double>::denorm_min();
      engine.solver_iterations = sweeps;
      return FastStepper(std::make_shared<const FastModel>(*scene(kind, engine)));
    };
    FastStepper solved(std::make_shared<const FastModel>(*scene(kind)));
    FastStepper few = swept_by(150);
    FastStepper many = swept_by(3000);
    const Pose start = test::start(kind);
    solved.state = {start.position, start.orientation, {0.2, 0.1, 0}, {0, 0, 0.5}};
    Support support;
    support.p_WP.z() = 2.25;
    const test::Pulse pulse{0.15, 1.5};
    constexpr int steps = 2500;
    int at_once = 0;
    int slow = 0;
    double from_few = 0.0;
    for (int i = 0; i < steps; ++i) {
      const double v = (pulse.at(i).position - support.p_WP.x()) / 1e-3;
      support.v_WP.x() = v;
      few.restore(solved.snapshot());
      many.restore(solved.snapshot());
      SupportMotor none;
      for (FastStepper* stepper : {&solved, &few, &many}) {
        ASSERT_EQ(stepper->detect(support), FastStepper::Verdict::in_domain);
        stepper->advance(support, none, 1e-3);
      }
      support.p_WP.x() += 1e-3 * v;
      if (solved.contact_count() == 0 || solved.iterations() > 0) continue;
      ++at_once;
      const double left = apart(solved, many);
      ASSERT_LT(left, level ? 3e-6 : 1e-12) << "step " << i;
      slow += left > 1e-7;
      from_few = std::max(from_few, apart(solved, few));
    }
    EXPECT_GT(at_once, steps / 2);
    EXPECT_LT(slow, at_once / 100);
    if (level) {
      EXPECT_GT(from_few, 1e-6);
      EXPECT_LT(from_few, 3e-5);
    } else {
      EXPECT_LT(from_few, 1e-12);
    }
  }
}

// Every step of a motion with rest, rocking, sliding and impacts, taken with jumps and, from the same
// state, sweep by sweep. Where no contact slides a jump differs by rounding, the product of 1e-16, the
// 150 sweeps and the speeds of up to 1 m/s; where one slides also by the linearisation, at most
// (1e-5 rad)^2 / 2 of a friction impulse of m g dt a jump, and by the sweep in which a contact
// changes between sticking and sliding, whose friction differs then.
TEST(FastStepper, JumpsToWhereTheSweepsLead) {
  for (const RockKind kind : {RockKind::box, RockKind::hull, RockKind::hull_off_centre,
                              RockKind::hull_flat}) {
    for (const bool with_motor : {false, true}) {
      SCOPED_TRACE(std::string(test::name(kind)) + (with_motor ? " motor" : ""));
      const auto model = std::make_shared<const FastModel>(*scene(kind, swept()));
      EngineSettings all_sweeps;
      all_sweeps.residual_threshold = std::numeric_limits<double>::denorm_min();
      FastStepper jumps(model);
      FastStepper sweeps(std::make_shared<const FastModel>(*scene(kind, all_sweeps)));
      const Pose start = test::start(kind);
      jumps.state = {start.position, start.orientation, {0.2, 0.1, 0}, {0, 0, 0.5}};
      Support support;
      support.p_WP.z() = 2.25;
      const test::Pulse pulse{0.15, 1.5};
      int steps = 0;
      int apart = 0;
      int sliding = 0;
      long done = 0;
      for (int i = 0; i < 2500; ++i, ++steps) {
        const double v = (pulse.at(i).position - support.p_WP.x()) / 1e-3;
        support.v_WP.x() = v;
        SupportMotor motor[2];
        if (with_motor)
          for (SupportMotor& m : motor) m = {1.0 / 2000.0, v, 1e4, 0.0};
        sweeps.restore(jumps.snapshot());
        ASSERT_EQ(jumps.detect(support), FastStepper::Verdict::in_domain);
        ASSERT_EQ(sweeps.detect(support), FastStepper::Verdict::in_domain);
        jumps.advance(support, motor[0], 1e-3);
        sweeps.advance(support, motor[1], 1e-3);
        done += jumps.iterations();
        const double difference =
            std::max((jumps.state.v_WB - sweeps.state.v_WB).norm(),
                     0.3 * (jumps.state.w_WB - sweeps.state.w_WB).norm());
        ASSERT_LT(difference, 1e-8) << "step " << i;
        ASSERT_NEAR(motor[0].velocity_change, motor[1].velocity_change, 1e-8);
        bool slides = false;
        for (int k = 0; k < jumps.contact_count(); ++k) {
          const FastStepper::Contact& c = jumps.contact(k);
          slides |= c.normal_impulse > 0 && std::hypot(c.lateral_impulse_1, c.lateral_impulse_2) >
                                                0.999 * model->pair["lateral_friction"] * c.normal_impulse;
        }
        sliding += slides;
        apart += !slides && difference > 1e-12;
        support.p_WP.x() += 1e-3 * v;
      }
      EXPECT_LT(apart, steps / 100);
      EXPECT_GT(sliding, 10);
      EXPECT_LT(done, 60L * steps) << "jumps were to save sweeps";
      EXPECT_GT(done, steps);
    }
  }
}

// In free flight the velocity is that of constant acceleration and the position Bullet's sum of it.
TEST(FastStepper, FallsFreely) {
  constexpr double dt = 1e-3;
  FastStepper stepper(box_model(undamped(), 0.7));
  stepper.state = {{0, 0, 3}, Eigen::Quaterniond::Identity(), {1, 0, 0}, Eigen::Vector3d::Zero()};
  constexpr int steps = 400;
  for (int i = 0; i < steps; ++i) {
    ASSERT_EQ(stepper.detect({}), FastStepper::Verdict::in_domain);
    SupportMotor motor;
    stepper.advance({}, motor, dt);
  }
  EXPECT_NEAR(stepper.state.v_WB.z(), -9.81 * steps * dt, 1e-12);
  EXPECT_NEAR(stepper.state.p_WB.z(), 3 - 9.81 * dt * dt * steps * (steps + 1) / 2, 1e-12);
  EXPECT_NEAR(stepper.state.p_WB.x(), steps * dt, 1e-12);
}

}  // namespace
}  // namespace vsr2
