#include <gtest/gtest.h>

#include "scenes.hpp"
#include "vsr2/engines.hpp"

namespace vsr2 {
namespace {

std::shared_ptr<const Scene> scene_with(EngineSettings engine) {
  return testing::block_scene({.engine = engine});
}

TEST(Engines, AutomaticTakesTheFastestThatTakesTheScene) {
  EngineSettings engine;
  engine.kind = EngineKind::automatic;
  EXPECT_EQ(choose_engine(*scene_with(engine)), EngineKind::fast);
  engine.cone_friction = false;
  EXPECT_EQ(choose_engine(*scene_with(engine)), EngineKind::exact);
  engine.cone_friction = true;
  engine.kind = EngineKind::parity;
  EXPECT_EQ(choose_engine(*scene_with(engine)), EngineKind::parity);
}

TEST(Engines, FastRefusesWhatItCannotDo) {
  EngineSettings engine;
  engine.kind = EngineKind::fast;
  engine.cone_friction = false;
  try {
    choose_engine(*scene_with(engine));
    FAIL();
  } catch (const InvalidInput& error) {
    EXPECT_EQ(error.fault(), Fault::engine_domain);
  }
}

TEST(Engines, EveryResultSaysWhichEngineRan) {
  const std::atomic<bool> run_on{false};
  for (EngineKind kind :
       {EngineKind::parity, EngineKind::exact, EngineKind::fast, EngineKind::automatic}) {
    EngineSettings engine;
    engine.kind = kind;
    const TrialResult result =
        run_trial(testing::trial_of(scene_with(engine), testing::standing(0.477), testing::cosine(0.01, 1.0)), run_on);
    ASSERT_EQ(result.status, Status::ok) << result.message;
    EXPECT_EQ(result.engine, kind == EngineKind::automatic ? EngineKind::fast : kind);
    EXPECT_EQ(result.handover, Handover::none);
  }
}

TEST(Engines, AHandOverIsInTheResult) {
  const std::atomic<bool> run_on{false};
  EngineSettings engine;
  engine.kind = EngineKind::fast;
  // The rock slides over the edge of the top, at x = 5 m.
  Pose start = testing::standing(0.477);
  start.position.x() = 4.9;
  std::vector<double> x;
  for (int i = 0; i <= 1500; ++i) x.push_back(-0.5 * 9.0 * std::pow(i * 1e-3, 2));
  TrialSpec spec = testing::trial_of(scene_with(engine), start, x);
  const TrialResult result = run_trial(spec, run_on);
  EXPECT_EQ(result.engine, EngineKind::fast);
  EXPECT_EQ(result.handover, Handover::off_the_top);
}

}  // namespace
}  // namespace vsr2
