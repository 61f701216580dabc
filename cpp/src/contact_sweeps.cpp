#include "contact_sweeps.hpp"

#include <algorithm>
#include <cmath>

#include "contact_jump.hpp"
#include "vsr2/constants.hpp"

namespace vsr2 {
namespace {

// Rows of numbers: bounds them, notes the pattern and the greatest change of a row's speed.
class NumberRows {
 public:
  NumberRows(ContactProblem& problem, Pattern& pattern) : p_(problem), pattern_(pattern) {
    pattern_.turning = false;
  }
  double greatest() const { return greatest_; }

  double& motor() { return p_.motor.impulse; }
  double& normal(std::size_t i) { return p_.rows[i].normal.impulse; }
  double& spin(std::size_t i) { return p_.rows[i].spin.impulse; }
  double& lateral_1(std::size_t i) { return p_.rows[i].lateral_1.impulse; }
  double& lateral_2(std::size_t i) { return p_.rows[i].lateral_2.impulse; }

  VSR2_INLINE void bound_motor(double& next) {
    const double bounded = p_.motor.bounded(next);
    pattern_.motor_bounded = bounded != next;
    next = bounded;
  }
  VSR2_INLINE void note_motor(double change) { note(p_.motor, change); }

  VSR2_INLINE bool takes_normal(std::size_t i, double& next) {
    NormalRow& row = p_.rows[i].normal;
    row.unbounded = next;
    row.change = 0.0;
    pattern_.closed[i] = next > 0.0;
    if (!(next > 0.0) && row.impulse == 0.0) return false;
    next = std::min(std::max(next, 0.0), kGreatestImpulse);
    return true;
  }
  VSR2_INLINE void note_normal(std::size_t i, double change) { note(p_.rows[i].normal, change); }

  VSR2_INLINE bool has_spin(std::size_t i) {
    SpinningRow& row = p_.rows[i].spin;
    row.change = 0.0;
    if (!(normal(i) > 0.0)) return false;
    // A free row stops the spin, which leaves nothing to do for a free one after it.
    if (!stopped_ || !(std::fabs(row.impulse) <= p_.rows[i].bounds.spinning(normal(i)))) return true;
    pattern_.spin[i] = Pattern::free;
    return false;
  }
  VSR2_INLINE void bound_spin(std::size_t i, double& next) {
    const double limit = p_.rows[i].bounds.spinning(normal(i));
    p_.rows[i].spin.unbounded = next;
    pattern_.spin[i] = next > limit ? Pattern::upper : next < -limit ? Pattern::lower : Pattern::free;
    stopped_ = pattern_.spin[i] == Pattern::free;
    next = std::min(std::max(next, -limit), limit);
  }
  VSR2_INLINE void note_spin(std::size_t i, double change) { note(p_.rows[i].spin, change); }

  VSR2_INLINE bool has_lateral(std::size_t i) {
    p_.rows[i].lateral_1.change = p_.rows[i].lateral_2.change = 0.0;
    return normal(i) > 0.0 || lateral_1(i) != 0.0 || lateral_2(i) != 0.0;
  }
  VSR2_INLINE void bound_lateral(std::size_t i, double& next_1, double& next_2) {
    ContactRows& rows = p_.rows[i];
    const double limit = rows.bounds.lateral(normal(i));
    const double square = next_1 * next_1 + next_2 * next_2;
    const double cross = next_1 * rows.lateral_2.unbounded - next_2 * rows.lateral_1.unbounded;
    rows.lateral_1.unbounded = next_1;
    rows.lateral_2.unbounded = next_2;
    const bool slid = pattern_.slides[i];
    pattern_.slides[i] = square >= limit * limit;
    if (!pattern_.slides[i]) return;
    if (limit > 0.0 && !(slid && std::fabs(cross) <= kSweep.greatest_turn_before * square))
      pattern_.turning = true;
    const double scale = limit > 0.0 ? limit / std::sqrt(square) : 0.0;
    next_1 *= scale;
    next_2 *= scale;
  }
  VSR2_INLINE void note_lateral(std::size_t i, double change_1, double change_2) {
    ContactRows& rows = p_.rows[i];
    rows.lateral_1.change = change_1;
    rows.lateral_2.change = change_2;
    note(change_1 * rows.lateral_1.inverse_mass + change_2 * rows.lateral_2.inverse_mass);
  }

 private:
  VSR2_INLINE void note(double speed) { greatest_ = std::max(greatest_, std::fabs(speed)); }
  template <typename Row>
  VSR2_INLINE void note(Row& row, double change) {
    row.change = change;
    note(change * row.inverse_mass);
  }

  ContactProblem& p_;
  Pattern& pattern_;
  bool stopped_ = false;
  double greatest_ = 0.0;
};

// One sweep; returns the greatest change of a row's speed.
template <Joint kJoint>
double sweep_numbers(ContactProblem& p, Pattern& pattern) {
  NumberRows rows(p, pattern);
  VelocityChange<double> v = p.change;
  sweep<kJoint>(p, rows, v);
  p.change = v;
  return rows.greatest();
}

}  // namespace

int solve(ContactProblem& problem, int sweeps, double threshold) {
  Pattern pattern;
  int single = 0;
  for (int left = sweeps; left > 0;) {
    const double residual = with_joint(
        problem.joint, [&](auto joint) { return sweep_numbers<joint>(problem, pattern); });
    ++single;
    --left;
    if (threshold > 0.0) {
      if (residual * residual <= threshold) break;
      continue;
    }
    if (residual == 0.0) break;
    if (left > 0) left -= jump(problem, pattern, left);
  }
  return single;
}

}  // namespace vsr2
