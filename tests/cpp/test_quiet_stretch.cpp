#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "allocation_count.hpp"
#include "quiet_stretch.hpp"
#include "scenes.hpp"
#include "trial_world.hpp"
#include "vsr2/constants.hpp"

namespace vsr2 {
namespace {

const std::atomic<bool> kRunOn{false};
constexpr double kG = 9.81;
constexpr double kSafety = kQuietStretch.safety;

// A block of 0.4 x 0.6 x 1 m on its four corners, friction 0.9; it would rock before it slides.
Foothold block(double stiffness = 2.6e9, double damping = 1e7) {
  Foothold foothold{.count = 4,
                    .R_WT = Eigen::Matrix3d::Identity(),
                    .friction = {.coefficient = 0.9},
                    .normal = {.stiffness = stiffness, .damping = damping},
                    .mass = 600.0,
                    .inertia_T = Eigen::Vector3d(68.0, 58.0, 26.0).asDiagonal()};
  foothold.r_T = {Eigen::Vector3d(-0.2, -0.3, -0.5), {-0.2, 0.3, -0.5}, {0.2, 0.3, -0.5}, {0.2, -0.3, -0.5}};
  return foothold;
}

constexpr double kStep = 1e-3;

// Whether a rock bears an acceleration that comes slowly, so that contacts have time to answer [m/s^2].
bool bears(const Foothold& foothold, const Eigen::Vector3d& a_W) {
  constexpr int kRise = 2000;
  Bearing bearing(foothold, kG, kStep, 1);
  if (!bearing.stands()) return false;
  for (int i = 0; i < kRise + 200; ++i)
    if (!bearing.advance(kStep * std::min(1.0, 1.0 * i / kRise) * a_W)) return false;
  return true;
}

// Just below and just above a threshold [m/s^2], before the safety.
void expect_threshold(const Foothold& foothold, const Eigen::Vector3d& direction, double threshold) {
  EXPECT_TRUE(bears(foothold, direction * 0.999 * threshold / kSafety));
  EXPECT_FALSE(bears(foothold, direction * 1.001 * threshold / kSafety));
}

TEST(Bearing, IsThatOfRockingSlidingAndTakingOff) {
  Foothold foothold = block();
  for (const double sign : {-1.0, 1.0}) {
    expect_threshold(foothold, {sign, 0, 0}, kG * 0.2 / 0.5);
    expect_threshold(foothold, {0, sign, 0}, kG * 0.3 / 0.5);
  }
  expect_threshold(foothold, {0, 0, -1}, kG);
  // Less weight, less of both: |a| h = (g - a / 2) b.
  expect_threshold(foothold, {1, 0, -0.5}, kG * 0.4 / 1.2);
  foothold.friction.coefficient = 0.3;
  expect_threshold(foothold, Eigen::Vector3d(3, 4, 0) / 5, kG * 0.3);
  // On a slope of 0.1 rad, which falls along T's x: gravity already pulls that way.
  foothold = block();
  foothold.R_WT = Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const Eigen::Vector3d downhill = foothold.R_WT.col(0);
  expect_threshold(foothold, -downhill, kG * (0.4 * std::cos(0.1) - std::sin(0.1)));
  expect_threshold(foothold, downhill, kG * (0.4 * std::cos(0.1) + std::sin(0.1)));
}

// The first of the substeps takes all of a change of the top's velocity, so twice as much then.
TEST(Bearing, CountsWhatTheFirstSubstepTakes) {
  Foothold foothold = block();
  foothold.friction.coefficient = 0.3;
  for (Eigen::Vector3d& r : foothold.r_T) r.z() = -1e-3;  // it does not tilt
  for (const double share : {0.999, 1.001}) {
    Bearing bearing(foothold, kG, 0.5 * kStep, 2);
    const Eigen::Vector3d dv(0.5 * kStep * share * 0.3 * kG / kSafety, 0, 0);
    EXPECT_EQ(bearing.advance(dv), share < 1);
  }
}

TEST(Bearing, NeedsAnAreaUnderTheMassCentre) {
  Foothold foothold = block();
  foothold.count = 2;
  EXPECT_FALSE(Bearing(foothold, kG, kStep, 1).stands());
  foothold.count = 3;  // the mass centre lies over the diagonal
  EXPECT_FALSE(bears(foothold, {0.01, 0, 0}) && bears(foothold, {-0.01, 0, 0}));
  foothold = block();
  for (Eigen::Vector3d& r : foothold.r_T) r.x() += 0.21;
  EXPECT_FALSE(Bearing(foothold, kG, kStep, 1).stands());
  foothold = block();
  for (Eigen::Vector3d& r : foothold.r_T) r.x() = 0.0;  // all on one line
  EXPECT_FALSE(bears(foothold, {1e-3, 0, 0}) && bears(foothold, {-1e-3, 0, 0}));
}

// A vertex beyond the block's edge at b is as low as that edge where the slow tilt m a h / (4 k b^2) is
// its offset over its distance from the edge.
TEST(Bearing, IsOverWhereAnotherVertexIsAsLow) {
  constexpr double k = 2.6e9;
  constexpr double offset = 2e-7;
  constexpr double beyond = 0.3;
  for (const double side : {-1.0, 1.0}) {
    Foothold foothold = block(k);
    foothold.low = {{.r_T = {side * (0.2 + beyond), 0.1, -0.5}, .offset = offset}};
    const double reaches = offset / beyond * 4 * k * 0.2 * 0.2 / (foothold.mass * 0.5);
    ASSERT_LT(reaches, kG * 0.4);
    // The mass lags behind the top, so the rock dips against the acceleration.
    expect_threshold(foothold, {-side, 0, 0}, reaches);
    expect_threshold(foothold, {side, 0, 0}, kG * 0.4);
  }
}

// Corners that rounding has moved bear as much.
TEST(Bearing, DoesNotDependOnRounding) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> rounding(-1e-15, 1e-15);
  for (int i = 0; i < 200; ++i) {
    Foothold foothold = block();
    for (Eigen::Vector3d& r : foothold.r_T)
      for (double& value : r) value += rounding(random);
    expect_threshold(foothold, {1, 0, 0}, kG * 0.4);
    expect_threshold(foothold, {-1, 0, 0}, kG * 0.4);
  }
}

// Soft contacts answer in their own time: an oscillator's spring and damper press by
// w^2 x + 2 z w v, and the input that turns round with the motion makes that greatest.
TEST(Bearing, AllowsForResonance) {
  constexpr double k = 1e6;
  constexpr double dt = 1e-5;
  const double inertia = 58.0 + 600.0 * 0.25;              // about the contacts' height
  const double frequency = std::sqrt(k * 0.16 / inertia);  // the slowest: tilt about y
  for (const double ratio : {0.05, 0.2, 0.6}) {
    const Foothold foothold = block(k, 2.0 * ratio * k / frequency);
    // The implicit step damps by w^2 dt / 2 besides.
    EXPECT_NEAR(1.0 / Bearing(foothold, kG, dt, 1).memory(), ratio * frequency + 0.5 * frequency * frequency * dt,
                1e-3 * ratio * frequency);
    const double half = M_PI / (frequency * std::sqrt(1.0 - ratio * ratio));
    const auto turning = [&](int i) { return std::fmod(i * dt, 2 * half) < half ? 1.0 : -1.0; };
    double x = 0.0;
    double v = 0.0;
    double gain = 0.0;
    for (int i = 0; i * dt < 80 * half; ++i) {
      v += dt * (frequency * frequency * (turning(i) - x) - 2 * ratio * frequency * v);
      x += dt * v;
      gain = std::max({gain, std::fabs(x), std::fabs(x + 2 * ratio / frequency * v)});
    }
    for (const double share : {0.98, 1.02}) {
      Bearing bearing(foothold, kG, dt, 1);
      bool holds = true;
      for (int i = 0; i * dt < 80 * half; ++i)
        holds = bearing.advance({dt * turning(i) * share * kG * 0.4 / gain / kSafety, 0, 0}) && holds;
      EXPECT_EQ(holds, share < 1) << ratio;
    }
  }
}

// What it says of random shaking along x, y and z the stepper does: its contacts hold where they are
// said to, and give way to 1.1 times what the safety leaves out.
TEST(Bearing, SaysWhatTheStepperDoes) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  for (int trial = 0; trial < 12; ++trial) {
    EngineSettings engine;
    engine.kind = EngineKind::fast;
    engine.substeps = 1 + trial % 2;
    ContactValues material;  // of each body, so a pair's spring is half as stiff, its damper twice
    material["stiffness"] = 1e8 * std::pow(1e2, unit(random));
    material["damping"] = material["stiffness"] * 1e-3 * std::pow(10.0, unit(random));
    const auto scene = testing::block_scene({.size = {0.25, 0.5, 1.0}, .engine = engine, .material = material});
    std::vector<DriveTarget> targets(3000);
    for (int part = 0; part < 9; ++part) {
      const double w = 2 * M_PI * 0.5 * std::pow(100.0, unit(random));
      const double amplitude = unit(random) / (w * w);
      const double phase = 2 * M_PI * unit(random);
      for (int i = 0; i < 3000; ++i) {
        const double t = i * kStep;
        const double fade = std::sin(M_PI * t / 3.0);
        const double x = amplitude * std::cos(w * t + phase) * fade * fade * fade;
        DriveTarget& at = targets[i];
        (part % 3 == 0 ? at.position : part % 3 == 1 ? at.excursion.transverse : at.excursion.vertical) += x;
      }
    }
    const auto place = [&](int i, double scale) {
      const DriveTarget& at = targets[std::max(i, 0)];
      return Eigen::Vector3d(scale * Eigen::Vector3d(at.position, at.excursion.transverse, at.excursion.vertical));
    };
    const auto settled = [&] {
      auto world = world_with_rock(scene, Drive::prescribed_spatial, testing::standing(0.5));
      for (int i = 0; i < 3000; ++i) world->step({});
      return world;
    };
    const auto resting = settled();
    Foothold foothold;
    ASSERT_TRUE(resting->foothold(foothold));
    const auto said = [&](double scale) {
      Bearing bearing(foothold, kG, kStep / engine.substeps, engine.substeps);
      for (int i = 1; i < 3000; ++i)
        if (!bearing.advance((place(i, scale) - 2 * place(i - 1, scale) + place(i - 2, scale)) / kStep)) return false;
      return true;
    };
    const auto done = [&](double scale) {
      const auto world = settled();
      for (int i = 1; i < 3000; ++i) {
        DriveTarget at;
        const Eigen::Vector3d p = place(i, scale);
        at.position = p.x();
        at.excursion.transverse = p.y();
        at.excursion.vertical = p.z();
        world->step(at);
        if (world->steps_held() == 0) return false;
      }
      return true;
    };
    double holds = 0.0;
    double fails = 100.0;
    while (fails > 1.001 * holds + 1e-6) {
      const double middle = 0.5 * (holds + fails);
      (said(middle) ? holds : fails) = middle;
    }
    EXPECT_TRUE(done(holds)) << trial;
    EXPECT_FALSE(done(1.1 * kSafety * fails)) << trial;
  }
}

