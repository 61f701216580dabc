// A table within its limits follows its command; beyond, it runs at the limit and comes back.

#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "vsr2/limited_table.hpp"

namespace vsr2 {
namespace {

constexpr double kStep = 1e-3;
constexpr double kRate = 20.0;  // of the loop [rad/s]

struct Path {
  std::vector<double> x, v, a;
};

/// A command that slides from rest under a constant acceleration, then stops at once and stays.
Path pushed(double acceleration, int moving, int resting) {
  Path path;
  double place = 0.0, speed = 0.0;
  for (int i = 0; i < moving + resting; ++i) {
    const double next = i < moving ? speed + acceleration * kStep : 0.0;
    place += 0.5 * (speed + next) * kStep;
    path.x.push_back(place);
    path.v.push_back(next);
    path.a.push_back((next - speed) / kStep);
    speed = next;
  }
  return path;
}

Path limited(Path path, double speed, double acceleration) {
  const TableLimits limits{speed, acceleration, kRate * kRate, 2 * kRate, kStep};
  follow_within_limits(limits, 0.0, 0.0, path.x.size(), path.x.data(), path.v.data(), path.a.data());
  return path;
}

TEST(LimitedTable, FollowsACommandWithinItsLimits) {
  const Path command = pushed(2.0, 500, 0);
  const Path table = limited(command, 10.0, 10.0);
  for (std::size_t i = 0; i < command.x.size(); ++i)
    EXPECT_NEAR(table.x[i], command.x[i], 2 * kStep * kStep);  // the command's own sum of trapezia
}

TEST(LimitedTable, StaysWithinItsLimits) {
  const Path table = limited(pushed(8.0, 200, 500), 0.5, 3.0);
  double greatest_speed = 0.0, greatest_push = 0.0;
  for (std::size_t i = 0; i < table.v.size(); ++i) {
    greatest_speed = std::max(greatest_speed, std::abs(table.v[i]));
    greatest_push = std::max(greatest_push, std::abs(table.a[i]));
  }
  EXPECT_DOUBLE_EQ(greatest_speed, 0.5);
  EXPECT_NEAR(greatest_push, 3.0, 1e-9);
}

TEST(LimitedTable, ComesBackToItsCommand) {
  const Path command = pushed(8.0, 200, 3000);
  const Path table = limited(command, 0.5, 3.0);
  EXPECT_GT(std::abs(table.x[200] - command.x[200]), 0.01);
  EXPECT_NEAR(table.x.back(), command.x.back(), 1e-6);
  EXPECT_NEAR(table.v.back(), 0.0, 1e-6);
}

}  // namespace
}  // namespace vsr2
