// Contacts that stick, solved at once, against what the rows demand and against the sweeps.

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "contact_sweeps.hpp"
#include "sticking_contacts.hpp"

namespace vsr2 {
namespace {

using Eigen::Vector3d;

constexpr FrictionBounds kBounds{.coefficient = 5.0};
constexpr double kSoftness = 1e-9;
constexpr double kMass = 446.6;

StickingProblem problem_of(const std::vector<Vector3d>& points, const Vector3d& w,
                           const Vector3d& v) {
  StickingProblem problem;
  problem.count = static_cast<int>(points.size());
  problem.mass = kMass;
  problem.inertia = Vector3d(40, 45, 20).asDiagonal();
  problem.softness = kSoftness;
  problem.angular = w;
  problem.linear = v;
  for (std::size_t i = 0; i < points.size(); ++i)
    problem.contacts[i] = {.x = points[i].x(),
                           .y = points[i].y(),
                           .z = points[i].z(),
                           .target = 0.0,
                           .bounds = kBounds,
                           .normal = 1.0};
  return problem;
}

// The rate of spin after `sweeps` sweeps over the same contacts.
double swept_spin(const StickingProblem& at, int sweeps) {
  ContactProblem problem;
  problem.count = at.count;
  const RockResponse rock{1.0 / at.mass, at.inertia.inverse()};
  for (std::size_t i = 0; i < static_cast<std::size_t>(at.count); ++i) {
    const Vector3d r(at.contacts[i].x, at.contacts[i].y, at.contacts[i].z);
    const Vector3d slip = at.linear + at.angular.cross(r);
    ContactRows& rows = problem.rows[i];
    rows.bounds = kBounds;
    rows.normal.fill<Joint::none>(rock, r, {}, -slip.z(), kSoftness);
    rows.spin.fill<Joint::none>(rock, r, {}, -at.angular.z());
    rows.lateral_1.fill<Joint::none>(rock, r, {}, slip.y());
    rows.lateral_2.fill<Joint::none>(rock, r, {}, -slip.x());
  }
  solve(problem, sweeps, 0.0);
  return at.angular.z() + problem.change.angular[2];
}

// A rock that rocks about the line through two contacts. Sweeps turn it about that line, which slopes
// by s: it spins at s times the rate of rocking. What counts as level does not spin, and a line that
// slopes by more is left to the sweeps.
TEST(StickingContacts, LackTheSpinOfAnEdgeThatHardlySlopes) {
  constexpr double height = 0.5, half_length = 0.2, rate = 0.3;
  for (const double uneven : {0.0, 1e-6, 0.99e-4, 1.01e-4, 1e-3}) {
    SCOPED_TRACE(uneven);
    const Vector3d a(half_length, 0.05, -height * (1 - uneven));
    const Vector3d b(-half_length, 0.05, -height * (1 + uneven));
    const Vector3d w(rate, 0, 0);
    const Vector3d v = Vector3d(0.01, 0.02, -0.2) - w.cross(Vector3d(0.5 * (a + b)));
    StickingProblem problem = problem_of({a, b}, w, v);
    const double slope = uneven * height / half_length;
    EXPECT_NEAR(swept_spin(problem, 150), slope * rate, 1e-3 * slope * rate + 1e-15);
    const bool is_level = uneven < 1e-4;
    ASSERT_EQ(solve_sticking(problem), is_level);
    if (!is_level) continue;
    EXPECT_NEAR(problem.angular.z(), 0.0, 1e-15);
    EXPECT_NEAR(problem.angular.x(), 0.0, 1e-6);
  }
}

// No contact pulls, none sinks, and one that is pressed has the velocity that its row demands.
TEST(StickingContacts, MeetTheDemandsOfTheirRows) {
  std::mt19937 generator(1);
  std::uniform_real_distribution<double> within(-1.0, 1.0);
  int opened = 0;
  int swept = 0;
  constexpr int draws = 2000;
  for (int n = 0; n < draws; ++n) {
    std::vector<Vector3d> points;
    for (const double x : {-0.25, 0.25})
      for (const double y : {-0.2, 0.2})
        points.emplace_back(x + 0.02 * within(generator), y + 0.02 * within(generator), -0.5);
    const Vector3d w(0.2 * within(generator), 0.2 * within(generator), 0.0);
    const Vector3d v = Vector3d(0, 0, -0.02) - w.cross(Vector3d(0, 0, -0.5));
    StickingProblem problem = problem_of(points, w, v);
    for (StickingContact& contact : problem.contacts) contact.target = 0.01 * within(generator);
    for (StickingContact& contact : problem.contacts) contact.bounds.coefficient = 1e12;
    if (!solve_sticking(problem)) {
      ++swept;
      continue;
    }
    for (std::size_t i = 0; i < points.size(); ++i) {
      const StickingContact& contact = problem.contacts[i];
      const double speed =
          (v + problem.linear + (w + problem.angular).cross(points[i])).z() - contact.target;
      ASSERT_GE(contact.normal, 0.0);
      opened += contact.normal == 0.0;
      if (contact.normal > 0.0) {
        ASSERT_NEAR(speed, -kSoftness * contact.normal, 1e-12);
      } else {
        ASSERT_GE(speed, -1e-12);
      }
    }
  }
  EXPECT_GT(opened, draws / 10);
  EXPECT_LT(swept, draws / 100);
}

}  // namespace
}  // namespace vsr2
