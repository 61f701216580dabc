#pragma once
// One sweep of projected Gauss-Seidel over four contacts for a register of trials, as sweep() of
// contact_jump.hpp over numbers, without the notes that a jump needs.

#include "kernels.hpp"
#include "lane_numbers.hpp"

namespace vsr2::lanes::LEVEL {

template <typename T>
VSR2_INLINE void respond(const SweptRow<T>& row, const T& change, T (&angular)[3], T& linear) {
  for (int i = 0; i < 3; ++i) angular[i] = angular[i] + row.response[i] * change;
  linear = linear + row.linear_response * change;
}

template <typename T>
VSR2_INLINE void sweep(SweptProblem<T>& p) {
  const T none = all<T>(0.0);
  T w[3], u[3];
  for (int i = 0; i < 3; ++i) w[i] = p.angular[i], u[i] = p.linear[i];
  for (auto& rows : p.rows) {
    SweptRow<T>& row = rows[0];
    const T asked = (row.keep * row.impulse + row.target) -
                    ((row.first * w[0] + row.second * w[1]) + row.along * u[2]);
    const T next = lesser<T>(greater<T>(asked, none), all<T>(1e10F));
    const T change = next - row.impulse;
    row.impulse = next;
    respond(row, change, w, u[2]);
  }
  // A free spinning row stops the spin, which leaves nothing to do for a free one after it.
  Mask<T> stopped = none > all<T>(1.0);
  for (auto& rows : p.rows) {
    SweptRow<T>& row = rows[1];
    const T limit = p.lever * rows[0].impulse;
    const Mask<T> acts = both(Mask<T>(rows[0].impulse > none),
                              opposite(both(stopped, Mask<T>(size(row.impulse) <= limit))));
    const T asked = (row.impulse + row.target) - row.first * w[2];
    const T bounded = lesser<T>(greater<T>(asked, -limit), limit);
    stopped = either(both(acts, Mask<T>(size(asked) <= limit)), both(opposite(acts), stopped));
    const T change = select<T>(acts, bounded - row.impulse, none);
    row.impulse = select<T>(acts, bounded, row.impulse);
    for (int i = 0; i < 3; ++i) w[i] = w[i] + row.response[i] * change;
  }
  for (auto& rows : p.rows) {
    SweptRow<T>&row_1 = rows[2], &row_2 = rows[3];
    const T limit = p.friction * rows[0].impulse;
    const Mask<T> idle = both(both(opposite(Mask<T>(rows[0].impulse > none)), Mask<T>(row_1.impulse == none)),
                              Mask<T>(row_2.impulse == none));
    T next_1 = (row_1.impulse + row_1.target) - ((row_1.first * w[0] + row_1.second * w[2]) + row_1.along * u[1]);
    T next_2 = (row_2.impulse + row_2.target) - ((row_2.first * w[1] + row_2.second * w[2]) + row_2.along * u[0]);
    const T square = next_1 * next_1 + next_2 * next_2;
    const Mask<T> slides = square >= limit * limit;
    if (any(slides)) {
      const T scale = select<T>(Mask<T>(limit > none), limit / root(square), none);
      next_1 = select<T>(slides, next_1 * scale, next_1);
      next_2 = select<T>(slides, next_2 * scale, next_2);
    }
    const T change_1 = select<T>(idle, none, next_1 - row_1.impulse);
    const T change_2 = select<T>(idle, none, next_2 - row_2.impulse);
    row_1.impulse = select<T>(idle, row_1.impulse, next_1);
    row_2.impulse = select<T>(idle, row_2.impulse, next_2);
    for (int i = 0; i < 3; ++i) w[i] = w[i] + (row_1.response[i] * change_1 + row_2.response[i] * change_2);
    u[1] = u[1] + row_1.linear_response * change_1;
    u[0] = u[0] + row_2.linear_response * change_2;
  }
  for (int i = 0; i < 3; ++i) p.angular[i] = w[i], p.linear[i] = u[i];
}

}  // namespace vsr2::lanes::LEVEL
