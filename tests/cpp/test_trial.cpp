#include <cmath>
#include <cstring>

#include <gtest/gtest.h>

#include "allocation_count.hpp"
#include "scenes.hpp"
#include "vsr2/engines.hpp"

namespace vsr2 {
namespace {

const std::atomic<bool> kRunOn{false};

TrialSpec rocking_trial() {
  TrialSpec spec = testing::trial_of(testing::block_scene({.size = {0.25, 0.5, 1.0}}),
                                     testing::standing(0.502, 0.1), testing::cosine(0.06, 1.5));
  spec.log_every = 1;
  return spec;
}

bool same_bits(const std::vector<double>& a, const std::vector<double>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
}

TEST(Trial, TenTimesTheSameBits) {
  const TrialResult first = run_trial(rocking_trial(), kRunOn);
  ASSERT_EQ(first.status, Status::ok) << first.message;
  ASSERT_GT(first.log.size(), 500U * kLogColumns);
  const TrialSpec common = rocking_trial();
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(same_bits(run_trial(common, kRunOn).log, first.log));
}

TEST(Trial, LogStartsAtRestAndKeepsTime) {
  const TrialResult result = run_trial(rocking_trial(), kRunOn);
  EXPECT_EQ(result.log[kTime], 0.0);
  EXPECT_NEAR(result.log[kLogColumns + kTime], 1e-3, 1e-15);
  ASSERT_EQ(kStateLog[12].name, std::string("rock_vx"));
  const Eigen::Vector3d v(&result.log[12]);
  EXPECT_LT(v.norm(), 1e-3);
  EXPECT_GT(result.settling_time, 0.25);
}

TEST(Trial, SettlingTimeoutIsAStatus) {
  // Rest speeds that contact noise never meets.
  const auto scene = testing::block_scene();
  TrialSpec spec = rocking_trial();
  spec.start = std::make_shared<SettledStart>(scene, Drive::prescribed, testing::standing(0.6),
                                              RestCriterion{1e-30, 1e-30, 0.25}, 0.5, 0);
  const TrialResult result = run_trial(spec, kRunOn);
  EXPECT_EQ(result.status, Status::settling_timeout);
  EXPECT_EQ(result.outcome, Outcome::failed);
  EXPECT_TRUE(std::isnan(result.peak_tilt));
  EXPECT_TRUE(result.message.empty());
  EXPECT_EQ(result.engine, EngineKind::parity);
}

TEST(Trial, SettlingLogHasNegativeTimes) {
  TrialSpec spec = rocking_trial();
  spec.start = std::make_shared<SettledStart>(spec.start->scene(), Drive::prescribed,
                                              testing::standing(0.502, 0.1), RestCriterion{}, 60.0, 10);
  const TrialResult result = run_trial(spec, kRunOn);
  EXPECT_NEAR(result.log[kTime], -result.settling_time, 1e-9);
  double previous = -1e9;
  bool zero = false;
  for (std::size_t row = 0; row < result.log.size(); row += kLogColumns) {
    EXPECT_GT(result.log[row + kTime], previous);
    previous = result.log[row + kTime];
    zero |= previous == 0.0;
  }
  EXPECT_TRUE(zero);
}

TEST(Trial, EarlyStopChangesNoOutcome) {
  for (double amplitude : {0.02, 0.06, 0.15}) {
    TrialSpec spec = rocking_trial();
    spec.position = std::make_shared<const std::vector<double>>(testing::cosine(amplitude, 1.5));
    spec.tail = 15.0;
    const TrialResult early = run_trial(spec, kRunOn);
    spec.stop_early = false;
    const TrialResult late = run_trial(spec, kRunOn);
    EXPECT_EQ(early.outcome, late.outcome) << amplitude;
    EXPECT_LT(early.steps, late.steps);
  }
}

TEST(Trial, SteppingAllocatesNothing) {
  test::count_bullet_allocations();
  for (const EngineKind kind : {EngineKind::parity, EngineKind::exact, EngineKind::fast}) {
    EngineSettings engine;
    engine.kind = kind;
    const auto scene = testing::block_scene({.size = {0.25, 0.5, 1.0}, .engine = engine});
    // The longer trial makes the same allocations: none is of a step, with all rows logged.
    long allocations[2];
    for (const bool longer : {false, true}) {
      std::vector<double> motion = testing::cosine(0.06, 1.5);
      motion.insert(motion.end(), longer ? 5000 : 2000, 0.0);
      TrialSpec spec = testing::trial_of(scene, testing::standing(0.502, 0.1), std::move(motion));
      spec.stop_early = false;
      spec.tail = 1.0;
      spec.log_every = 1;
      spec.contacts_every = 1;
      const long before = test::allocation_count();
      const TrialResult result = run_trial(spec, kRunOn);
      allocations[longer] = test::allocation_count() - before;
      EXPECT_EQ(result.log.size() / kLogColumns, longer ? 6668U : 3668U) << result.message;
      EXPECT_EQ(result.log.size(), result.log.capacity());
      EXPECT_GT(result.contacts.size() / kContactColumns, 3668U);
    }
    EXPECT_EQ(allocations[0], allocations[1]) << static_cast<int>(kind);
  }
}

TEST(Trial, LateOverturningCounts) {
  // A motion that stops while the block is beyond its balance: it falls after the end.
  const auto scene = testing::block_scene({.size = {0.2, 0.8, 1.0}});
  std::vector<double> x;
  for (int i = 0; i <= 600; ++i) {
    const double t = i * 1e-3;
    x.push_back(t < 0.3 ? 0.5 * 4.0 * t * t : 0.18 + 1.2 * (t - 0.3) - 0.5 * 4.0 * (t - 0.3) * (t - 0.3));
  }
  TrialSpec spec = testing::trial_of(scene, testing::standing(0.5), x);
  const TrialResult result = run_trial(spec, kRunOn);
  ASSERT_EQ(result.outcome, Outcome::overturned);
  EXPECT_GT(result.overturning_time, 0.6);
}

TEST(Trial, EmptyAndInfiniteMotionsAreErrors) {
  TrialSpec spec = rocking_trial();
  spec.position = std::make_shared<const std::vector<double>>();
  EXPECT_EQ(run_trial(spec, kRunOn).status, Status::error);
  spec.position = std::make_shared<const std::vector<double>>(std::vector<double>{0.0, INFINITY});
  EXPECT_EQ(run_trial(spec, kRunOn).status, Status::error);
}

TEST(Trial, ContactLogIsOffByDefaultAndHoldsTheWeight) {
  TrialSpec spec = rocking_trial();
  EXPECT_TRUE(run_trial(spec, kRunOn).contacts.empty());
  spec.contacts_every = 5;
  const TrialResult result = run_trial(spec, kRunOn);
  ASSERT_GE(result.contacts.size(), 4U * kContactColumns);
  double impulse = 0.0;
  for (std::size_t row = 0; row < result.contacts.size() && result.contacts[row] == 0.0;
       row += kContactColumns)
    impulse += result.contacts[row + 11];
  EXPECT_NEAR(impulse / (spec.start->scene()->rock().mass * 9.81e-3), 1.0, 1e-2);
}

TEST(Trial, TiltIgnoresTheTurnAboutTheVertical) {
  const Eigen::Quaterniond q0(Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 3).normalized()));
  const Eigen::Quaterniond yaw(Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitZ()));
  const Eigen::Quaterniond tip(Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitY()));
  EXPECT_NEAR(tilt_from(q0, yaw * q0), 0.0, 1e-12);
  EXPECT_NEAR(yaw_from(q0, yaw * q0), 0.7, 1e-12);
  EXPECT_NEAR(tilt_from(q0, tip * yaw * q0), 0.2, 1e-12);
  const Eigen::Quaterniond over(Eigen::AngleAxisd(3.0, Eigen::Vector3d::UnitX()));
  EXPECT_NEAR(tilt_from(q0, over * q0), 3.0, 1e-9);
}

}  // namespace
}  // namespace vsr2