class QuietTrial : public ::testing::Test {
 protected:
  static std::shared_ptr<const Scene> scene(bool skip, EngineSettings engine = {},
                                            ContactValues material = {}) {
    engine.kind = EngineKind::fast;
    engine.skip_quiet = skip;
    return testing::block_scene({.size = {0.25, 0.5, 1.0}, .engine = engine, .material = material});
  }

  // Rest, a tremor below the threshold of 0.25 g, a strong pulse, rest, a tremor, rest.
  static std::vector<double> motion() {
    std::vector<double> x(4000, 0.0);
    const auto shake = [&](double amplitude, double frequency) {
      for (double value : testing::cosine(amplitude, frequency)) x.push_back(x.front() + value);
      x.insert(x.end(), 6000, 0.0);
    };
    shake(0.005, 2.0);
    shake(0.04, 1.5);
    shake(0.005, 2.0);
    return x;
  }

  static TrialSpec spec(bool skip, EngineSettings engine = {}) {
    TrialSpec spec = testing::trial_of(scene(skip, engine), testing::standing(0.502, 0.1), motion());
    spec.log_every = 1;
    return spec;
  }
};

TEST_F(QuietTrial, EndsAsIfItWereStepped) {
  for (const int substeps : {1, 3}) {
    EngineSettings engine;
    engine.substeps = substeps;
    const TrialResult all = run_trial(spec(false, engine), kRunOn);
    const TrialResult some = run_trial(spec(true, engine), kRunOn);
    ASSERT_EQ(some.status, Status::ok) << some.message;
    ASSERT_EQ(all.outcome, Outcome::rocked);
    EXPECT_EQ(some.outcome, all.outcome);
    EXPECT_LT(some.steps, all.steps / 3);
    EXPECT_NEAR(some.simulated_time, all.simulated_time, 1e-9);
    EXPECT_NEAR(some.peak_tilt, all.peak_tilt, 1e-4);
    EXPECT_NEAR(some.final_slip, all.final_slip, 1e-5);
    EXPECT_NEAR(some.final_yaw, all.final_yaw, 1e-5);
  }
}

