#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "low_vertices.hpp"

namespace vsr2 {
namespace {

using Eigen::Vector3d;

constexpr double kSameHeight = 1e-9;

// Vertices of a ball of radius 1, and of its flat underside if it has one.
std::vector<btVector3> vertices(int round, int level) {
  std::mt19937 random(round + level);
  std::normal_distribution<double> normal;
  std::vector<btVector3> out;
  while (static_cast<int>(out.size()) < round) {
    const Vector3d p = Vector3d(normal(random), normal(random), normal(random)).normalized();
    if (level == 0 || p.z() > -0.8) out.emplace_back(p.x(), p.y(), p.z());
  }
  for (int i = 0; i < level; ++i) {
    const double angle = 2 * M_PI * i / level;
    out.emplace_back(0.6 * std::cos(angle), 0.6 * std::sin(angle), -0.8);
  }
  return out;
}

// Turns that creep, rock and jump.
TEST(LowVertices, AreThoseOfASearchAmongAll) {
  for (const auto& [round, level] : {std::pair{20, 0}, {200, 0}, {5000, 0}, {600, 60}, {900, 500}, {200, 2000}}) {
    SCOPED_TRACE(std::to_string(round) + " and " + std::to_string(level));
    const std::vector<btVector3> points = vertices(round, level);
    const PointColumns columns(points.data(), points.size());
    const PointView all = columns.view();
    LowVertices low(all, 1.0);
    std::mt19937 random(1);
    std::normal_distribution<double> normal;
    Vector3d up = Vector3d::UnitZ();
    for (int step = 0; step < 3000; ++step) {
      const double size = step % 500 == 0 ? 1.0 : step % 2000 < 1000 ? 1e-4 : 2e-2;
      if (step % 700 < 5) up = Vector3d::UnitZ();  // on its level side
      else up = (up + size * Vector3d(normal(random), normal(random), normal(random))).normalized();
      if (step == 1234) low.clear();
      const std::size_t found = low.lowest(up);
      ASSERT_EQ(found, first_support(all, -up)) << step;
      int as_low = 0;
      for (std::size_t i = 0; i < all.size; ++i)
        as_low += all.along(i, up) <= all.along(found, up) + kSameHeight;
      ASSERT_EQ(low.is_alone(found, up, kSameHeight), as_low == 1) << step;
    }
  }
}

TEST(LowVertices, CopiesGoOnAlone) {
  const std::vector<btVector3> points = vertices(5000, 0);
  const PointColumns columns(points.data(), points.size());
  LowVertices one(columns.view(), 1.0);
  const Vector3d up = Vector3d::UnitZ();
  one.lowest(up);
  LowVertices other = one;
  const Vector3d turned = Vector3d(0.5, 0, 1).normalized();
  EXPECT_EQ(other.lowest(turned), first_support(columns.view(), -turned));
  EXPECT_EQ(one.lowest(up), first_support(columns.view(), -up));
}

}  // namespace
}  // namespace vsr2
