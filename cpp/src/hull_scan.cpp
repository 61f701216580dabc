#include "hull_scan.hpp"

#include <algorithm>
#include <atomic>
#include <limits>

#include "scene_shapes.hpp"

#if defined(__x86_64__) && defined(__GNUC__)
#define VSR2_HAS_AVX2 1
#include <immintrin.h>
#endif

namespace vsr2 {
namespace {

std::size_t scan_portable(const PointView& points, const Eigen::Vector3d& direction) {
  double best = -std::numeric_limits<double>::infinity();
  std::size_t index = 0;
  for (std::size_t i = 0; i < points.size; ++i) {
    const double product = points.along(i, direction);
    if (product > best) {
      best = product;
      index = i;
    }
  }
  return index;
}

#ifdef VSR2_HAS_AVX2
// Products of four points from the i-th on, summed as the portable scan does.
__attribute__((target("avx2"), always_inline)) inline __m256d products(const PointView& points,
                                                                       std::size_t i, __m256d vx,
                                                                       __m256d vy, __m256d vz) {
  return _mm256_add_pd(_mm256_add_pd(_mm256_mul_pd(_mm256_loadu_pd(points.x + i), vx),
                                     _mm256_mul_pd(_mm256_loadu_pd(points.y + i), vy)),
                       _mm256_mul_pd(_mm256_loadu_pd(points.z + i), vz));
}

// Two passes: the greatest product of each block, then the first point that has it within the first
// best block. No instruction rounds other than those of the portable scan do.
__attribute__((target("avx2"))) std::size_t scan_avx2(const PointView& points,
                                                      const Eigen::Vector3d& direction) {
  const __m256d vx = _mm256_set1_pd(direction.x());
  const __m256d vy = _mm256_set1_pd(direction.y());
  const __m256d vz = _mm256_set1_pd(direction.z());
  constexpr std::size_t block = PointColumns::kBlock;
  double best = -std::numeric_limits<double>::infinity();
  std::size_t best_block = 0;
  for (std::size_t i = 0; i < points.size; i += block) {
    __m256d a = products(points, i, vx, vy, vz);
    __m256d b = products(points, i + 4, vx, vy, vz);
    for (std::size_t k = 8; k < block; k += 8) {
      a = _mm256_max_pd(a, products(points, i + k, vx, vy, vz));
      b = _mm256_max_pd(b, products(points, i + k + 4, vx, vy, vz));
    }
    const __m256d m = _mm256_max_pd(a, b);
    const __m128d half = _mm_max_pd(_mm256_castpd256_pd128(m), _mm256_extractf128_pd(m, 1));
    const double greatest = _mm_cvtsd_f64(_mm_max_sd(half, _mm_unpackhi_pd(half, half)));
    if (greatest > best) {
      best = greatest;
      best_block = i;
    }
  }
  const __m256d goal = _mm256_set1_pd(best);
  for (std::size_t k = 0; k < block; k += 4) {
    const int equal = _mm256_movemask_pd(
        _mm256_cmp_pd(products(points, best_block + k, vx, vy, vz), goal, _CMP_EQ_OQ));
    if (equal != 0)
      return best_block + k + static_cast<std::size_t>(__builtin_ctz(static_cast<unsigned>(equal)));
  }
  return scan_portable(points, direction);  // one that is not a number
}

bool has_avx2() { return __builtin_cpu_supports("avx2") != 0; }
#else
bool has_avx2() { return false; }
#endif

InstructionSet best_set() { return has_avx2() ? InstructionSet::avx2 : InstructionSet::portable; }

std::atomic<InstructionSet>& current_set() {
  static std::atomic<InstructionSet> set{best_set()};
  return set;
}

}  // namespace

PointColumns::PointColumns(const btVector3* points, std::size_t count)
    : count_(count), padded_((count + kBlock - 1) / kBlock * kBlock), columns_(3 * padded_) {
  for (std::size_t i = 0; i < padded_; ++i) {
    // The first point again: it cannot win against itself, being later.
    const btVector3& p = points[i < count ? i : 0];
    columns_[i] = p.x();
    columns_[padded_ + i] = p.y();
    columns_[2 * padded_ + i] = p.z();
  }
}

void set_instruction_set(InstructionSet set) {
  current_set() = set == InstructionSet::portable ? InstructionSet::portable : best_set();
}

InstructionSet instruction_set() { return current_set(); }

std::size_t first_support(const PointView& points, const Eigen::Vector3d& direction) {
#ifdef VSR2_HAS_AVX2
  if (current_set().load(std::memory_order_relaxed) == InstructionSet::avx2)
    return scan_avx2(points, direction);
#endif
  return scan_portable(points, direction);
}

ScannedHull::ScannedHull(const btConvexHullShape& hull)
    : btConvexHullShape(hull),
      columns_(hull.getUnscaledPoints(), static_cast<std::size_t>(hull.getNumPoints())) {
  // With Bullet's own type its algorithms would not ask this class but scan by themselves.
  m_shapeType = CUSTOM_POLYHEDRAL_SHAPE_TYPE;
}

btVector3 ScannedHull::localGetSupportingVertexWithoutMargin(const btVector3& direction) const {
  const btVector3 scaled = direction * m_localScaling;
  const std::size_t index = first_support(columns_.view(), to_eigen(scaled));
  return getUnscaledPoints()[index] * m_localScaling;
}

btCollisionShape* with_scanned_hulls(btCollisionShape* shape,
                                     std::vector<std::unique_ptr<btCollisionShape>>& owned) {
  if (shape->getShapeType() == CONVEX_HULL_SHAPE_PROXYTYPE) {
    owned.push_back(std::make_unique<ScannedHull>(*static_cast<const btConvexHullShape*>(shape)));
    return owned.back().get();
  }
  if (shape->getShapeType() != COMPOUND_SHAPE_PROXYTYPE) return shape;
  const auto* compound = static_cast<const btCompoundShape*>(shape);
  auto copy = std::make_unique<btCompoundShape>();
  for (int i = 0; i < compound->getNumChildShapes(); ++i)
    copy->addChildShape(
        compound->getChildTransform(i),
        with_scanned_hulls(const_cast<btCollisionShape*>(compound->getChildShape(i)), owned));
  owned.push_back(std::move(copy));
  return owned.back().get();
}

}  // namespace vsr2
