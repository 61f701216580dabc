#include "exact_solver.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace vsr2 {
namespace {

using Row = ExactSolver::Row;
using System = ExactSolver::System;

// A row's Jacobian on horizontal ground has three entries (one for spinning); products with its
// zeros add nothing, so leaving them out keeps every bit.
enum class Kind { normal, lateral_1, lateral_2, spinning };

constexpr int kEntries[4][3] = {{0, 1, 5}, {0, 2, 4}, {1, 2, 3}, {2, 2, 2}};

template <bool kFlat, Kind kKind>
inline double free_speed(const Row& row, const double* v) {
  if constexpr (kFlat && kKind == Kind::spinning) {
    return 0.0 + row.j[2] * v[2];
  } else if constexpr (kFlat) {
    constexpr const int* e = kEntries[static_cast<int>(kKind)];
    return ((0.0 + row.j[e[0]] * v[e[0]]) + row.j[e[1]] * v[e[1]]) + row.j[e[2]] * v[e[2]];
  } else {
    double sum = 0.0;
    for (int i = 0; i < 6; ++i) sum += row.j[i] * v[i];
    return sum;
  }
}

template <bool kFlat, Kind kKind>
inline double unclamped_change(const Row& row, const double* v, const double* vs) {
  const double base = row.rhs - row.applied * row.cfm;
  // On a pedestal that moves along x the slider has one joint.
  double slider = 0.0 + row.js * vs[0];
  if constexpr (!kFlat)
    for (int i = 1; i < ExactSolver::kJoints; ++i) slider += row.js_more[i - 1] * vs[i];
  const double free = free_speed<kFlat, kKind>(row, v);
  // Bullet subtracts the first body's part first.
  if (row.free_is_a) return (base - free * row.inverse) - slider * row.inverse;
  return (base - slider * row.inverse) - free * row.inverse;
}

template <bool kFlat>
inline void apply(const Row& row, double impulse, double* v, double* vs) {
  for (int i = 0; i < 6; ++i) v[i] += row.d[i] * impulse;
  vs[0] += row.ds * impulse;
  if constexpr (!kFlat)
    for (int i = 1; i < ExactSolver::kJoints; ++i) vs[i] += row.ds_more[i - 1] * impulse;
}

// Adds to the impulse applied, within bounds; `row.change` is what was added.
inline void accumulate(Row& row, double change, double lower, double upper) {
  const double sum = row.applied + change;
  if (sum < lower) {
    change = lower - row.applied;
    row.applied = lower;
  } else if (sum > upper) {
    change = upper - row.applied;
    row.applied = upper;
  } else {
    row.applied = sum;
  }
  row.change = change;
}

template <bool kFlat, Kind kKind>
inline void solve_row(Row& row, double* v, double* vs) {
  accumulate(row, unclamped_change<kFlat, kKind>(row, v, vs), row.lower, row.upper);
  apply<kFlat>(row, row.change, v, vs);
}

// Two friction rows within a circle, as Bullet clips them.
template <bool kFlat>
inline void solve_pair(Row& a, Row& b, double total, double* v, double* vs) {
  a.lower = -(a.friction * total);
  b.lower = -(b.friction * total);
  const double change_b = unclamped_change<kFlat, Kind::lateral_2>(b, v, vs);
  const double sum_b = b.applied + change_b;
  const double change_a = unclamped_change<kFlat, Kind::lateral_1>(a, v, vs);
  const double sum_a = a.applied + change_a;
  if (sum_a * sum_a + sum_b * sum_b >= a.lower * b.lower) {
    double limit_a = 0.0;
    double limit_b = 0.0;
    // Without a normal impulse both limits are 0 at any angle.
    if (a.lower != 0.0 || b.lower != 0.0) {
      const double angle = std::atan2(sum_a, sum_b);
      limit_a = std::fabs(a.lower * std::sin(angle));
      limit_b = std::fabs(b.lower * std::cos(angle));
    }
    accumulate(a, change_a, -limit_a, limit_a);
    accumulate(b, change_b, -limit_b, limit_b);
  } else {
    a.applied = sum_a;
    a.change = change_a;
    b.applied = sum_b;
    b.change = change_b;
  }
  apply<kFlat>(a, a.change, v, vs);
  apply<kFlat>(b, b.change, v, vs);
}

template <bool kFlat>
void run_iteration(System& s) {
  double v[6];
  std::copy(s.v, s.v + 6, v);
  double vs[ExactSolver::kJoints];
  std::copy(s.vs, s.vs + ExactSolver::kJoints, vs);
  for (Row& row : s.motor) {
    // Bullet takes the slider as both bodies of its motor; the second has a Jacobian of zeros.
    const double change =
        (row.rhs - row.applied * row.cfm) - (0.0 + row.js * vs[0]) * row.inverse;
    accumulate(row, change, row.lower, row.upper);
    vs[0] += row.ds * row.change;
  }
  for (Row& row : s.normals) solve_row<kFlat, Kind::normal>(row, v, vs);
  for (Row& row : s.spinning) {
    const double total = s.normals[row.normal].applied;
    row.change = 0.0;
    if (!(total > 0.0)) continue;
    row.lower = -(row.friction * total);
    row.upper = row.friction * total;
    solve_row<kFlat, Kind::spinning>(row, v, vs);
  }
  for (std::size_t i = 0; i + 1 < s.rolling.size(); i += 2) {
    const double total = s.normals[s.rolling[i].normal].applied;
    s.rolling[i].change = s.rolling[i + 1].change = 0.0;
    // A rolling row's Jacobian has other entries than a lateral one's.
    if (total > 0.0) solve_pair<false>(s.rolling[i], s.rolling[i + 1], total, v, vs);
  }
  for (std::size_t i = 0; i + 1 < s.friction.size(); i += 2)
    solve_pair<kFlat>(s.friction[i], s.friction[i + 1],
                              s.normals[s.friction[i].normal].applied, v, vs);
  std::copy(v, v + 6, s.v);
  std::copy(vs, vs + ExactSolver::kJoints, s.vs);
}

// Whether no row has more entries than kEntries, and the slider no more joints than one.
bool is_flat(const System& s) {
  bool flat = s.joints <= 1;
  const auto look = [&](const std::vector<Row>& rows, auto kind) {
    for (std::size_t r = 0; r < rows.size(); ++r) {
      const int* e = kEntries[static_cast<int>(kind(r))];
      for (int i = 0; i < 6; ++i)
        if (i != e[0] && i != e[1] && i != e[2] && rows[r].j[i] != 0.0) flat = false;
    }
  };
  look(s.normals, [](std::size_t) { return Kind::normal; });
  look(s.spinning, [](std::size_t) { return Kind::spinning; });
  look(s.friction, [](std::size_t r) { return r % 2 == 0 ? Kind::lateral_1 : Kind::lateral_2; });
  return flat;
}

// Bullet's measure of the latest iteration: the greatest squared change of a row's speed.
double residual(const System& s) {
  double greatest = 0.0;
  const auto single = [&](const std::vector<Row>& rows) {
    for (const Row& row : rows) {
      const double speed = row.change / row.inverse;
      greatest = std::max(greatest, speed * speed);
    }
  };
  const auto pairs = [&](const std::vector<Row>& rows) {
    for (std::size_t i = 0; i + 1 < rows.size(); i += 2) {
      const double speed =
          rows[i].change / rows[i].inverse + rows[i + 1].change / rows[i + 1].inverse;
      greatest = std::max(greatest, speed * speed);
    }
  };
  single(s.motor);
  single(s.normals);
  single(s.spinning);
  pairs(s.rolling);
  pairs(s.friction);
  return greatest;
}

bool same_bits(double a, double b) { return std::memcmp(&a, &b, sizeof a) == 0; }

template <typename Visit>
void each_state(const System& s, Visit visit) {
  for (double value : s.v) visit(value);
  for (int i = 0; i < s.joints; ++i) visit(s.vs[i]);
  for (const auto* rows : {&s.normals, &s.friction, &s.spinning, &s.rolling, &s.motor})
    for (const Row& row : *rows) visit(row.applied);
}

void save(const System& s, std::vector<double>& out) {
  out.clear();
  each_state(s, [&](double value) { out.push_back(value); });
}

bool equals(const System& s, const std::vector<double>& saved) {
  // Most states differ in the first entry.
  if (!same_bits(s.v[0], saved[0])) return false;
  std::size_t i = 0;
  bool same = true;
  each_state(s, [&](double value) { same = same_bits(value, saved[i++]) && same; });
  return same;
}

}  // namespace

