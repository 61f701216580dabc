#pragma once
// Bullet's classes with what a world here needs of them; private to the core.

#include <algorithm>
#include <functional>
#include <memory>
#include <mutex>
#include <tuple>
#include <vector>

#include <btBulletDynamicsCommon.h>
#include <BulletCollision/CollisionDispatch/btInternalEdgeUtility.h>
#include <BulletDynamics/Featherstone/btMultiBodyDynamicsWorld.h>
#include <BulletDynamics/Featherstone/btMultiBodyLinkCollider.h>

#include "vsr2/scene.hpp"

namespace vsr2 {

// Bullet takes the relative contact breaking threshold from a process-wide variable; this keeps it
// a property of the world. As there, the smaller of the two shapes' thresholds counts.
class Dispatcher final : public btCollisionDispatcher {
 public:
  Dispatcher(btCollisionConfiguration* configuration, double relative_threshold)
      : btCollisionDispatcher(configuration), relative_threshold_(relative_threshold) {}
  btPersistentManifold* getNewManifold(const btCollisionObject* a, const btCollisionObject* b) override {
    btPersistentManifold* manifold = btCollisionDispatcher::getNewManifold(a, b);
    manifold->setContactBreakingThreshold(
        std::min(a->getCollisionShape()->getContactBreakingThreshold(relative_threshold_),
                 b->getCollisionShape()->getContactBreakingThreshold(relative_threshold_)));
    return manifold;
  }

 private:
  double relative_threshold_;
};

// Bullet's deterministic order of pairs with an array that is kept: Bullet's own allocates one in
// every step.
class PairCache final : public btHashedOverlappingPairCache {
 public:
  using btHashedOverlappingPairCache::processAllOverlappingPairs;
  void processAllOverlappingPairs(btOverlapCallback* callback, btDispatcher* dispatcher,
                                  const btDispatcherInfo& info) override {
    if (!info.m_deterministicOverlappingPairs)
      return btHashedOverlappingPairCache::processAllOverlappingPairs(callback, dispatcher);
    btBroadphasePairArray& pairs = getOverlappingPairArray();
    order_.clear();
    for (int i = 0; i < pairs.size(); ++i)
      order_.push_back({pairs[i].m_pProxy0->m_uniqueId, pairs[i].m_pProxy1->m_uniqueId, i});
    std::sort(order_.begin(), order_.end(), std::greater<>());
    // No callback of a world here asks for a pair to be removed, so indices stay valid.
    for (const auto& entry : order_) callback->processOverlap(pairs[std::get<2>(entry)]);
  }

 private:
  std::vector<std::tuple<int, int, int>> order_;
};

// Turns the normals of contacts at inner edges of a triangle surface to those of its faces. Without
// it a rock on topography is pushed about and never rests.
inline bool correct_edge_normal(btManifoldPoint& point, const btCollisionObjectWrapper* a, int part_a,
                         int index_a, const btCollisionObjectWrapper* b, int part_b, int index_b) {
  btAdjustInternalEdgeContacts(point, b, a, part_b, index_b);
  btAdjustInternalEdgeContacts(point, a, b, part_a, index_a);
  return false;
}

// Bullet's hook is process-wide; it acts on flagged bodies only.
inline void install_contact_hook() {
  static std::once_flag once;
  std::call_once(once, [] { gContactAddedCallback = correct_edge_normal; });
}

inline btDefaultCollisionConstructionInfo small_pools() {
  // A world has a handful of pairs; Bullet's default pools take 9 MB.
  btDefaultCollisionConstructionInfo info;
  info.m_defaultMaxPersistentManifoldPoolSize = 16;
  info.m_defaultMaxCollisionAlgorithmPoolSize = 16;
  return info;
}

// Bullet's world with a place between collision detection and solution.
class DynamicsWorld final : public btMultiBodyDynamicsWorld {
 public:
  using btMultiBodyDynamicsWorld::btMultiBodyDynamicsWorld;
  std::function<void()> before_solution;

  void solveConstraints(btContactSolverInfo& info) override {
    if (before_solution) before_solution();
    btMultiBodyDynamicsWorld::solveConstraints(info);
  }
};

struct Body {
  std::unique_ptr<btMultiBody> multibody;
  std::vector<std::unique_ptr<btMultiBodyLinkCollider>> colliders;
};

inline btMultiBodyLinkCollider& add_collider(Body& body, int link, btCollisionShape* shape) {
  auto collider = std::make_unique<btMultiBodyLinkCollider>(body.multibody.get(), link);
  collider->setCollisionShape(shape);
  if (link < 0) {
    body.multibody->setBaseCollider(collider.get());
  } else {
    body.multibody->getLink(link).m_collider = collider.get();
  }
  body.colliders.push_back(std::move(collider));
  return *body.colliders.back();
}

/// A contact parameter that Bullet has: as a property of a body, and of a pair at a contact point. One that
/// it has not acts on these through the laws of contact_laws.hpp.
struct BulletParameter {
  ContactKey key;
  void (*set)(btCollisionObject&, double);
  btScalar btManifoldPoint::* combined = nullptr;  ///< null: it acts through the bodies alone
};
inline constexpr BulletParameter kBulletParameters[] = {
    {"restitution", [](btCollisionObject& body, double value) { body.setRestitution(value); },
     &btManifoldPoint::m_combinedRestitution},
    {"lateral_friction", [](btCollisionObject& body, double value) { body.setFriction(value); },
     &btManifoldPoint::m_combinedFriction},
    {"spinning_friction", [](btCollisionObject& body, double value) { body.setSpinningFriction(value); },
     &btManifoldPoint::m_combinedSpinningFriction},
    {"rolling_friction", [](btCollisionObject& body, double value) { body.setRollingFriction(value); },
     &btManifoldPoint::m_combinedRollingFriction},
    {"stiffness",
     [](btCollisionObject& body, double value) {
       body.setContactStiffnessAndDamping(value, body.getContactDamping());
     },
     &btManifoldPoint::m_combinedContactStiffness1},
    {"damping",
     [](btCollisionObject& body, double value) {
       body.setContactStiffnessAndDamping(body.getContactStiffness(), value);
     },
     &btManifoldPoint::m_combinedContactDamping1},
};

inline void set_material(btCollisionObject& object, const ContactValues& material) {
  for (const BulletParameter& one : kBulletParameters) one.set(object, material[one.key]);
}

inline void put_pair(btManifoldPoint& point, const ContactValues& pair) {
  for (const BulletParameter& one : kBulletParameters)
    if (one.combined) point.*one.combined = pair[one.key];
}

// `pair` with the values of a contact point.
inline ContactValues pair_at(const btManifoldPoint& point, ContactValues pair) {
  for (const BulletParameter& one : kBulletParameters)
    if (one.combined) pair[one.key] = point.*one.combined;
  return pair;
}

}  // namespace vsr2
