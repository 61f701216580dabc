#include <chrono>
#include <cstring>
#include <stdexcept>

#include <gtest/gtest.h>

#include "scenes.hpp"
#include "vsr2/batch.hpp"

namespace vsr2 {
namespace {

std::vector<TrialSpec> trials() {
  std::vector<TrialSpec> out;
  const auto block = testing::block_scene({.size = {0.25, 0.5, 1.0}});
  const auto hull = testing::hull_scene(24);
  for (double amplitude : {0.03, 0.06, 0.12}) {
    out.push_back(testing::trial_of(block, testing::standing(0.5), testing::cosine(amplitude, 1.5)));
    out.push_back(testing::trial_of(hull, testing::standing(0.4755), testing::cosine(amplitude, 1.2)));
  }
  for (TrialSpec& spec : out) spec.log_every = 7;
  return out;
}

std::vector<TrialResult> run(std::vector<TrialSpec> specs, int threads) {
  std::vector<TrialResult> results(specs.size());
  Batch batch(threads);
  for (TrialSpec& spec : specs) batch.add(std::move(spec));
  batch.close();
  while (!batch.exhausted())
    for (std::size_t i : batch.wait(0.05)) results[i] = batch.take(i);
  return results;
}

TEST(Batch, SameBitsAtAnyNumberOfThreads) {
  const auto serial = run(trials(), 1);
  for (int threads : {2, 3, 8}) {
    const auto parallel = run(trials(), threads);
    for (std::size_t i = 0; i < serial.size(); ++i) {
      ASSERT_EQ(serial[i].status, Status::ok) << serial[i].message;
      ASSERT_EQ(serial[i].log.size(), parallel[i].log.size());
      EXPECT_EQ(0, std::memcmp(serial[i].log.data(), parallel[i].log.data(),
                               serial[i].log.size() * sizeof(double)));
    }
  }
}

TEST(Batch, SameBitsInAnyOrder) {
  const auto forward = run(trials(), 2);
  auto specs = trials();
  std::reverse(specs.begin(), specs.end());
  const auto backward = run(std::move(specs), 2);
  for (std::size_t i = 0; i < forward.size(); ++i)
    EXPECT_EQ(forward[i].log, backward[forward.size() - 1 - i].log);
}

TEST(Batch, AFailedTrialLosesNoOther) {
  auto specs = trials();
  specs[1].position = std::make_shared<const std::vector<double>>(std::vector<double>{0.0, NAN});
  specs[2].start = nullptr;
  const auto results = run(std::move(specs), 2);
  EXPECT_EQ(results[1].status, Status::error);
  EXPECT_EQ(results[2].status, Status::error);
  for (std::size_t i : {0U, 3U, 4U, 5U}) EXPECT_EQ(results[i].status, Status::ok);
}

TEST(Batch, CancelStopsWithinASecondAndKeepsWhatIsDone) {
  auto specs = trials();
  const auto endless = std::make_shared<const std::vector<double>>(20'000'000, 0.0);
  for (std::size_t i = 1; i < specs.size(); ++i) specs[i].position = endless;
  for (TrialSpec& spec : specs) spec.log_every = 0;
  Batch batch(2);
  for (TrialSpec& spec : specs) batch.add(std::move(spec));
  std::vector<std::size_t> done;
  while (done.empty()) done = batch.wait(0.1);
  EXPECT_EQ(batch.take(done.front()).status, Status::ok);
  const auto start = std::chrono::steady_clock::now();
  batch.cancel();
  batch.join();
  EXPECT_LT(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(), 1.0);
  for (std::size_t i : batch.wait(0.0)) EXPECT_EQ(batch.take(i).status, Status::cancelled);
}

TEST(Batch, TakesTrialsWhileItRuns) {
  const auto specs = trials();
  const auto reference = run(specs, 1);
  Batch batch(3);
  EXPECT_FALSE(batch.exhausted());
  // Workers run out of trials and wait between the rounds; an index goes on counting.
  for (std::size_t round = 0; round < 3; ++round) {
    for (std::size_t i = 0; i < specs.size(); ++i)
      EXPECT_EQ(batch.add(specs[i]), round * specs.size() + i);
    std::size_t collected = 0;
    while (collected < specs.size())
      for (std::size_t i : batch.wait(0.05)) {
        EXPECT_EQ(batch.take(i).log, reference[i % specs.size()].log);
        EXPECT_THROW(batch.take(i), std::out_of_range);
        ++collected;
      }
    EXPECT_FALSE(batch.exhausted());
  }
  batch.close();
  EXPECT_THROW(batch.add(specs[0]), InvalidInput);
  batch.join();
  EXPECT_TRUE(batch.exhausted());
}

TEST(Batch, EndsWithoutTrials) {
  Batch batch(2);
  batch.close();
  EXPECT_TRUE(batch.wait(0.0).empty());
  EXPECT_TRUE(batch.exhausted());
}

TEST(Batch, RefusesNoThreads) { EXPECT_THROW(Batch(0), InvalidInput); }

}  // namespace
}  // namespace vsr2
