#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "allocation_count.hpp"
#include "engine_scenes.hpp"
#include "scene_shapes.hpp"
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
  refused([](RockSpec& r) { r.parts = {HullPart({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}})}; });
  refused([&](RockSpec& r) { r.parts = {HullPart({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, nan}})}; });
  refused([](RockSpec& r) { r.material["stiffness"] = 0; });
  refused([](RockSpec& r) { r.X_MB.orientation = Eigen::Quaterniond(2, 0, 0, 0); });
  refused([](RockSpec& r) {
    r.parts = {TrianglesPart{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}}};
  });
  EXPECT_NO_THROW(Scene(EngineSettings{}, good_pedestal(), good_rock()));
}

TEST(Scene, ReducesTheHullOfAPartOnce) {
  const std::vector<Eigen::Vector3d> points = test::ellipsoid().points();
  RockSpec rock = testing::hull_scene()->rock();
  EngineSettings engine;
  const auto built = [&](const HullPart& part, double margin) {
    rock.parts = {part};
    engine.collision_margin = margin;
    return std::make_shared<const Scene>(engine, good_pedestal(), rock);
  };
  const HullPart common(points);
  test::count_bullet_allocations();
  const auto allocations = [](auto act) {
    const long begin = test::allocation_count();
    act();
    return test::allocation_count() - begin;
  };
  const auto shape = [&] { HullPart(common).reduction().shape(1e-3, "rock"); };
  const long first = allocations(shape);
  EXPECT_LT(allocations(shape), first / 10);
  // Another margin, which the shape's box depends on, and back.
  const auto again = built(common, 1e-3);
  for (const auto& [margin, kept] : {std::pair{1e-3, again}, {2e-3, built(common, 2e-3)}}) {
    const auto fresh = built(HullPart(points), margin);
    EXPECT_EQ(kept->rock_hull_vertices(), fresh->rock_hull_vertices()) << margin;
    btVector3 box[4];
    kept->shapes().rock->getAabb(btTransform::getIdentity(), box[0], box[1]);
    fresh->shapes().rock->getAabb(btTransform::getIdentity(), box[2], box[3]);
    EXPECT_TRUE(box[0] == box[2] && box[1] == box[3]) << margin;
  }
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
