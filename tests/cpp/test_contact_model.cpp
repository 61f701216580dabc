#include <gtest/gtest.h>

#include "scenes.hpp"
#include "vsr2/contact_model.hpp"
#include "vsr2/engines.hpp"

namespace vsr2 {
namespace {

// Bullet leaves this much penetration uncorrected [m].
constexpr double kLinearSlop = 1e-5;

TEST(ContactModel, TableS1FollowsFromTheBodyLevelInputs) {
  const ContactValues pair = combine({}, {});
  EXPECT_NEAR(pair["restitution"], 0.1225, 1e-12);
  EXPECT_NEAR(pair["lateral_friction"], 0.49, 1e-12);
  EXPECT_NEAR(pair["spinning_friction"], 0.70, 1e-12);
  EXPECT_DOUBLE_EQ(pair["damping"], 2.0e7);
  EXPECT_NEAR(pair["stiffness"], 1.3e9, 1e-3);
}

TEST(ContactModel, PairsDoNotDependOnTheOrder) {
  const ContactValues a = testing::material({{"restitution", 0.2},
                                             {"lateral_friction", 0.3},
                                             {"spinning_friction", 0.4},
                                             {"stiffness", 1e6},
                                             {"damping", 10.0}});
  const ContactValues b = testing::material({{"restitution", 0.5},
                                             {"lateral_friction", 0.6},
                                             {"spinning_friction", 0.7},
                                             {"stiffness", 3e6},
                                             {"damping", 20.0}});
  EXPECT_DOUBLE_EQ(combine(a, b)["spinning_friction"], combine(b, a)["spinning_friction"]);
  EXPECT_DOUBLE_EQ(combine(a, b)["spinning_friction"], 0.4 * 0.6 + 0.7 * 0.3);
  EXPECT_NEAR(combine(a, b)["stiffness"], 0.75e6, 1e-6);
}

TEST(ContactModel, RunningContactUsesTheEffectivePair) {
  const auto scene = testing::block_scene(
      {.material = testing::material({{"restitution", 0.2},
                                      {"lateral_friction", 0.6},
                                      {"spinning_friction", 0.3},
                                      {"stiffness", 4e8},
                                      {"damping", 5e6}})});
  auto world = make_bullet_world(scene, Drive::prescribed);
  world->spawn_rock(testing::standing(0.4752));
  for (int i = 0; i < 300; ++i) world->step({});
  std::vector<ContactPoint> contacts;
  world->contacts(contacts);
  ASSERT_EQ(contacts.size(), 4U);
  const ContactValues expected = combine(scene->rock().material, scene->pedestal().material);
  double sum = 0.0;
  for (const ContactPoint& c : contacts) {
    EXPECT_DOUBLE_EQ(c.pair["lateral_friction"], expected["lateral_friction"]);
    EXPECT_DOUBLE_EQ(c.pair["restitution"], expected["restitution"]);
    EXPECT_DOUBLE_EQ(c.pair["spinning_friction"], expected["spinning_friction"]);
    EXPECT_DOUBLE_EQ(c.pair["damping"], expected["damping"]);
    // Bullet sums inverses, so the last digits may differ.
    EXPECT_NEAR(c.pair["stiffness"] / expected["stiffness"], 1.0, 1e-12);
    EXPECT_NEAR(c.normal_W.z(), 1.0, 1e-9);
    sum += c.normal_impulse;
  }
  // At rest the normal impulses of a step carry the weight.
  EXPECT_NEAR(sum / (scene->rock().mass * 9.81 * 1e-3), 1.0, 1e-6);
}

TEST(ContactModel, FirstImpactFollowsTheImpulseFormula) {
  // A block that lands on one corner is the isolated contact of S2.2.
  testing::BlockOptions options;
  options.engine.gravity = 0.0;
  options.engine.linear_damping = 0.0;
  options.engine.angular_damping = 0.0;
  options.material = testing::material({{"restitution", 0.9},
                                        {"lateral_friction", 0.0},
                                        {"spinning_friction", 0.0},
                                        {"stiffness", 1e9}});
  const auto scene = testing::block_scene(options);
  const Eigen::Quaterniond q(Eigen::AngleAxisd(0.6, Eigen::Vector3d(1, 0.7, 0).normalized()));
  double lowest = 0.0;
  for (const Eigen::Vector3d& v : scene->rock_hull_vertices()) lowest = std::min(lowest, (q * v).z());
  auto world = make_bullet_world(scene, Drive::prescribed);
  // The lowest corner ends 1e-4 m inside the pedestal, so that a contact exists in this step.
  const Eigen::Vector3d centre(0, 0, 2.5 - lowest - 1e-4);
  world->spawn_rock({centre, q});
  const double u = -1.0;
  world->set_rock_velocity({0, 0, u}, {0, 0, 0});
  world->step({});
  std::vector<ContactPoint> contacts;
  world->contacts(contacts);
  ASSERT_EQ(contacts.size(), 1U);
  const ContactValues pair = combine(options.material, options.material);
  // Softness cfm = 1 / (dt k + c) and erp = dt k / (dt k + c); impulse
  // (rebound - u + erp p / dt) / (K_n + cfm / dt) for a penetration p. Remarks on the supplement's
  // print: its p is Bullet's signed distance, hence its minus sign, and Bullet divides cfm by dt.
  const double dt = 1e-3;
  const double cfm = 1 / (dt * pair["stiffness"] + pair["damping"]);
  const double erp = dt * pair["stiffness"] * cfm;
  const Eigen::Matrix3d inverse_inertia =
      q.toRotationMatrix() * scene->rock_inertia().cwiseInverse().asDiagonal() * q.toRotationMatrix().transpose();
  const Eigen::Vector3d arm = contacts[0].p_W_rock - centre;
  const Eigen::Vector3d lever = arm.cross(Eigen::Vector3d::UnitZ());
  const double K = 1 / scene->rock().mass + lever.dot(inverse_inertia * lever);
  const double impulse =
      (-pair["restitution"] * u - u + erp * (-contacts[0].distance - kLinearSlop) / dt) / (K + cfm / dt);
  EXPECT_NEAR(contacts[0].distance, -1e-4, 1e-6);
  EXPECT_NEAR(contacts[0].normal_impulse / impulse, 1.0, 1e-9);
  EXPECT_NEAR(world->rock().v_WB.z(), u + contacts[0].normal_impulse / scene->rock().mass, 1e-9);
}

}  // namespace
}  // namespace vsr2