// On soft contacts a rock swings as long as the top moves. It is not slow, but its contacts hold.
TEST_F(QuietTrial, CarriesARockThatSwingsOnItsContacts) {
  ContactValues soft;
  soft["stiffness"] = 4e7;
  soft["damping"] = 3e4;
  std::vector<double> x(1000, 0.0);
  for (int i = 0; i < 8000; ++i) {
    const double t = i * kStep;
    const double fade = std::sin(M_PI * t / 8.0);
    x.push_back(fade * (1.5e-5 * std::sin(2 * M_PI * 15.0 * t) + 4e-6 * std::sin(2 * M_PI * 24.0 * t)));
  }
  TrialResult results[2];
  for (const bool skip : {false, true}) {
    TrialSpec spec = testing::trial_of(scene(skip, {}, soft), testing::standing(0.5, 0.1), x);
    spec.log_every = 1;
    results[skip] = run_trial(spec, kRunOn);
    ASSERT_EQ(results[skip].status, Status::ok) << results[skip].message;
  }
  const auto& every = results[0].log;
  double fastest = 0.0;
  for (std::size_t row = 0; row < every.size(); row += kLogColumns)
    fastest = std::max(fastest, std::fabs(every[row + kLogColumns - 2]));
  EXPECT_GT(fastest, kQuietStretch.still_rate);
  EXPECT_LT(results[1].steps, results[0].steps / 5);
  EXPECT_EQ(results[1].outcome, results[0].outcome);
  EXPECT_NEAR(results[1].final_slip, results[0].final_slip, 1e-6);
  EXPECT_NEAR(results[1].peak_tilt, results[0].peak_tilt, 5e-4);
}

