#include "contact_sweeps.hpp"

#include <algorithm>
#include <cmath>

#include "hull_scan.hpp"

#if defined(__GNUC__)
#define VSR2_INLINE __attribute__((always_inline)) inline
#else
#define VSR2_INLINE inline
#endif

namespace vsr2 {
namespace {

// What each row did in a sweep: two patterns that are equal are the same affine map, sliding aside.
struct Pattern {
  enum Spin : unsigned char { free, upper, lower };
  std::array<bool, 4> closed{};
  std::array<Spin, 4> spin{};
  std::array<bool, 4> slides{};
  bool motor_bounded = false;
  bool turning = false;  ///< a sliding contact changed its direction too fast to linearise

  bool operator==(const Pattern&) const = default;
};

// Greatest change of direction of a sliding contact that a jump is tried after, in a sweep, and
// that a jump makes [rad].
constexpr double kMostTurnBefore = 1e-6;
constexpr double kMostTurn = 1e-5;

// One sweep over all rows; returns the greatest change of a row's speed.
template <bool kMotor>
double sweep(ContactProblem& p, Pattern& pattern) {
  VelocityChange c = p.change;
  double greatest = 0.0;
  const auto note = [&greatest](double speed) { greatest = std::max(greatest, std::fabs(speed)); };
  if constexpr (kMotor) {
    const double sum = p.motor_impulse + (p.motor_rhs - c.support) / p.motor_inverse_mass;
    const double bounded = std::clamp(sum, -p.motor_limit, p.motor_limit);
    const double delta = bounded - p.motor_impulse;
    pattern.motor_bounded = bounded != sum;
    p.motor_impulse = bounded;
    p.motor_change = delta;
    c.support += p.motor_inverse_mass * delta;
    note(delta * p.motor_inverse_mass);
  }
  pattern.turning = false;
  const auto count = static_cast<std::size_t>(p.count);
  for (std::size_t i = 0; i < count; ++i) {
    ContactRows& r = p.rows[i];
    const double sum = (r.n * r.nkeep + r.nrhs) - ((r.nj0 * c.w0 + r.nj1 * c.w1) + r.njz * c.z);
    r.n_sum = sum;
    pattern.closed[i] = sum > 0.0;
    r.dn = 0.0;
    if (!(sum > 0.0) && r.n == 0.0) continue;
    const double bounded = std::min(std::max(sum, 0.0), kGreatestImpulse);
    const double delta = bounded - r.n;
    r.n = bounded;
    r.dn = delta;
    c.w0 += r.nd0 * delta;
    c.w1 += r.nd1 * delta;
    c.w2 += r.nd2 * delta;
    c.z += p.inverse_mass * delta;
    note(delta * r.nk);
  }
  bool stopped = false;
  for (std::size_t i = 0; i < count; ++i) {
    ContactRows& r = p.rows[i];
    r.ds = 0.0;
    if (!(r.n > 0.0)) continue;
    const double limit = p.spinning_friction * r.n;
    // A free row stops the spin, which leaves nothing to do for a free one after it.
    if (stopped && std::fabs(r.s) <= limit) {
      pattern.spin[i] = Pattern::free;
      continue;
    }
    const double sum = (r.s + r.srhs) - r.sj * c.w2;
    const double bounded = std::min(std::max(sum, -limit), limit);
    const double delta = bounded - r.s;
    pattern.spin[i] = sum > limit ? Pattern::upper : sum < -limit ? Pattern::lower : Pattern::free;
    stopped = pattern.spin[i] == Pattern::free;
    r.s_sum = sum;
    r.s = bounded;
    r.ds = delta;
    c.w0 += r.sd0 * delta;
    c.w1 += r.sd1 * delta;
    c.w2 += r.sd2 * delta;
    note(delta * r.sk);
  }
  for (std::size_t i = 0; i < count; ++i) {
    ContactRows& r = p.rows[i];
    r.da = r.db = 0.0;
    if (!(r.n > 0.0) && r.a == 0.0 && r.b == 0.0) continue;
    const double limit = p.lateral_friction * r.n;
    double a = (r.a + r.arhs) - ((r.aj0 * c.w0 + r.aj2 * c.w2) + r.ajy * c.y);
    double along = (r.bj1 * c.w1 + r.bj2 * c.w2) + r.bjx * c.x;
    if constexpr (kMotor) along += r.bjs * c.support;
    double b = (r.b + r.brhs) - along;
    const double square = a * a + b * b;
    const double cross = a * r.b_sum - b * r.a_sum;
    r.a_sum = a;
    r.b_sum = b;
    const bool slid = pattern.slides[i];
    pattern.slides[i] = square >= limit * limit;
    if (square >= limit * limit) {
      if (limit > 0.0 && !(slid && std::fabs(cross) <= kMostTurnBefore * square))
        pattern.turning = true;
      const double scale = limit > 0.0 ? limit / std::sqrt(square) : 0.0;
      a *= scale;
      b *= scale;
    }
    const double da = a - r.a;
    const double db = b - r.b;
    r.a = a;
    r.b = b;
    r.da = da;
    r.db = db;
    c.w0 += r.ad0 * da + r.bd0 * db;
    c.w1 += r.ad1 * da + r.bd1 * db;
    c.w2 += r.ad2 * da + r.bd2 * db;
    c.y -= p.inverse_mass * da;
    c.x += p.inverse_mass * db;
    if constexpr (kMotor) c.support -= p.motor_inverse_mass * db;
    note(da * r.ak + db * r.bk);
  }
  p.change = c;
  return greatest;
}

double sweep(ContactProblem& p, Pattern& pattern) {
  return p.motor_inverse_mass > 0 ? sweep<true>(p, pattern) : sweep<false>(p, pattern);
}

// Four doubles that the compiler maps on what vector registers there are; every lane rounds as a
// scalar does.
typedef double Lanes __attribute__((vector_size(4 * sizeof(double)), may_alias));

// Motor, 4 normal, 4 spinning and 8 lateral rows.
constexpr int kMostVariables = 17;
constexpr int kMostRows = kMostVariables + 3;  // whole blocks of the product
constexpr int kMostOutputs = 16;
constexpr int kMostPowers = 24;
// Changes below this part of the greatest normal impulse are rounding.
constexpr double kRounding = 1e-16;

// Which impulses vary within a pattern, in the order of the sweep.
struct Variables {
  std::array<int, 4> normal;   // -1: none
  std::array<int, 4> spin;     // -1: none
  std::array<int, 4> lateral;  // of the pair's first; -1: none
  int count = 0;

