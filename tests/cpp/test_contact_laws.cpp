// The laws of a contact against closed forms, and that Bullet's own values of a pair are theirs.

#include <cmath>
#include <random>

#include <BulletCollision/CollisionDispatch/btManifoldResult.h>
#include <gtest/gtest.h>

#include "bullet_parts.hpp"
#include "contact_laws.hpp"
#include "engine_scenes.hpp"
#include "foothold.hpp"
#include "scenes.hpp"

namespace vsr2 {
namespace {

const ContactValues kPair = combine({}, {});

TEST(NormalLaw, IsAnImplicitStepOfASpringWithADamper) {
  const auto law = NormalLaw::of(kPair);
  const double m = 350.0, dt = 1e-3, penetration = 2e-4;
  const double k = kPair["stiffness"], c = kPair["damping"];
  // A mass that rests on it, pressed in by `penetration`: m u = dt (k (penetration - dt u) - c u).
  const double u = dt * k * penetration / (m + dt * (c + dt * k));
  // As a row: u + softness lambda = erp penetration / dt with lambda = m u.
  EXPECT_NEAR(u + law.softness(dt) * m * u, law.erp(dt) * penetration / dt, 1e-12 * u);
}

TEST(NormalLaw, ReboundsFromAThresholdOn) {
  const auto law = NormalLaw::of(kPair);
  EXPECT_EQ(law.rebound(-0.1999, 0.2), 0.0);
  EXPECT_EQ(law.rebound(-0.2, 0.2), 0.2 * kPair["restitution"]);
  EXPECT_EQ(law.rebound(0.5, 0.2), 0.0) << "the rock goes away";
}

TEST(ContactLaws, LeaveAPairAsItIsButForItsFriction) {
  EXPECT_EQ(in_force(kPair, 1.0).all, kPair.all);
  ContactValues slippery = kPair;
  slippery["lateral_friction"] *= 0.3;
  EXPECT_EQ(in_force(kPair, 0.3).all, slippery.all);
}

// Worlds put the values in force over those that Bullet makes of two materials, so that a law acts in
// every engine. Bits of `parity` are PyBullet's only where both are the same.
TEST(ContactLaws, TakeAPairsValuesAsBulletMakesThem) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> exponent(-3.0, 1.5);
  for (int i = 0; i < 20000; ++i) {
    ContactValues material[2];
    btCollisionObject body[2];
    for (int k = 0; k < 2; ++k) {
      for (double& value : material[k].all) value = std::pow(10.0, exponent(random));
      set_material(body[k], material[k]);
    }
    using Bullet = btManifoldResult;
    btManifoldPoint point;
    point.m_combinedFriction = Bullet::calculateCombinedFriction(&body[0], &body[1]);
    point.m_combinedRestitution = Bullet::calculateCombinedRestitution(&body[0], &body[1]);
    point.m_combinedRollingFriction = Bullet::calculateCombinedRollingFriction(&body[0], &body[1]);
    point.m_combinedSpinningFriction = Bullet::calculateCombinedSpinningFriction(&body[0], &body[1]);
    point.m_combinedContactStiffness1 = Bullet::calculateCombinedContactStiffness(&body[0], &body[1]);
    point.m_combinedContactDamping1 = Bullet::calculateCombinedContactDamping(&body[0], &body[1]);
    const ContactValues pair = combine(material[0], material[1]);
    for (std::size_t j = 0; j < pair.all.size(); ++j)
      ASSERT_EQ(pair_at(point, ContactValues{}).all[j], pair.all[j]) << kContactParameters[j].name;
    put_pair(point, kPair);
    ASSERT_EQ(pair_at(point, ContactValues{}).all, kPair.all);
  }
}

// What a contact tells is what the solver used, whatever the engine.
TEST(ContactLaws, AreInForceAtTheContactsOfEveryEngine) {
  Mechanisms sticky;
  sticky.friction_ratio = 1.5;
  const auto scene = std::make_shared<Scene>(EngineSettings{}, test::pedestal(), test::rock(test::RockKind::box),
                                             sticky);
  const ContactValues pair = combine(scene->rock().material, scene->pedestal().material);
  for (const test::Engine engine : test::kEngines) {
    const auto world = test::make(engine, scene, Drive::prescribed);
    world->spawn_rock(test::start(test::RockKind::box));
    for (int i = 0; i < 300; ++i) world->step({});
    std::vector<ContactPoint> contacts;
    world->contacts(contacts);
    ASSERT_EQ(contacts.size(), 4U);
    for (const ContactPoint& contact : contacts) {
      EXPECT_NEAR(contact.pair["lateral_friction"] / pair["lateral_friction"], sticky.friction_ratio, 1e-4)
          << "at rest";
      ContactValues expected = pair;
      expected["lateral_friction"] = contact.pair["lateral_friction"];
      EXPECT_EQ(contact.pair.all, expected.all);
    }
    Foothold foothold;
    if (!world->foothold(foothold)) continue;
    EXPECT_EQ(foothold.normal.stiffness, pair["stiffness"]);
    EXPECT_EQ(foothold.normal.damping, pair["damping"]);
    EXPECT_EQ(foothold.friction.coefficient, pair["lateral_friction"]) << "the least there is";
  }
}

}  // namespace
}  // namespace vsr2