TEST_F(QuietTrial, LogsEveryRow) {
  const TrialResult all = run_trial(spec(false), kRunOn);
  const TrialResult some = run_trial(spec(true), kRunOn);
  ASSERT_EQ(some.log.size(), all.log.size());
  for (std::size_t row = 0; row < all.log.size(); row += kLogColumns) {
    for (int column = 0; column < 5; ++column)  // time and pedestal
      ASSERT_NEAR(some.log[row + column], all.log[row + column], 1e-12);
    if (some.log[row] > 10.0) continue;  // the rock rocks
    // What is carried lacks the deflection of the contacts, some 1e-6 m that fade within 10 ms.
    for (int column = 5; column < kLogColumns; ++column)
      ASSERT_NEAR(some.log[row + column], all.log[row + column], column < 12 ? 1e-5 : 1e-4)
          << kStateLog[column].name;
  }
}

TEST_F(QuietTrial, TakesNoStepWhereNothingCanHappen) {
  TrialSpec still = spec(true);
  still.position = std::make_shared<const std::vector<double>>(testing::cosine(0.005, 2.0));
  const TrialResult result = run_trial(still, kRunOn);
  EXPECT_EQ(result.outcome, Outcome::stable);
  EXPECT_EQ(result.steps, 0);
  EXPECT_EQ(result.log.size() / kLogColumns, 501U + 500U);  // the motion, the window of rest
  still.stop_early = false;
  still.tail = 2.0;
  EXPECT_EQ(run_trial(still, kRunOn).log.size() / kLogColumns, 501U + 2000U);
  still.tail = 0.1;
  EXPECT_EQ(run_trial(still, kRunOn).status, Status::tail_timeout);
}

