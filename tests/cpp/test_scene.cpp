#include <limits>

#include <gtest/gtest.h>

#include "scenes.hpp"
#include "vsr2/engines.hpp"

namespace vsr2 {
namespace {

RockSpec good_rock() { return testing::block_scene()->rock(); }
PedestalSpec good_pedestal() { return testing::block_scene()->pedestal(); }

TEST(Scene, RefusesBodiesThatCannotBe) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [](auto change) {
    RockSpec rock = good_rock();
    change(rock);
    EXPECT_THROW(Scene(EngineSettings{}, good_pedestal(), rock), InvalidInput);
  };
  refused([](RockSpec& r) { r.mass = 0; });
  refused([&](RockSpec& r) { r.mass = nan; });
  refused([](RockSpec& r) { r.parts.clear(); });
  refused([](RockSpec& r) { r.principal_inertia = {1, 1, 3}; });
  refused([](RockSpec& r) { r.principal_inertia = {0, 1, 1}; });
  refused([](RockSpec& r) { r.parts = {BoxPart{{1, 0, 1}, {}}}; });
  refused([](RockSpec& r) { r.parts = {HullPart{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}}}; });
  refused([&](RockSpec& r) { r.parts = {HullPart{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, nan}}}}; });
  refused([](RockSpec& r) { r.material["stiffness"] = 0; });
  refused([](RockSpec& r) { r.X_MB.orientation = Eigen::Quaterniond(2, 0, 0, 0); });
  refused([](RockSpec& r) {
    r.parts = {TrianglesPart{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}}};
  });
  EXPECT_NO_THROW(Scene(EngineSettings{}, good_pedestal(), good_rock()));
}

TEST(Scene, RefusesTrianglesOutOfRange) {
  PedestalSpec pedestal = good_pedestal();
  for (const std::int64_t corner : {std::int64_t{-1}, std::int64_t{3}, std::int64_t{1} << 32}) {
    pedestal.parts = {TrianglesPart{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, corner}}}};
    EXPECT_THROW(Scene(EngineSettings{}, pedestal, good_rock()), InvalidInput) << corner;
  }
}

TEST(Scene, BoundingBoxInertiaOfABlockIsTheBlocks) {
  RockSpec rock = good_rock();
  const Eigen::Vector3d expected = rock.principal_inertia;
  rock.inertia_from_aabb = true;
  const Scene scene(EngineSettings{}, good_pedestal(), rock);
  EXPECT_TRUE(scene.rock_inertia().isApprox(expected, 1e-12));
}

TEST(Scene, TriangleSurfaceCarriesTheRockLikeTheBox) {
  PedestalSpec pedestal = good_pedestal();
  pedestal.parts = {TrianglesPart{{{-5, -5, 0.25}, {5, -5, 0.25}, {5, 5, 0.25}, {-5, 5, 0.25}},
                                  {{0, 1, 2}, {0, 2, 3}}}};
  const auto scene = std::make_shared<Scene>(EngineSettings{}, pedestal, testing::hull_scene()->rock());
  auto world = make_bullet_world(scene, Drive::prescribed);
  world->spawn_rock(testing::standing(0.477));
  for (int i = 0; i < 1000; ++i) world->step({0.02 * i * 1e-3, 0.0});
  EXPECT_NEAR(world->rock().p_WB.z(), 2.975, 2.5e-3);
  // Friction carries it along with the moving surface.
  EXPECT_NEAR(world->rock().p_WB.x(), world->pedestal().position, 2e-3);
}

}  // namespace
}  // namespace vsr2