  Variables(const ContactProblem& p, const Pattern& pattern) {
    normal.fill(-1);
    spin.fill(-1);
    lateral.fill(-1);
    const auto contacts = static_cast<std::size_t>(p.count);
    if (p.motor_inverse_mass > 0) ++count;
    for (std::size_t i = 0; i < contacts; ++i)
      if (pattern.closed[i]) normal[i] = count++;
    if (p.spinning_friction > 0) {
      bool stopped = false;
      for (std::size_t i = 0; i < contacts; ++i) {
        if (!pattern.closed[i]) continue;
        const bool is_free = pattern.spin[i] == Pattern::free;
        if (!is_free || !stopped) spin[i] = count++;
        stopped = is_free;
      }
    }
    if (p.lateral_friction > 0) {
      for (std::size_t i = 0; i < contacts; ++i) {
        if (!pattern.closed[i]) continue;
        lateral[i] = count;
        count += 2;
      }
    }
  }
};

// State difference e after m sweeps: e_m = A^m e_0 + c_m. The first variable's own value does not
// count in a Gauss-Seidel sweep, so A has no column for it: column q is of variable q + 1.
template <int kWidth>
struct Power {
  Lanes row[kMostRows][kWidth];
  alignas(32) double c[4 * kWidth + 4];  // from variable 0 on
};

template <int kWidth>
VSR2_INLINE double dot(const Lanes* row, const double* columns) {
  Lanes sum = row[0] * *reinterpret_cast<const Lanes*>(columns);
  for (int w = 1; w < kWidth; ++w) sum += row[w] * reinterpret_cast<const Lanes*>(columns)[w];
  return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

template <int kWidth>
class Jump {
 public:
  VSR2_INLINE Jump(const ContactProblem& p, const Pattern& pattern, const Variables& variables)
      : p_(p), pattern_(pattern), v_(variables), count_(variables.count) {
    linearise();
  }

  // Sweeps jumped, at most `most`; `e` then holds the change of every variable.
  VSR2_INLINE int run(int most, double* e) {
    alignas(32) double columns[4 * kWidth];
    std::fill(e, e + 4 * kWidth + 4, 0.0);
    if (!holds(e)) return 0;
    // c_1 = A d, of the latest sweep's changes d.
    shift(change_, columns);
    for (int r = 0; r < count_; ++r) power_[0].c[r] = dot<kWidth>(power_[0].row[r], columns);
    if (!holds(power_[0].c)) return 0;
    int level = 0;
    int done = 1;
    const double* now = power_[0].c;
    while (2 * done <= most && level + 1 < kMostPowers) {
      // c_2m = A^m c_m + c_m
      Power<kWidth>& next = power_[level + 1];
      const double greatest = advance(power_[level], now, next.c);
      if (!holds(next.c)) break;
      ++level;
      done *= 2;
      now = next.c;
      if (greatest <= rounding_) {
        done = most;
        break;
      }
      if (2 * done <= most) square(power_[level - 1], next);
    }
    std::copy(now, now + count_, e);
    for (int i = level - 1; i >= 0; --i) {
      const int step = 1 << i;
      if (done + step > most) continue;
      double trial[4 * kWidth + 4];
      advance(power_[i], e, trial);
      if (!holds(trial)) continue;
      std::copy(trial, trial + count_, e);
      done += step;
    }
    return done;
  }

 private:
  static VSR2_INLINE void shift(const double* variables, double* columns) {
    for (int q = 0; q < 4 * kWidth; ++q) columns[q] = variables[q + 1];
  }

  // to = A e + c; returns the greatest difference of the two.
  VSR2_INLINE double advance(const Power<kWidth>& power, const double* e, double* to) {
    alignas(32) double columns[4 * kWidth];
    shift(e, columns);
    double greatest = 0.0;
    for (int r = 0; r < count_; ++r) {
      to[r] = dot<kWidth>(power.row[r], columns) + power.c[r];
      greatest = std::max(greatest, std::fabs(to[r] - e[r]));
    }
    for (int r = count_; r < 4 * kWidth + 4; ++r) to[r] = 0.0;
    return greatest;
  }

  VSR2_INLINE void square(const Power<kWidth>& from, Power<kWidth>& to) {
    constexpr int kBlock = kWidth <= 2 ? 4 : 2;
    for (int first = 0; first < count_; first += kBlock) {
      // Rows past the last are zeros.
      Lanes sum[kBlock][kWidth] = {};
      for (int q = 1; q < count_; ++q) {
        for (int k = 0; k < kBlock; ++k) {
          const double factor = reinterpret_cast<const double*>(from.row[first + k])[q - 1];
          for (int w = 0; w < kWidth; ++w) sum[k][w] += factor * from.row[q][w];
        }
      }
      for (int k = 0; k < kBlock; ++k)
        for (int w = 0; w < kWidth; ++w) to.row[first + k][w] = sum[k][w];
    }
  }

  // One sweep of the linear parts: the columns of power_[0] and of the outputs.
  VSR2_INLINE void linearise() {
    Power<kWidth>& map = power_[0];
    Lanes speed[7][kWidth];
    double* s = reinterpret_cast<double*>(speed);
    constexpr int n = 4 * kWidth;
    std::fill(s, s + 7 * n, 0.0);
    double* x = reinterpret_cast<double*>(map.row);
    std::fill(x, x + (count_ + 3) * n, 0.0);
    std::fill(map.c, map.c + 4 * kWidth + 4, 0.0);
    std::fill(std::begin(change_), std::end(change_), 0.0);
    const auto contacts = static_cast<std::size_t>(p_.count);
    // Speeds by a unit of each variable but the first.
    for (int q = 1; q < count_; ++q) x[q * n + q - 1] = 1.0;
    double greatest = 0.0;
    for (std::size_t i = 0; i < contacts; ++i) {
      const ContactRows& r = p_.rows[i];
      const auto put = [&](int q, double w0, double w1, double w2, int axis, double value) {
        if (q < 1) return;
        s[0 * n + q - 1] = w0;
        s[1 * n + q - 1] = w1;
        s[2 * n + q - 1] = w2;
        if (axis >= 0) s[axis * n + q - 1] = value;
      };
      if (v_.normal[i] >= 0) {
        put(v_.normal[i], r.nd0, r.nd1, r.nd2, 5, p_.inverse_mass);
        change_[v_.normal[i]] = r.dn;
        greatest = std::max(greatest, r.n);
      }
      if (v_.spin[i] >= 0) {
        put(v_.spin[i], r.sd0, r.sd1, r.sd2, -1, 0.0);
        change_[v_.spin[i]] = r.ds;
      }
      if (v_.lateral[i] >= 0) {
        put(v_.lateral[i], r.ad0, r.ad1, r.ad2, 4, -p_.inverse_mass);
        put(v_.lateral[i] + 1, r.bd0, r.bd1, r.bd2, 3, p_.inverse_mass);
        s[6 * n + v_.lateral[i]] = -p_.motor_inverse_mass;
        change_[v_.lateral[i]] = r.da;
        change_[v_.lateral[i] + 1] = r.db;
      }
    }
    rounding_ = kRounding * greatest;
    if (p_.motor_inverse_mass > 0) {
      change_[0] = p_.motor_change;
      rounding_ = kRounding * std::max(greatest, std::fabs(p_.motor_impulse));
      for (int w = 0; w < kWidth; ++w) {
        map.row[0][w] = -speed[6][w] / p_.motor_inverse_mass;
        speed[6][w] = Lanes{};
      }
    }
    const ContactRows* first = nullptr;
    for (std::size_t i = 0; i < contacts; ++i)
      if (v_.normal[i] == 0) first = &p_.rows[i];
    for (std::size_t i = 0; i < contacts; ++i) {
      const ContactRows& r = p_.rows[i];
      const int q = v_.normal[i];
      if (q < 0) {
        // Before the first variable's turn its old value still counts.
        before_first_[i] = 0.0;
        if (first != nullptr)
          before_first_[i] = -((r.nj0 * first->nd0 + r.nj1 * first->nd1) + r.njz * p_.inverse_mass);
      }
      if (q == 0) first = nullptr;
      for (int w = 0; w < kWidth; ++w) {
        const Lanes part = (r.nj0 * speed[0][w] + r.nj1 * speed[1][w]) + r.njz * speed[5][w];
        if (q < 0) {
          output_[i][w] = -part;
          continue;
        }
        const Lanes next = map.row[q][w] * r.nkeep - part;
        const Lanes delta = next - map.row[q][w];
        map.row[q][w] = next;
        speed[0][w] += r.nd0 * delta;
        speed[1][w] += r.nd1 * delta;
        speed[2][w] += r.nd2 * delta;
        speed[5][w] += p_.inverse_mass * delta;
      }
    }
    for (std::size_t i = 0; i < contacts; ++i) {
      const ContactRows& r = p_.rows[i];
      const int q = v_.spin[i];
      if (q < 0) continue;
      const double sign = pattern_.spin[i] == Pattern::upper ? 1.0 : -1.0;
      for (int w = 0; w < kWidth; ++w) {
        Lanes next = map.row[q][w] - r.sj * speed[2][w];
        if (pattern_.spin[i] != Pattern::free) {
          output_[4 + i][w] = next;
          next = (sign * p_.spinning_friction) * map.row[v_.normal[i]][w];
        }
        const Lanes delta = next - map.row[q][w];
        map.row[q][w] = next;
        speed[0][w] += r.sd0 * delta;
        speed[1][w] += r.sd1 * delta;
        speed[2][w] += r.sd2 * delta;
      }
    }
    for (std::size_t i = 0; i < contacts; ++i) {
      const ContactRows& r = p_.rows[i];
      const int q = v_.lateral[i];
      if (q < 0) continue;
      for (int w = 0; w < kWidth; ++w) {
        Lanes a = map.row[q][w] -
                  ((r.aj0 * speed[0][w] + r.aj2 * speed[2][w]) + r.ajy * speed[4][w]);
        Lanes b = map.row[q + 1][w] -
                  (((r.bj1 * speed[1][w] + r.bj2 * speed[2][w]) + r.bjx * speed[3][w]) +
                   r.bjs * speed[6][w]);
        if (pattern_.slides[i]) {
          output_[8 + 2 * i][w] = a;
          output_[9 + 2 * i][w] = b;
          // The impulse is mu n u / |u| with u = (a, b) before the bound.
          const double length = std::sqrt(r.a_sum * r.a_sum + r.b_sum * r.b_sum);
          const double ua = r.a_sum / length;
          const double ub = r.b_sum / length;
          const double turn = p_.lateral_friction * r.n / length;
          const Lanes normal = p_.lateral_friction * map.row[v_.normal[i]][w];
          const Lanes across = turn * (ua * b - ub * a);
          a = ua * normal - ub * across;
          b = ub * normal + ua * across;
        }
        const Lanes da = a - map.row[q][w];
        const Lanes db = b - map.row[q + 1][w];
        map.row[q][w] = a;
        map.row[q + 1][w] = b;
        speed[0][w] += r.ad0 * da + r.bd0 * db;
        speed[1][w] += r.ad1 * da + r.bd1 * db;
        speed[2][w] += r.ad2 * da + r.bd2 * db;
        speed[4][w] -= p_.inverse_mass * da;
        speed[3][w] += p_.inverse_mass * db;
        speed[6][w] -= p_.motor_inverse_mass * db;
      }
    }
  }

  // A contact's normal impulse in the sweep after.
  VSR2_INLINE double next_normal(std::size_t i, const double* next) const {
    return p_.rows[i].n + dot<kWidth>(power_[0].row[v_.normal[i]], next);
  }

  // Whether the pattern is that of the state `e` further on, and of the unbounded values in the
  // sweep after it.
  VSR2_INLINE bool holds(const double* e) const {
    alignas(32) double next[4 * kWidth];
    for (int q = 0; q < 4 * kWidth; ++q) next[q] = e[q + 1] + change_[q + 1];
    if (p_.motor_inverse_mass > 0 && !(std::fabs(p_.motor_impulse + e[0]) < p_.motor_limit))
      return false;
    for (int k = 0; k < p_.count; ++k) {
      const auto i = static_cast<std::size_t>(k);
      const ContactRows& r = p_.rows[i];
      if (v_.normal[i] < 0) {
        const double n = r.n_sum + (dot<kWidth>(output_[i], next) +
                                    before_first_[i] * (e[0] + change_[0]));
        if (!(n <= 0.0)) return false;
        continue;
      }
      const double n = r.n + e[v_.normal[i]];
      if (!(n > 0.0 && n < kGreatestImpulse)) return false;
      const double spin_limit = p_.spinning_friction * n;
      if (pattern_.spin[i] == Pattern::free) {
        const double s = v_.spin[i] < 0 ? r.s : r.s + e[v_.spin[i]];
        if (!(std::fabs(s) <= spin_limit)) return false;
      } else if (v_.spin[i] >= 0) {
        const double s = r.s_sum + dot<kWidth>(output_[4 + i], next);
        if (!((pattern_.spin[i] == Pattern::upper ? s : -s) > p_.spinning_friction * next_normal(i, next)))
          return false;
      }
      const int q = v_.lateral[i];
      if (q < 0) continue;
      const double limit = p_.lateral_friction * n;
      if (!pattern_.slides[i]) {
        const double a = r.a + e[q];
        const double b = r.b + e[q + 1];
        if (!(a * a + b * b < limit * limit)) return false;
      } else {
        const double a = r.a_sum + dot<kWidth>(output_[8 + 2 * i], next);
        const double b = r.b_sum + dot<kWidth>(output_[9 + 2 * i], next);
        const double next_limit = p_.lateral_friction * next_normal(i, next);
        if (!(a * a + b * b >= next_limit * next_limit)) return false;
        if (!(std::fabs(a * r.b_sum - b * r.a_sum) <=
              kMostTurn * (r.a_sum * r.a_sum + r.b_sum * r.b_sum)))
          return false;
      }
    }
    return true;
  }

  const ContactProblem& p_;
  const Pattern& pattern_;
  const Variables& v_;
  const int count_;
  double rounding_ = 0.0;
  double change_[kMostVariables + 4];  // of the latest sweep
  Lanes output_[kMostOutputs][kWidth];
  double before_first_[4];
  Power<kWidth> power_[kMostPowers];
};

template <int kWidth>
VSR2_INLINE int jump_with(const ContactProblem& p, const Pattern& pattern, const Variables& v,
                          int most, double* e) {
  Jump<kWidth> jump(p, pattern, v);
  return jump.run(most, e);
}

VSR2_INLINE int jump_any(const ContactProblem& p, const Pattern& pattern, const Variables& v,
                         int most, double* e) {
  if (v.count <= 5) return jump_with<1>(p, pattern, v, most, e);
  if (v.count <= 9) return jump_with<2>(p, pattern, v, most, e);
  if (v.count <= 13) return jump_with<3>(p, pattern, v, most, e);
  return jump_with<4>(p, pattern, v, most, e);
}

int jump_portable(const ContactProblem& p, const Pattern& pattern, const Variables& v, int most,
                  double* e) {
  return jump_any(p, pattern, v, most, e);
}

#if defined(__x86_64__) && defined(__GNUC__)
__attribute__((target("avx2"))) int jump_avx2(const ContactProblem& p, const Pattern& pattern,
                                              const Variables& v, int most, double* e) {
  return jump_any(p, pattern, v, most, e);
}
#endif

// Takes the problem through up to `most` sweeps that all have the pattern of the latest; returns
// how many.
int jump(ContactProblem& p, const Pattern& pattern, int most) {
  if (pattern.motor_bounded || pattern.turning) return 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(p.count); ++i) {
    // A contact that has just opened: its last impulses are no variables of the map.
    const ContactRows& r = p.rows[i];
    if (!pattern.closed[i] && (r.dn != 0.0 || r.da != 0.0 || r.db != 0.0)) return 0;
  }
  const Variables v(p, pattern);
  if (v.count == 0) return 0;
  double e[kMostVariables + 4];
#if defined(__x86_64__) && defined(__GNUC__)
  const int done = instruction_set() == InstructionSet::avx2 ? jump_avx2(p, pattern, v, most, e)
                                                             : jump_portable(p, pattern, v, most, e);
#else
  const int done = jump_portable(p, pattern, v, most, e);
#endif
  if (done == 0) return 0;
  VelocityChange& c = p.change;
  if (p.motor_inverse_mass > 0) {
    p.motor_impulse += e[0];
    c.support += p.motor_inverse_mass * e[0];
  }
  for (int k = 0; k < p.count; ++k) {
    const auto i = static_cast<std::size_t>(k);
    ContactRows& r = p.rows[i];
    if (v.normal[i] >= 0) {
      const double n = e[v.normal[i]];
      r.n += n;
      c.w0 += r.nd0 * n;
      c.w1 += r.nd1 * n;
      c.w2 += r.nd2 * n;
      c.z += p.inverse_mass * n;
    }
    if (v.spin[i] >= 0) {
      const double s = e[v.spin[i]];
      r.s += s;
      c.w0 += r.sd0 * s;
      c.w1 += r.sd1 * s;
      c.w2 += r.sd2 * s;
    }
    if (v.lateral[i] >= 0) {
      const double a = e[v.lateral[i]];
      const double b = e[v.lateral[i] + 1];
      r.a += a;
      r.b += b;
      c.w0 += r.ad0 * a + r.bd0 * b;
      c.w1 += r.ad1 * a + r.bd1 * b;
      c.w2 += r.ad2 * a + r.bd2 * b;
      c.y -= p.inverse_mass * a;
      c.x += p.inverse_mass * b;
      c.support -= p.motor_inverse_mass * b;
    }
  }
  return done;
}

}  // namespace

int solve(ContactProblem& problem, int sweeps, double threshold) {
  Pattern pattern;
  int single = 0;
  int wait = 1;
  for (int left = sweeps; left > 0;) {
    const double residual = sweep(problem, pattern);
    ++single;
    --left;
    if (threshold > 0.0) {
      if (residual * residual <= threshold) break;
      continue;
    }
    if (residual == 0.0) break;
    if (left == 0 || --wait > 0) continue;
    left -= jump(problem, pattern, left);
    wait = 1;
  }
  return single;
}

}  // namespace vsr2