ExactSolver::ExactSolver() {
  constexpr int contacts = 8;
  constexpr int rows = 6 * contacts + 1;
  constexpr int entries = 12 + kJoints;  // of a free body and a slider
  m_multiBodyNonContactConstraints.reserve(1);
  m_multiBodyNormalContactConstraints.reserve(contacts);
  m_multiBodySpinningFrictionContactConstraints.reserve(contacts);
  m_multiBodyTorsionalFrictionContactConstraints.reserve(2 * contacts);
  m_multiBodyFrictionContactConstraints.reserve(2 * contacts);
  m_data.m_jacobians.reserve(rows * entries + 1);
  m_data.m_deltaVelocitiesUnitImpulse.reserve(rows * entries + 1);
  m_data.m_deltaVelocities.reserve(2 * entries);
  system_.motor.reserve(1);
  system_.normals.reserve(contacts);
  system_.spinning.reserve(contacts);
  system_.rolling.reserve(2 * contacts);
  system_.friction.reserve(2 * contacts);
  saved_.reserve(rows + 6 + kJoints);
}

bool ExactSolver::flatten(const btMultiBodyConstraintArray& rows, std::vector<Row>& out,
                          bool motor) {
  out.clear();
  for (int r = 0; r < rows.size(); ++r) {
    const btMultiBodySolverConstraint& c = rows[r];
    if (!c.m_multiBodyA || !c.m_multiBodyB) return false;
    Row row{};
    row.rhs = c.m_rhs;
    row.cfm = c.m_cfm;
    row.inverse = c.m_jacDiagABInv;
    row.friction = c.m_friction;
    row.lower = c.m_lowerLimit;
    row.upper = c.m_upperLimit;
    row.applied = c.m_appliedImpulse;
    row.normal = static_cast<std::size_t>(std::max(c.m_frictionIndex, 0));
    // Finite, and far enough from the ends of the range that a row at rest can be known by its
    // impulse alone.
    if (!(row.inverse > 1e-50 && row.inverse < 1e50) || !std::isfinite(row.rhs)) return false;
    bool has_free = false;
    for (int side = 0; side < 2; ++side) {
      btMultiBody* body = side == 0 ? c.m_multiBodyA : c.m_multiBodyB;
      const int jacobian = side == 0 ? c.m_jacAindex : c.m_jacBindex;
      const btScalar* j = &m_data.m_jacobians[jacobian];
      const btScalar* d = &m_data.m_deltaVelocitiesUnitImpulse[jacobian];
      const int entries = body->getNumDofs() + 6;
      for (int i = 0; i < entries; ++i)
        if (!std::isfinite(j[i]) || !std::isfinite(d[i])) return false;
      if (!body->hasFixedBase()) {
        if (has_free || motor || body->getNumDofs() != 0 || (free_ && free_ != body)) return false;
        free_ = body;
        has_free = true;
        row.free_is_a = side == 0;
        std::copy(j, j + 6, row.j);
        std::copy(d, d + 6, row.d);
        continue;
      }
      for (int i = 0; i < 6; ++i)
        if (d[i] != 0.0) return false;
      if (body->getNumDofs() == 0) continue;
      const int joints = body->getNumDofs();
      if (joints > kJoints || (motor && joints != 1) || (slider_ && slider_ != body)) return false;
      slider_ = body;
      system_.joints = joints;
      if (motor && side == 1) {
        if (j[6] != 0.0 || d[6] != 0.0) return false;
      } else {
        row.js = j[6];
        row.ds = d[6];
        std::copy(j + 7, j + 6 + joints, row.js_more);
        std::copy(d + 7, d + 6 + joints, row.ds_more);
      }
    }
    if (!motor && !has_free) return false;
    out.push_back(row);
  }
  return true;
}