// A motion that stops at once pulls at the rock after its last set-point.
TEST_F(QuietTrial, StepsThroughASuddenEnd) {
  std::vector<double> x;
  for (int i = 0; i <= 1000; ++i) x.push_back(0.5 * 1.5 * i * i * 1e-6);
  for (const bool skip : {false, true}) {
    TrialSpec sudden = spec(skip);
    sudden.position = std::make_shared<const std::vector<double>>(x);
    EXPECT_EQ(run_trial(sudden, kRunOn).outcome, Outcome::overturned) << skip;
  }
}

TEST_F(QuietTrial, TakesAllStepsWithALogOfContactsOrPitch) {
  const auto every = static_cast<std::int64_t>(motion().size());
  TrialSpec contacts = spec(true);
  contacts.contacts_every = 10;
  EXPECT_GT(run_trial(contacts, kRunOn).steps, every);
  const std::vector<double> x = motion();
  TrialSpec pitch = testing::trial_of(scene(true), testing::standing(0.502), x, Drive::prescribed_spatial);
  EXPECT_LT(run_trial(pitch, kRunOn).steps, every / 2);
  pitch.pitch = Samples(std::make_shared<const std::vector<double>>(x.size(), 0.0));
  EXPECT_GT(run_trial(pitch, kRunOn).steps, every);
}

// A block on three vertices, with a fourth by `gap` [m] over their plane, on soft contacts.
std::shared_ptr<const Scene> tripod(double gap) {
  RockSpec rock;
  std::vector<Eigen::Vector3d> points{{-0.2, -0.25, -0.5}, {0.25, -0.15, -0.5}, {0.02, 0.3, -0.5}, {-0.25, 0.25, gap - 0.5}};
  for (double x : {-0.2, 0.2})
    for (double y : {-0.3, 0.3}) points.emplace_back(x, y, 0.5);
  rock.parts = {HullPart(points)};
  rock.mass = 600.0;
  rock.principal_inertia = {68.0, 58.0, 26.0};
  rock.material = testing::material({{"stiffness", 1e7}, {"damping", 3e4}});
  PedestalSpec pedestal;
  pedestal.material = rock.material;
  pedestal.parts = {BoxPart{{10, 10, 0.5}, {}}};
  EngineSettings engine;
  engine.kind = EngineKind::fast;
  engine.skip_quiet = true;
  return std::make_shared<Scene>(engine, pedestal, rock);
}

// Where a fourth vertex lies little over the plane of three, a rock on soft contacts leans on it under a
// tremor. Bullet's hull has its points on a grid of a tenth of a millimetre.
TEST(QuietHull, StepsWhereARockMayLeanOnAFourthVertex) {
  std::int64_t steps[2];
  for (const bool is_near : {false, true}) {
    const double gap = is_near ? 1e-4 : 1e-2;
    const auto world = world_with_rock(tripod(gap), Drive::prescribed, testing::standing(0.54));
    for (int i = 0; i < 5000; ++i) world->step({});
    Foothold foothold;
    ASSERT_TRUE(world->foothold(foothold));
    ASSERT_EQ(foothold.count, 3);
    world->add_low_vertices(foothold);
    ASSERT_EQ(foothold.low.size(), is_near ? 1U : 0U);
    for (const Foothold::Low& vertex : foothold.low) EXPECT_NEAR(vertex.offset, gap, 1e-4);
    std::vector<double> x(1000, 0.0);
    for (double value : testing::cosine(0.004, 2.0)) x.push_back(value);
    const TrialSpec spec = testing::trial_of(tripod(gap), testing::standing(0.54), x);
    const TrialResult result = run_trial(spec, kRunOn);
    ASSERT_EQ(result.status, Status::ok) << result.message;
    steps[is_near] = result.steps;
  }
  EXPECT_GT(steps[1], steps[0] + 100);
}

