#pragma once
// A convex hull whose support vertex is found with vector instructions; private to the core.

#include <cstddef>
#include <memory>
#include <vector>

#include <Eigen/Core>
#include <btBulletCollisionCommon.h>

namespace vsr2 {

/// Coordinates of points, padded as in PointColumns.
struct PointView {
  const double* x;
  const double* y;
  const double* z;
  std::size_t size;

  Eigen::Vector3d at(std::size_t i) const { return {x[i], y[i], z[i]}; }
  double along(std::size_t i, const Eigen::Vector3d& direction) const {
    return x[i] * direction.x() + y[i] * direction.y() + z[i] * direction.z();
  }
};

/// Points by coordinate, padded so that blocks are whole.
class PointColumns {
 public:
  static constexpr std::size_t kBlock = 32;
  PointColumns() = default;
  PointColumns(const btVector3* points, std::size_t count);
  PointView view() const {
    const double* x = columns_.data();
    return {x, x + padded_, x + 2 * padded_, count_};
  }

 private:
  std::size_t count_ = 0;
  std::size_t padded_ = 0;
  std::vector<double> columns_;
};

enum class InstructionSet { automatic, portable, avx2 };
/// Which instructions the scan uses from now on; every choice gives the same bits. For tests;
/// `avx2` on a processor without it falls back to `portable`.
void set_instruction_set(InstructionSet set);
/// The set in use: `portable` or `avx2`.
InstructionSet instruction_set();

/// Index of the first point with the greatest x dx + y dy + z dz, summed in this order.
std::size_t first_support(const PointView& points, const Eigen::Vector3d& direction);

/// The same hull for Bullet's algorithms, with the same bits in every answer.
class ScannedHull final : public btConvexHullShape {
 public:
  explicit ScannedHull(const btConvexHullShape& hull);
  btVector3 localGetSupportingVertexWithoutMargin(const btVector3& direction) const override;

 private:
  PointColumns columns_;
};

/// A copy of `shape` with ScannedHull in place of its convex hulls (or `shape` itself where it has
/// none); what is made is appended to `owned`.
btCollisionShape* with_scanned_hulls(btCollisionShape* shape,
                                     std::vector<std::unique_ptr<btCollisionShape>>& owned);

}  // namespace vsr2