bool ExactSolver::flatten(const btContactSolverInfo& info, int numConstraints) {
  constexpr int cone = SOLVER_USE_2_FRICTION_DIRECTIONS;
  constexpr int other = SOLVER_DISABLE_IMPLICIT_CONE_FRICTION | SOLVER_RANDMIZE_ORDER |
                        SOLVER_USE_ARTICULATED_WARMSTARTING;
  if ((info.m_solverMode & cone) == 0 || (info.m_solverMode & other) != 0) return false;
  if (numConstraints > 0 || info.m_numNonContactInnerIterations != 1) return false;
  if (m_tmpSolverContactConstraintPool.size() > 0 ||
      m_tmpSolverNonContactConstraintPool.size() > 0 ||
      m_tmpSolverContactFrictionConstraintPool.size() > 0 ||
      m_tmpSolverContactRollingFrictionConstraintPool.size() > 0 ||
      m_maxOverrideNumSolverIterations > info.m_numIterations)
    return false;
  // More than one row would be taken in alternating order.
  if (m_multiBodyNonContactConstraints.size() > 1) return false;
  free_ = nullptr;
  slider_ = nullptr;
  std::fill(std::begin(system_.v), std::end(system_.v), 0.0);
  std::fill(std::begin(system_.vs), std::end(system_.vs), 0.0);
  system_.joints = 0;
  if (!flatten(m_multiBodyNonContactConstraints, system_.motor, true) ||
      !flatten(m_multiBodyNormalContactConstraints, system_.normals, false) ||
      !flatten(m_multiBodySpinningFrictionContactConstraints, system_.spinning, false) ||
      !flatten(m_multiBodyTorsionalFrictionContactConstraints, system_.rolling, false) ||
      !flatten(m_multiBodyFrictionContactConstraints, system_.friction, false))
    return false;
  for (std::size_t i = 0; i + 1 < system_.friction.size(); i += 2)
    if (system_.friction[i].normal != system_.friction[i + 1].normal) return false;
  for (std::size_t i = 0; i + 1 < system_.rolling.size(); i += 2)
    if (system_.rolling[i].normal != system_.rolling[i + 1].normal) return false;
  return true;
}

