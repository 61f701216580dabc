#pragma once
// The step of FastStepper for a block whose contacts stick, written for a register of trials (or for one,
// with its contacts side by side). In the order of operations of the core.
//
// T is a number of a trial or a register of them, F holds one for each contact. The impulses are found in
// the precision of S and G, which hold the same.

#include "kernels.hpp"
#include "lane_numbers.hpp"

namespace vsr2::lanes::LEVEL {

template <typename T>
VSR2_INLINE T sum3(const T& a, const T& b, const T& c) {
  return a + (b + c);  // Eigen's order
}
template <typename T>
VSR2_INLINE T dot(const T (&a)[3], const T (&b)[3]) {
  return sum3<T>(a[0] * b[0], a[1] * b[1], a[2] * b[2]);
}

template <typename T>
struct Turn {
  T R[3][3];
  VSR2_INLINE explicit Turn(const T (&q)[4]) {
    const T &w = q[0], &x = q[1], &y = q[2], &z = q[3];
    const T tx = 2.0 * x, ty = 2.0 * y, tz = 2.0 * z;
    const T twx = tx * w, twy = ty * w, twz = tz * w, txx = tx * x, txy = ty * x, txz = tz * x;
    const T tyy = ty * y, tyz = tz * y, tzz = tz * z;
    R[0][0] = 1.0 - (tyy + tzz), R[0][1] = txy - twz, R[0][2] = txz + twy;
    R[1][0] = txy + twz, R[1][1] = 1.0 - (txx + tzz), R[1][2] = tyz - twx;
    R[2][0] = txz - twy, R[2][1] = tyz + twx, R[2][2] = 1.0 - (txx + tyy);
  }
};

/// Corners of the lower face from the mass centre along the axes of W, and what they ask of their impulses.
template <typename F>
struct Contacts {
  F x, y, z, target;
  Flags<F> kept, closed;
};
template <typename T, typename F>
struct Impulses {
  F normal, x, y;
  Flags<F> closed;
  T angular[3], linear[3];  ///< change of the velocity
  Mask<T> leaves;           ///< not found: a contact slides, or one alone is closed
};

/// solve_sticking() for two to four contacts, or none, of a support without a joint; in: the velocity over
/// the support and the inertia.
template <typename S, typename G>
VSR2_INLINE Impulses<S, G> stick(const Block& b, const Contacts<G>& at, const S (&w)[3], const S (&u)[3],
                                 const S (&inertia)[3][3]) {
  using Number = std::decay_t<decltype(lane(S{}, 0))>;
  const auto one = all<S>(1.0), none = all<S>(0.0);
  const auto m = all<S>(b.mass);
  const S per_m = all<S>(static_cast<double>(Number(1) / static_cast<Number>(b.mass)));
  const G zeros = four<G>(none), ones = four<G>(one);
  Impulses<S, G> out;
  out.closed = at.closed;
  out.leaves = none > one;
  S a = none, turn_b = none, c = none, z = none, count = none;
  Mask<S> wrong = out.leaves;
  for (int tries = 0; tries < b.greedy_sets; ++tries) {
    const Flags<G>& closed = out.closed;
    count = sum(pick(closed, ones, zeros));
    out.leaves = either(out.leaves, Mask<S>(count == one));
    const Mask<S> flies = count == none;
    z = sum(pick(closed, at.z, zeros)) / select<S>(flies, one, count);
    out.leaves = either(out.leaves, some(both(closed, above(size(at.z - z), all<S>(b.level) * size(z)))));
    const S xx = inertia[0][0] + m * z * z, yy = inertia[1][1] + m * z * z;
    const S xy = inertia[0][1];
    const S over = one / (xx * yy - xy * xy);
    const S r_xx = yy * over, r_yy = xx * over, r_xy = -xy * over;
    S along_x = dot(inertia[0], w) + m * z * u[1];
    S along_y = dot(inertia[1], w) - m * z * u[0];
    a = select<S>(flies, w[0], r_xx * along_x + r_xy * along_y);
    turn_b = select<S>(flies, w[1], r_xy * along_x + r_yy * along_y);
    const G by_x = r_xx * at.y - r_xy * at.x, by_y = r_xy * at.y - r_yy * at.x;
    G lambda = pick(closed, at.target - (u[2] + a * at.y - turn_b * at.x), zeros);
    // Columns of the compliance, of which Cholesky's decomposition takes the lower part.
    G column[4];
    for (int j = 0; j < 4; ++j) {
      const G full = (by_x * of(at.y, j) - by_y * of(at.x, j)) + per_m;
      const auto closed_j = of(closed, j);
      column[j] = pick(closed, full, zeros);
      for (int k = j + 1; k < 4; ++k) put(column[j], k, select<S>(closed_j, of(column[j], k), none));
      put(column[j], j, select<S>(closed_j, of(full, j) + all<S>(b.softness), one));
    }
    for (int j = 0; j < 4; ++j) {
      const S pivot = of(column[j], j);
      out.leaves = either(out.leaves, opposite(Mask<S>(pivot > none)));
      const S inverse = one / root(pivot);
      put(lambda, j, S(of(lambda, j) * inverse));
      column[j] = column[j] * inverse;
      for (int k = j + 1; k < 4; ++k) column[k] = column[k] - column[j] * of(column[j], k);
      const G taken = lambda - column[j] * of(lambda, j);
      for (int k = j + 1; k < 4; ++k) put(lambda, k, S(of(taken, k)));
      put(column[j], j, inverse);
    }
    for (int k = 3; k >= 0; --k) {
      S left = of(lambda, k);
      for (int j = k + 1; j < 4; ++j) left = left - of(column[k], j) * of(lambda, j);
      put(lambda, k, S(left * of(column[k], k)));
    }
    const G push_x = lambda * at.y, push_y = lambda * at.x;
    for (int k = 0; k < 4; ++k) {
      along_x = along_x + of(push_x, k);
      along_y = along_y - of(push_y, k);
    }
    a = select<S>(flies, w[0], r_xx * along_x + r_xy * along_y);
    turn_b = select<S>(flies, w[1], r_xy * along_x + r_yy * along_y);
    c = u[2] + sum(lambda) / m;
    out.normal = lambda;
    // Contacts that pull are opened, the worst first; then those that sink are closed.
    const G sinks = at.target - (c + a * at.y - turn_b * at.x);
    const auto pulling = both(closed, opposite(above(lambda, zeros)));
    const auto sinking = both(both(at.kept, opposite(closed)), above(sinks, zeros));
    const Mask<S> pulls = some(pulling);
    wrong = both(either(pulls, some(sinking)), opposite(out.leaves));
    if (!any(wrong)) break;
    S least = none, greatest = none, worst_low = all<S>(-1), worst_deep = all<S>(-1);
    for (int k = 0; k < 4; ++k) {
      const Mask<S> lower = both(Mask<S>(of(pulling, k)), opposite(Mask<S>(of(lambda, k) > least)));
      least = select<S>(lower, of(lambda, k), least);
      worst_low = select<S>(lower, all<S>(k), worst_low);
      const Mask<S> deeper = both(Mask<S>(of(sinking, k)), Mask<S>(of(sinks, k) > greatest));
      greatest = select<S>(deeper, of(sinks, k), greatest);
      worst_deep = select<S>(deeper, all<S>(k), worst_deep);
    }
    for (int k = 0; k < 4; ++k) {
      const Mask<S> opens = both(pulls, Mask<S>(worst_low == all<S>(k)));
      const Mask<S> closes = both(opposite(pulls), Mask<S>(worst_deep == all<S>(k)));
      put(out.closed, k, both(either(Mask<S>(of(out.closed, k)), closes), opposite(opens)));
    }
  }
  out.leaves = either(out.leaves, wrong);
  // As a lateral impulse: each contact's share is its normal impulse's, with a turn about their centre.
  const Mask<S> flies = count == none;
  const S change_a = a - w[0], change_b = turn_b - w[1], change_spin = none - w[2];
  const S dv[3] = {-(z * turn_b) - u[0], z * a - u[1], c - u[2]};
  const G& lambda = out.normal;
  const S total = select<S>(flies, one, sum(lambda));
  const S centre_x = sum(lambda * at.x) / total, centre_y = sum(lambda * at.y) / total;
  const G d_x = at.x - centre_x, d_y = at.y - centre_y;
  const S polar = select<S>(flies, one, sum(lambda * (d_x * d_x + d_y * d_y)));
  const S f_x = m * dv[0], f_y = m * dv[1];
  const S torque = sum3<S>(inertia[2][0] * change_a, inertia[2][1] * change_b, inertia[2][2] * change_spin) -
                   (centre_x * f_y - centre_y * f_x);
  const S turn = torque / polar;
  const G s_x = f_x / total - turn * d_y, s_y = f_y / total + turn * d_x;
  const G greatest = four<G>(all<S>(b.friction));
  const auto sticks = above(greatest * greatest, s_x * s_x + s_y * s_y);
  out.leaves = either(out.leaves, some(both(out.closed, opposite(sticks))));
  out.x = lambda * s_x;
  out.y = lambda * s_y;
  const S changes[6] = {change_a, change_b, change_spin, dv[0], dv[1], dv[2]};
  for (int i = 0; i < 3; ++i) {
    out.angular[i] = select<S>(flies, none, changes[i]);
    out.linear[i] = select<S>(flies, none, changes[3 + i]);
  }
  return out;
}

/// The corners of the lower face in B, in Bullet's order.
template <typename F>
VSR2_INLINE void corners(const Block& b, F& x, F& y) {
  constexpr double signs[4][2] = {{-1, -1}, {-1, 1}, {1, 1}, {1, -1}};
  for (int k = 0; k < 4; ++k) {
    put(x, k, all<One<F>>(signs[k][0] * b.half[0]));
    put(y, k, all<One<F>>(signs[k][1] * b.half[1]));
  }
}
template <typename F, typename T>
VSR2_INLINE F loaded(const T (&from)[4]) {
  F out;
  for (int k = 0; k < 4; ++k) put(out, k, from[k]);
  return out;
}
template <typename F, typename T>
VSR2_INLINE void store(const F& from, T (&to)[4]) {
  for (int k = 0; k < 4; ++k) to[k] = of(from, k);
}
/// Impulses in another precision, or as they are.
template <typename To, typename From>
VSR2_INLINE To four_as(const From& from) {
  if constexpr (std::is_same_v<To, From>) {
    return from;
  } else {
    To out;
    for (int k = 0; k < 4; ++k) put(out, k, as<One<To>>(of(from, k)));
    return out;
  }
}
template <typename To, typename From>
VSR2_INLINE To flags_as(const From& from) {
  if constexpr (std::is_same_v<To, From>) {
    return from;
  } else {
    To out;
    for (int k = 0; k < 4; ++k) put(out, k, as<std::decay_t<decltype(of(out, 0))>>(of(from, k)));
    return out;
  }
}

/// One step; lanes whose rock leaves the pattern have the flag and keep their state.
template <typename T, typename F, typename S, typename G>
VSR2_INLINE Mask<T> step(const Block& b, const T& position, const T& velocity, Rock<T>& rock) {
  const T none = all<T>(0.0);
  const F zeros = four<F>(none);
  const Turn<T> turn(rock.q);
  const auto& R = turn.R;
  // Contacts, as detect_box() and refresh().
  const T p_x = rock.p[0] - position, p_y = rock.p[1], p_z = rock.p[2] - b.height;
  const T nx = size(R[2][0]), ny = size(R[2][1]), nz = size(R[2][2]);
  const T depth = b.top - (p_z - sum3<T>(nx * b.half[0], ny * b.half[1], nz * b.half[2]));
  Mask<T> leaves = either(either(Mask<T>(depth > b.deepest), Mask<T>(R[2][2] < none)),
                          either(Mask<T>(nx > nz), Mask<T>(ny > nz)));
  F x_B, y_B;
  corners(b, x_B, y_B);
  const T below = all<T>(-b.half[2]);
  Contacts<F> at;
  at.x = R[0][0] * x_B + (R[0][1] * y_B + R[0][2] * below);
  at.y = R[1][0] * x_B + (R[1][1] * y_B + R[1][2] * below);
  at.z = R[2][0] * x_B + (R[2][1] * y_B + R[2][2] * below);
  const F x_P = p_x + at.x, y_P = p_y + at.y;
  const F distance = (p_z + at.z) - all<T>(b.top);
  const T guard = b.guard + b.guard_of_depth * greater<T>(depth, none);
  leaves = either(leaves, some(either(opposite(above(b.top_half[0] - guard, size(x_P))),
                                      opposite(above(b.top_half[1] - guard, size(y_P))))));
  const auto touches = opposite(above(distance, zeros));
  const F place_x = pick(touches, x_P, loaded<F>(rock.place_x));
  const F place_y = pick(touches, y_P, loaded<F>(rock.place_y));
  const F slid_x = x_P - place_x, slid_y = y_P - place_y;
  const T limit = all<T>(b.breaking);
  const auto breaks = either(above(distance, limit), above(slid_x * slid_x + slid_y * slid_y, limit * limit));
  at.kept = both(either(above(loaded<F>(rock.kept), zeros), touches), opposite(breaks));
  const F before = loaded<F>(rock.normal);
  at.closed = both(at.kept, above(before, zeros));
  // Velocities without impulses.
  T w[3], v[3], turned[3];
  for (int i = 0; i < 3; ++i) w[i] = rock.w[i], v[i] = rock.v[i];
  {
    T w_B[3], momentum[3];
    for (int i = 0; i < 3; ++i) {
      w_B[i] = sum3<T>(R[0][i] * w[0], R[1][i] * w[1], R[2][i] * w[2]);
      momentum[i] = b.inertia[i] * w_B[i];
    }
    const T rate = b.angular_damping + b.angular_damping * root(dot(w_B, w_B));
    for (int i = 0; i < 3; ++i) {
      const int j = (i + 1) % 3, k = (i + 2) % 3;
      turned[i] = -(b.inverse_inertia[i] * (w_B[j] * momentum[k] - w_B[k] * momentum[j])) - w_B[i] * rate;
    }
    for (int i = 0; i < 3; ++i) w[i] = clamped<T>(w[i] + b.dt * dot(R[i], turned), 100.0);
    const T drag = b.linear_damping + b.linear_damping * root(dot(rock.v, rock.v));
    for (int i = 0; i < 3; ++i)
      v[i] = clamped<T>(v[i] + b.dt * ((i == 2 ? -b.gravity : 0.0) - v[i] * drag), 100.0);
  }
  // What the contacts ask.
  const F rises = v[2] + (w[0] * at.y - w[1] * at.x);
  const F rebound = pick(opposite(above(all<T>(b.threshold), size(rises))),
                                   all<T>(-b.restitution) * rises, zeros);
  const F gap = distance + all<T>(1e-5);
  const F closing = pick(above(gap, zeros), (none - gap) / all<T>(b.dt),
                                   ((none - gap) * all<T>(b.erp)) / all<T>(b.dt));
  at.target = pick(above(rebound, zeros), rebound, zeros) + closing;
  // Impulses.
  S inertia[3][3], angular[3], linear[3];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      inertia[i][j] = as<S>(sum3<T>((R[i][0] * b.inertia[0]) * R[j][0], (R[i][1] * b.inertia[1]) * R[j][1],
                                    (R[i][2] * b.inertia[2]) * R[j][2]));
  for (int i = 0; i < 3; ++i) {
    angular[i] = as<S>(w[i]);
    linear[i] = as<S>(i == 0 ? v[0] - velocity : v[i]);
  }
  const Contacts<G> asked{four_as<G>(at.x), four_as<G>(at.y), four_as<G>(at.z), four_as<G>(at.target),
                          flags_as<Flags<G>>(at.kept), flags_as<Flags<G>>(at.closed)};
  const Impulses<S, G> found = stick<S, G>(b, asked, angular, linear, inertia);
  leaves = either(leaves, as<Mask<T>>(found.leaves));
  // Positions.
  Rock<T> next;
  for (int i = 0; i < 3; ++i) {
    next.w[i] = clamped<T>(w[i] + as<T>(found.angular[i]), 100.0);
    next.v[i] = clamped<T>(v[i] + as<T>(found.linear[i]), 100.0);
    next.p[i] = rock.p[i] + b.dt * next.v[i];
  }
  const T speed = root(dot(next.w, next.w));
  const T h = 0.5 * speed * b.dt;
  leaves = either(leaves, opposite(Mask<T>(h < 0.05)));
  const T s = h * h;
  const T sinc = 1.0 + s * (-1.0 / 6 + s * (1.0 / 120 + s * (-1.0 / 5040 + s / 362880.0)));
  const T cosine = 1.0 + s * (-0.5 + s * (1.0 / 24 + s * (-1.0 / 720 + s / 40320.0)));
  const T by = 0.5 * b.dt * sinc;
  const T x = next.w[0] * by, y = next.w[1] * by, z = next.w[2] * by;
  const auto& q = rock.q;
  next.q[0] = cosine * q[0] - x * q[1] - y * q[2] - z * q[3];
  next.q[1] = cosine * q[1] + x * q[0] + y * q[3] - z * q[2];
  next.q[2] = cosine * q[2] + y * q[0] + z * q[1] - x * q[3];
  next.q[3] = cosine * q[3] + z * q[0] + x * q[2] - y * q[1];
  const T length = (next.q[1] * next.q[1] + next.q[3] * next.q[3]) + (next.q[2] * next.q[2] + next.q[0] * next.q[0]);
  const T scale = 1.0 / root(length);
  for (T& one : next.q) one = one * scale;
  // Contacts after the step.
  const auto closed = flags_as<Flags<F>>(found.closed);
  const F normal = four_as<F>(found.normal), ones = four<F>(all<T>(1.0));
  store(place_x, next.place_x);
  store(place_y, next.place_y);
  store(pick(at.kept, ones, zeros), next.kept);
  store(normal, next.normal);
  store(four_as<F>(found.x), next.lateral_x);
  store(four_as<F>(found.y), next.lateral_y);
  const auto other = either(both(at.closed, opposite(closed)), both(closed, opposite(at.closed)));
  const T pressed = sum(pick(at.closed, ones, zeros));
  next.closed = sum(pick(closed, ones, zeros));
  next.held = select<T>(either(some(other), Mask<T>(pressed != rock.closed)), none, rock.held + 1.0);
  if (any(leaves)) {
    auto* to = reinterpret_cast<T*>(&next);
    const auto* from = reinterpret_cast<const T*>(&rock);
    for (int i = 0; i < kFields; ++i) to[i] = select<T>(leaves, from[i], to[i]);
  }
  rock = next;
  return leaves;
}

}  // namespace vsr2::lanes::LEVEL
