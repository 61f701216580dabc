#include <cmath>
#include <cstring>
#include <random>

#include <gtest/gtest.h>

#include "quiet_stretch.hpp"
#include "scenes.hpp"
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

// Just below and just above a threshold [m/s^2], before the safety.
void expect_threshold(const Foothold& foothold, const Eigen::Vector3d& direction, double threshold) {
  const Bearing bearing(foothold, kG);
  EXPECT_TRUE(bearing.bears(direction * 0.999 * threshold / kSafety));
  EXPECT_FALSE(bearing.bears(direction * 1.001 * threshold / kSafety));
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

TEST(Bearing, NeedsAnAreaUnderTheMassCentre) {
  Foothold foothold = block();
  foothold.count = 2;
  EXPECT_FALSE(Bearing(foothold, kG).bears(Eigen::Vector3d::Zero()));
  foothold.count = 3;  // the mass centre lies over the diagonal
  EXPECT_FALSE(Bearing(foothold, kG).bears({0.01, 0, 0}) && Bearing(foothold, kG).bears({-0.01, 0, 0}));
  foothold = block();
  for (Eigen::Vector3d& r : foothold.r_T) r.x() += 0.21;
  EXPECT_FALSE(Bearing(foothold, kG).bears(Eigen::Vector3d::Zero()));
}

// Corners that rounding has moved are no other polygon: no edge is lost.
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

// Soft contacts answer by more than is asked of them: at most by coth(pi z / (2 sqrt(1 - z^2))).
TEST(Bearing, AllowsForResonance) {
  constexpr double k = 1e6;
  const double inertia = 58.0 + 600.0 * 0.25;             // about the contacts' height
  const double frequency = std::sqrt(k * 0.16 / inertia);  // the slowest: tilt about y
  for (const double ratio : {0.05, 0.2, 0.6}) {
    const Foothold foothold = block(k, 2.0 * ratio * k / frequency);
    const double gain = 1.0 / std::tanh(0.5 * M_PI * ratio / std::sqrt(1.0 - ratio * ratio));
    expect_threshold(foothold, {1, 0, 0}, kG * 0.4 / gain);
    EXPECT_NEAR(Bearing(foothold, kG).memory(), 1.0 / (ratio * frequency), 1e-9);
    // The worst input turns round with the motion, half a period each; its answer is the gain.
    double x = 0.0;
    double v = 0.0;
    double greatest = 0.0;
    constexpr double dt = 1e-5;
    const double half = M_PI / (frequency * std::sqrt(1.0 - ratio * ratio));
    for (int i = 0; i * dt < 80 * half; ++i) {
      const double input = std::fmod(i * dt, 2 * half) < half ? 1.0 : -1.0;
      v += dt * (frequency * frequency * (input - x) - 2 * ratio * frequency * v);
      x += dt * v;
      greatest = std::max(greatest, std::fabs(x));
    }
    EXPECT_NEAR(greatest, gain, 0.02 * gain);
  }
}

class QuietTrial : public ::testing::Test {
 protected:
  static std::shared_ptr<const Scene> scene(bool skip, EngineSettings engine = {}) {
    engine.kind = EngineKind::fast;
    engine.skip_quiet = skip;
    return testing::block_scene({.size = {0.25, 0.5, 1.0}, .engine = engine});
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
