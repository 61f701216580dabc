// One step of the stepper of `fast`: closed forms, and where many sweeps lead.

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "engine_scenes.hpp"
#include "fast_stepper.hpp"

namespace vsr2 {
namespace {

using test::angle_between;
using test::RockKind;
using test::scene;
using test::swept;
using test::undamped;

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

// A support that follows a pulse along x and, with an inertia, pitches on a spring of 5 Hz under what the
// rock does to it.
struct Table {
  double inertia;  // 0: it does not pitch [kg m^2]
  double speed = 0.0, rate = 0.0, pitch = 0.0;
  Support support{{.p_WP = {0, 0, 2.25}}};
  SupportMotor motor{};
  test::Pulse pulse{0.15, 1.5};

  void begin(int i) {
    speed = (pulse.at(i).position - motor.p_WA.x()) / 1e-3;
    support.v_WP = {speed, 0, 0};
    if (inertia > 0) {
      rate -= std::pow(2 * M_PI * 5.0, 2) * pitch * 1e-3;
      motor.pitch_response = 1.0 / inertia;
      support.level = false;
      support.R_WP = Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()).toRotationMatrix();
      const Eigen::Vector3d arm = support.R_WP * Eigen::Vector3d(0.1, 0, 0.6);
      motor.p_WA.z() = 1.65;
      support.p_WP = motor.p_WA + arm;
      support.w_WP = {0, rate, 0};
      support.v_WP += support.w_WP.cross(arm);
    }
  }
  void end(const SupportMotor& moved) {
    motor.p_WA.x() += 1e-3 * speed;
    support.p_WP.x() += 1e-3 * speed;
    rate += moved.velocity_change;
    pitch += 1e-3 * rate;
  }
};

// Every step of a motion with rest, rocking and impacts whose contacts stick, solved at once and, from
// the same state, sweep by sweep. 5000 sweeps end there: the slowest, of four contacts that close
// together, still have 1e-6 m/s to go, and one step in a hundred more than 1e-7 m/s. 150 sweeps do so
// on few points. On a level base they stop short by some 1e-5 m/s, as they pass loads on slowly.
// `inertia`: of the table about its pitch axis, about that of the rock or ten times as much; 0: level.
void solves_where_the_sweeps_lead(RockKind kind, double inertia) {
  SCOPED_TRACE(std::string(test::name(kind)) + " " + std::to_string(inertia));
  const bool level = kind != RockKind::hull && kind != RockKind::hull_off_centre;
  const auto swept_by = [&](int sweeps) {
    EngineSettings engine;
    engine.residual_threshold = std::numeric_limits<double>::denorm_min();
    engine.solver_iterations = sweeps;
    return FastStepper(std::make_shared<const FastModel>(*scene(kind, engine)));
  };
  FastStepper solved(std::make_shared<const FastModel>(*scene(kind)));
  FastStepper few = swept_by(150);
  FastStepper many = swept_by(5000);
  const Pose start = test::start(kind);
  solved.state = {start.position, start.orientation, {0.2, 0.1, 0}, {0, 0, 0.5}};
  Table table{.inertia = inertia};
  // On a table that swings more steps slide or fly, and sweeps converge more slowly.
  const int steps = inertia > 0 ? 1000 : 2500;
  const int least_at_once = inertia > 0 ? steps / 4 : steps / 2;
  const double most_slow = inertia > 0 ? 0.1 : 0.01;
  int at_once = 0;
  int slow = 0;
  double from_few = 0.0;
  for (int i = 0; i < steps; ++i) {
    table.begin(i);
    few.restore(solved.snapshot());
    many.restore(solved.snapshot());
    SupportMotor motors[3] = {table.motor, table.motor, table.motor};
    FastStepper* steppers[3] = {&solved, &few, &many};
    for (int k = 0; k < 3; ++k) {
      ASSERT_EQ(steppers[k]->detect(table.support), FastStepper::Verdict::in_domain);
      steppers[k]->advance(table.support, motors[k], 1e-3);
    }
    table.end(motors[0]);
    if (solved.contact_count() == 0 || solved.iterations() > 0) continue;
    ++at_once;
    const auto left = [&](int k) {
      return std::max(apart(solved, *steppers[k]),
                      0.3 * std::fabs(motors[0].velocity_change - motors[k].velocity_change));
    };
    ASSERT_LT(left(2), level ? 3e-6 : 1e-12) << "step " << i;
    slow += left(2) > 1e-7;
    from_few = std::max(from_few, left(1));
  }
  EXPECT_GT(at_once, least_at_once);
  EXPECT_LT(slow, most_slow * at_once);
  if (level) {
    EXPECT_GT(from_few, 1e-6);
    EXPECT_LT(from_few, inertia > 0 ? 5e-5 : 3e-5);
  } else {
    EXPECT_LT(from_few, 1e-12);
  }
}

TEST(FastStepper, SolvesWhereTheSweepsLead) {
  for (const double inertia : {0.0, 100.0, 1000.0})
    for (const RockKind kind : {RockKind::box, RockKind::box_off_centre, RockKind::hull,
                                RockKind::hull_off_centre, RockKind::hull_flat})
      solves_where_the_sweeps_lead(kind, inertia);
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
      all_sweeps.converged_contacts = false;
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