TEST(QuietHull, RunsATrialWithoutAllocating) {
  test::count_bullet_allocations();
  const auto scene = tripod(2e-3);
  long allocations[2];
  for (const bool longer : {false, true}) {
    std::vector<double> x(1000, 0.0);
    for (int i = 0; i < (longer ? 8 : 1); ++i)
      for (double value : testing::cosine(0.004, 2.0)) x.push_back(value);
    const TrialSpec spec = testing::trial_of(scene, testing::standing(0.54), x);
    const long before = test::allocation_count();
    const TrialResult result = run_trial(spec, kRunOn);
    allocations[longer] = test::allocation_count() - before;
    EXPECT_LT(result.steps, static_cast<std::int64_t>(x.size()));
  }
  EXPECT_EQ(allocations[0], allocations[1]);
}

// Trials that share a start go on with copies of one world, whatever ran before them.
TEST_F(QuietTrial, GoesOnFromASharedStart) {
  const TrialResult alone = run_trial(spec(true), kRunOn);
  const TrialSpec common = spec(true);
  for (int i = 0; i < 3; ++i) {
    const TrialResult again = run_trial(common, kRunOn);
    ASSERT_EQ(again.log.size(), alone.log.size());
    EXPECT_EQ(std::memcmp(again.log.data(), alone.log.data(), again.log.size() * sizeof(double)), 0);
  }
}

// What is never stepped would have stayed at rest: shaking of random spectrum, as strong as the rock
// bears, along x, y and z at once.
TEST_F(QuietTrial, NothingHappensInWhatIsNotStepped) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  int unstepped = 0;
  for (int trial = 0; trial < 30; ++trial) {
    const double strength = 0.1 + 0.9 * unit(random);  // [g]
    std::vector<std::vector<double>> channels(3, std::vector<double>(4001));
    for (std::vector<double>& channel : channels) {
      for (int part = 0; part < 5; ++part) {
        const double w = 2 * M_PI * 0.5 * std::pow(60.0, unit(random));
        const double amplitude = strength * unit(random) * kG / 5 / (w * w);
        const double phase = 2 * M_PI * unit(random);
        for (int i = 0; i <= 4000; ++i) {
          const double t = i * 1e-3;
          const double fade = std::sin(0.25 * M_PI * t);
          channel[i] += amplitude * std::cos(w * t + phase) * fade * fade * fade;
        }
      }
    }
    TrialResult results[2];
    for (const bool skip : {false, true}) {
      TrialSpec spec = testing::trial_of(scene(skip), testing::standing(0.502, 0.1), channels[0],
                                         Drive::prescribed_spatial);
      const auto common = [](const std::vector<double>& x) {
        return Samples(std::make_shared<const std::vector<double>>(x));
      };
      spec.transverse = common(channels[1]);
      spec.vertical = common(channels[2]);
      results[skip] = run_trial(spec, kRunOn);
      ASSERT_EQ(results[skip].status, Status::ok) << results[skip].message;
    }
    if (results[1].steps > 0) continue;
    ++unstepped;
    EXPECT_LT(results[0].peak_tilt, 2e-4);
    EXPECT_LT(results[0].final_slip, 1e-5);
  }
  EXPECT_GT(unstepped, 5);
  EXPECT_LT(unstepped, 30);
}

}  // namespace
}  // namespace vsr2