void ExactSolver::iterate(const btContactSolverInfo& info) {
  System& s = system_;
  const auto iteration = is_flat(s) ? run_iteration<true> : run_iteration<false>;
  const double threshold = info.m_leastSquaresResidualThreshold;
  // Far above the impulses whose squared speeds round to zero (see the bounds in flatten()).
  constexpr double kSurelyMoving = 1e-100;
  const auto finished = [&] {
    if (threshold <= 0.0)
      for (const auto* rows : {&s.normals, &s.spinning})
        for (const Row& row : *rows)
          if (std::fabs(row.change) > kSurelyMoving) return false;
    return residual(s) <= threshold;
  };
  // Brent's way of finding a cycle: the state is compared with one saved at powers of two.
  int saved_at = -1;
  int next_save = 1;
  int remaining = info.m_numIterations;
  bool in_cycle = false;
  for (int i = 0; remaining > 0; ++i) {
    iteration(s);
    --remaining;
    if (in_cycle) continue;
    if (finished()) break;
    if (saved_at >= 0 && equals(s, saved_)) {
      in_cycle = true;
      remaining %= i - saved_at;
    } else if (i == next_save) {
      save(s, saved_);
      saved_at = i;
      next_save *= 2;
    }
  }
}

void ExactSolver::write_back() {
  const auto put = [](const std::vector<Row>& from, btMultiBodyConstraintArray& to) {
    for (std::size_t i = 0; i < from.size(); ++i)
      to[static_cast<int>(i)].m_appliedImpulse = from[i].applied;
  };
  put(system_.motor, m_multiBodyNonContactConstraints);
  put(system_.normals, m_multiBodyNormalContactConstraints);
  put(system_.spinning, m_multiBodySpinningFrictionContactConstraints);
  put(system_.rolling, m_multiBodyTorsionalFrictionContactConstraints);
  put(system_.friction, m_multiBodyFrictionContactConstraints);
  if (free_) free_->applyDeltaVeeMultiDof2(system_.v, 1.0);
  if (slider_) {
    double change[6 + kJoints] = {};
    std::copy(system_.vs, system_.vs + system_.joints, change + 6);
    slider_->applyDeltaVeeMultiDof2(change, 1.0);
  }
}

btScalar ExactSolver::solveGroupCacheFriendlyIterations(
    btCollisionObject** bodies, int numBodies, btPersistentManifold** manifolds, int numManifolds,
    btTypedConstraint** constraints, int numConstraints, const btContactSolverInfo& info,
    btIDebugDraw* drawer) {
  if (!flatten(info, numConstraints))
    return btMultiBodyConstraintSolver::solveGroupCacheFriendlyIterations(
        bodies, numBodies, manifolds, numManifolds, constraints, numConstraints, info, drawer);
  iterate(info);
  write_back();
  return 0.0;
}

}  // namespace vsr2
