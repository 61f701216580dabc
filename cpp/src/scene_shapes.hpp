#pragma once
// Bullet collision shapes of a scene; private to the core.

#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include <btBulletCollisionCommon.h>
#include <BulletCollision/CollisionShapes/btTriangleInfoMap.h>

#include "vsr2/scene.hpp"

namespace vsr2 {

struct FastModel;

/// The shape that Bullet makes of a hull's points, kept for the latest collision margin.
struct HullPart::Reduction {
  explicit Reduction(std::vector<Eigen::Vector3d> given) : points(std::move(given)) {}
  /// A copy of the shape; its box is that of all points, as in PyBullet.
  /// @throws InvalidInput for points that span no hull; `what` they belong to.
  std::unique_ptr<btConvexHullShape> shape(double margin, const std::string& what);

  const std::vector<Eigen::Vector3d> points;

 private:
  std::mutex mutex_;
  std::unique_ptr<const btConvexHullShape> kept_;
};

struct Scene::Shapes {
  // Owned pieces, in the order of construction; the roots below point into them.
  std::vector<std::unique_ptr<btTriangleMesh>> triangle_meshes;
  std::vector<std::unique_ptr<btTriangleInfoMap>> triangle_edges;
  std::vector<std::unique_ptr<btCollisionShape>> owned;
  std::unique_ptr<btCollisionShape> ground;
  std::unique_ptr<btCollisionShape> base;
  btCollisionShape* pedestal = nullptr;
  btCollisionShape* rock = nullptr;
  btCollisionShape* scanned_rock = nullptr;  ///< the same rock with ScannedHull for its hulls
  std::shared_ptr<const FastModel> fast_model;  ///< null outside the fast engine's domain
  btVector3 pedestal_inertia{0, 0, 0};
  btVector3 rock_inertia{0, 0, 0};
};

inline btVector3 to_bullet(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }
inline btQuaternion to_bullet(const Eigen::Quaterniond& q) { return {q.x(), q.y(), q.z(), q.w()}; }
inline btTransform to_bullet(const Pose& X) { return btTransform(to_bullet(X.orientation), to_bullet(X.position)); }
inline Eigen::Vector3d to_eigen(const btVector3& v) { return {v.x(), v.y(), v.z()}; }
inline Eigen::Quaterniond to_eigen(const btQuaternion& q) { return {q.w(), q.x(), q.y(), q.z()}; }

}  // namespace vsr2
