#pragma once
// A convex hull whose support vertex is found with vector instructions; private to the core.

#include <cstddef>
#include <memory>
#include <vector>

#include <btBulletCollisionCommon.h>

namespace vsr2 {

/// Points by coordinate, padded so that blocks are whole.
class PointColumns {
 public:
  static constexpr std::size_t kBlock = 32;
  PointColumns() = default;
  PointColumns(const btVector3* points, std::size_t count);
  std::size_t size() const { return count_; }
  const double* x() const { return columns_.data(); }
  const double* y() const { return columns_.data() + padded_; }
  const double* z() const { return columns_.data() + 2 * padded_; }

 private:
  std::size_t count_ = 0;
  std::size_t padded_ = 0;
  std::vector<double> columns_;
};

/// Coordinates of points elsewhere, padded as in PointColumns.
struct PointView {
  const double* x;
  const double* y;
  const double* z;
  std::size_t size;
};

enum class InstructionSet { automatic, portable, avx2 };
/// Which instructions the scan uses from now on; every choice gives the same bits. For tests;
/// `avx2` on a processor without it falls back to `portable`.
void set_instruction_set(InstructionSet set);
/// The set in use: `portable` or `avx2`.
InstructionSet instruction_set();

/// Index of the first point with the greatest x dx + y dy + z dz, summed in this order.
std::size_t first_support(const PointView& points, double dx, double dy, double dz);
inline std::size_t first_support(const PointColumns& points, double dx, double dy, double dz) {
  return first_support(PointView{points.x(), points.y(), points.z(), points.size()}, dx, dy, dz);
}

/// The same hull for Bullet's algorithms, with the same bits in every answer.
class ScannedHull final : public btConvexHullShape {
 public:
  explicit ScannedHull(const btConvexHullShape& hull);
  btVector3 localGetSupportingVertexWithoutMargin(const btVector3& direction) const override;
  const PointColumns& columns() const { return columns_; }

 private:
  PointColumns columns_;
};

/// A copy of `shape` with ScannedHull in place of its convex hulls (or `shape` itself where it has
/// none); what is made is appended to `owned`.
btCollisionShape* with_scanned_hulls(btCollisionShape* shape,
                                     std::vector<std::unique_ptr<btCollisionShape>>& owned);

}  // namespace vsr2
