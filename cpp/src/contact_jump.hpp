#pragma once
// One sweep over the rows of a contact problem, of numbers or of linear forms, and jumps over many of
// them; private to the core.

#include "contact_sweeps.hpp"

namespace vsr2 {

// What each row did in a sweep: two patterns that are equal are the same affine map, sliding aside.
struct Pattern {
  enum Spin : unsigned char { free, upper, lower };
  std::array<bool, 4> closed{};
  std::array<Spin, 4> spin{};
  std::array<bool, 4> slides{};
  bool motor_bounded = false;
  bool turning = false;  ///< a sliding contact changed its direction too fast to linearise
};

// One sweep over all rows, in Bullet's order: of numbers, with `Rows` the bounds and their pattern,
// or of linear forms within a pattern. `Rows` holds the impulses and says what becomes of those
// that the rows demand:
//   bound_motor(next)      bounds `next`, the impulse demanded of the motor
//   takes_normal(i, next)  bounds `next`, the impulse demanded; false: the row does nothing
//   has_spin(i), bound_spin(i, next); has_lateral(i), bound_lateral(i, next_1, next_2)
//   note_...(i, change)    takes what was applied
template <Joint kJoint, typename Scalar, typename Rows>
VSR2_INLINE void sweep(const ContactProblem& p, Rows& rows, VelocityChange<Scalar>& v) {
  if constexpr (kJoint == Joint::motor) {
    Scalar next = p.motor.demanded(rows.motor(), v);
    rows.bound_motor(next);
    const Scalar change = next - rows.motor();
    rows.motor() = next;
    p.motor.apply(change, v);
    rows.note_motor(change);
  }
  const auto count = static_cast<std::size_t>(p.count);
  for (std::size_t i = 0; i < count; ++i) {
    const NormalRow& row = p.rows[i].normal;
    Scalar next = row.demanded<kJoint>(rows.normal(i), v);
    if (!rows.takes_normal(i, next)) continue;
    const Scalar change = next - rows.normal(i);
    rows.normal(i) = next;
    row.apply<kJoint>(change, v);
    rows.note_normal(i, change);
  }
  for (std::size_t i = 0; i < count; ++i) {
    if (!rows.has_spin(i)) continue;
    const SpinningRow& row = p.rows[i].spin;
    Scalar next = row.demanded<kJoint>(rows.spin(i), v);
    rows.bound_spin(i, next);
    const Scalar change = next - rows.spin(i);
    rows.spin(i) = next;
    row.apply<kJoint>(change, v);
    rows.note_spin(i, change);
  }
  for (std::size_t i = 0; i < count; ++i) {
    if (!rows.has_lateral(i)) continue;
    const Lateral1Row& row_1 = p.rows[i].lateral_1;
    const Lateral2Row& row_2 = p.rows[i].lateral_2;
    Scalar next_1 = row_1.demanded<kJoint>(rows.lateral_1(i), v);
    Scalar next_2 = row_2.demanded<kJoint>(rows.lateral_2(i), v);
    rows.bound_lateral(i, next_1, next_2);
    const Scalar change_1 = next_1 - rows.lateral_1(i);
    const Scalar change_2 = next_2 - rows.lateral_2(i);
    rows.lateral_1(i) = next_1;
    rows.lateral_2(i) = next_2;
    apply_pair<kJoint>(row_1, change_1, row_2, change_2, v);
    rows.note_lateral(i, change_1, change_2);
  }
}

// Takes the problem through up to `most` sweeps that all have the pattern of the latest; returns
// how many.
int jump(ContactProblem& problem, const Pattern& pattern, int most);

}  // namespace vsr2
