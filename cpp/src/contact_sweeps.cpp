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
template <bool kMotor, bool kSprung>
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
    double along = (r.nj0 * c.w0 + r.nj1 * c.w1) + r.njz * c.z;
    if constexpr (kSprung) along += r.njs * c.support;
    const double sum = (r.n * r.nkeep + r.nrhs) - along;
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
    if constexpr (kSprung) c.support += r.nds * delta;
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
    double turn = r.sj * c.w2;
    if constexpr (kSprung) turn += r.sjs * c.support;
    const double sum = (r.s + r.srhs) - turn;
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
    if constexpr (kSprung) c.support += r.sds * delta;
    note(delta * r.sk);
  }
  for (std::size_t i = 0; i < count; ++i) {
    ContactRows& r = p.rows[i];
    r.da = r.db = 0.0;
    if (!(r.n > 0.0) && r.a == 0.0 && r.b == 0.0) continue;
    const double limit = r.friction * r.n;
    double across = (r.aj0 * c.w0 + r.aj2 * c.w2) + r.ajy * c.y;
    if constexpr (kSprung) across += r.ajs * c.support;
    double a = (r.a + r.arhs) - across;
    double along = (r.bj1 * c.w1 + r.bj2 * c.w2) + r.bjx * c.x;
    if constexpr (kMotor || kSprung) along += r.bjs * c.support;
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
    if constexpr (kSprung) c.support += r.ads * da + r.bds * db;
    note(da * r.ak + db * r.bk);
  }
  p.change = c;
  return greatest;
}

double sweep(ContactProblem& p, Pattern& pattern) {
  if (p.sprung) return sweep<false, true>(p, pattern);
  return p.motor_inverse_mass > 0 ? sweep<true, false>(p, pattern) : sweep<false, false>(p, pattern);
}

// Four doubles that the compiler maps on what vector registers there are; every lane rounds as a
// scalar does.
typedef double Lanes __attribute__((vector_size(4 * sizeof(double)), may_alias));

// Motor, 4 normal, 4 spinning and 8 lateral rows.
constexpr int kMostVariables = 17;
constexpr int kMostPowers = 24;
// Changes below this part of the greatest impulse are rounding.
constexpr double kRounding = 1e-15;

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
    for (std::size_t i = 0; i < contacts; ++i) {
      if (!pattern.closed[i] || !(p.rows[i].friction > 0)) continue;
      lateral[i] = count;
      count += 2;
    }
  }
};

VSR2_INLINE void transpose(const Lanes& a, const Lanes& b, const Lanes& c, const Lanes& d,
                           Lanes& p, Lanes& q, Lanes& r, Lanes& s) {
  const Lanes ab_low = __builtin_shufflevector(a, b, 0, 4, 2, 6);
  const Lanes ab_high = __builtin_shufflevector(a, b, 1, 5, 3, 7);
  const Lanes cd_low = __builtin_shufflevector(c, d, 0, 4, 2, 6);
  const Lanes cd_high = __builtin_shufflevector(c, d, 1, 5, 3, 7);
  p = __builtin_shufflevector(ab_low, cd_low, 0, 1, 4, 5);
  q = __builtin_shufflevector(ab_high, cd_high, 0, 1, 4, 5);
  r = __builtin_shufflevector(ab_low, cd_low, 2, 3, 6, 7);
  s = __builtin_shufflevector(ab_high, cd_high, 2, 3, 6, 7);
}

// From a state and its latest sweep on: a sweep is an affine map of the impulses, and their change e
// in m more sweeps follows e_(k+m) = A^m e_k + c_m. The first variable's own value does not count in
// a Gauss-Seidel sweep, so A has a column for each variable but that.
//
// kOut and kIn: groups of four that hold all variables, and all but the first.
template <int kOut, int kIn>
class Jump {
 public:
  VSR2_INLINE Jump(const ContactProblem& p, const Pattern& pattern, const Variables& variables)
      : p_(p), pattern_(pattern), v_(variables), count_(variables.count) {
    p.sprung ? linearise<true>() : linearise<false>();
  }

  // Sweeps jumped, at most `most`; `e` then holds the change of every variable.
  VSR2_INLINE int run(int most, double* e) {
    State now{};
    if (!holds(now)) return 0;
    // c_1 = A d, of the latest sweep's changes d.
    add_product(power_[0], change_, now);
    if (!holds(now)) return 0;
    power_[0].c = now;
    int level = 0;
    int done = 1;
    while (2 * done <= most && level + 1 < kMostPowers) {
      // c_2m = A^m c_m + c_m
      State next = now;
      add_product(power_[level], now, next);
      if (!holds(next)) break;
      const double greatest = greatest_difference(next, now);
      now = next;
      ++level;
      done *= 2;
      if (greatest <= rounding_) {
        done = most;
        break;
      }
      power_[level].c = now;
      if (2 * done <= most) square(power_[level - 1], power_[level]);
    }
    for (int i = level - 1; i >= 0 && done < most; --i) {
      const int step = 1 << i;
      if (done + step > most) continue;
      State next = power_[i].c;
      add_product(power_[i], now, next);
      if (!holds(next)) continue;
      now = next;
      done += step;
    }
    for (int r = 0; r < count_; ++r) e[r] = now[r];
    return done;
  }

 private:
  // One value a variable.
  struct State {
    Lanes group[kOut];
    VSR2_INLINE double operator[](int r) const {
      return reinterpret_cast<const double*>(group)[r];
    }
  };
  struct Power {
    State column[4 * kIn];  // the q-th: what a unit of variable q + 1 becomes
    State c;
  };

  // to += A e
  VSR2_INLINE void add_product(const Power& power, const State& e, State& to) const {
    Lanes other[kOut] = {};
    int q = 0;
    for (; q + 2 < count_; q += 2) {
      for (int w = 0; w < kOut; ++w) {
        to.group[w] += e[q + 1] * power.column[q].group[w];
        other[w] += e[q + 2] * power.column[q + 1].group[w];
      }
    }
    if (q + 1 < count_)
      for (int w = 0; w < kOut; ++w) to.group[w] += e[q + 1] * power.column[q].group[w];
    for (int w = 0; w < kOut; ++w) to.group[w] += other[w];
  }

  static VSR2_INLINE double greatest_difference(const State& a, const State& b) {
    Lanes most{};
    for (int w = 0; w < kOut; ++w) {
      const Lanes d = a.group[w] - b.group[w];
      const Lanes size = d < -d ? -d : d;
      most = most < size ? size : most;
    }
    return std::max(std::max(most[0], most[1]), std::max(most[2], most[3]));
  }

  VSR2_INLINE void square(const Power& from, Power& to) const {
    constexpr int kBlock = kOut <= 2 ? 4 : kOut <= 4 ? 2 : 1;
    for (int first = 0; first < count_ - 1; first += kBlock) {
      Lanes sum[kBlock * kOut] = {};
      for (int r = 0; r < count_ - 1; ++r) {
#pragma GCC unroll 8
        for (int i = 0; i < kBlock * kOut; ++i)
          sum[i] += from.column[first + i / kOut][r + 1] * from.column[r].group[i % kOut];
      }
#pragma GCC unroll 8
      for (int i = 0; i < kBlock * kOut; ++i) to.column[first + i / kOut].group[i % kOut] = sum[i];
    }
  }

  // A linear function of the variables but the first, its weights in their order.
  struct Linear {
    Lanes group[kIn];
    VSR2_INLINE double of(const double* columns) const {
      Lanes sum = group[0] * reinterpret_cast<const Lanes*>(columns)[0];
      for (int w = 1; w < kIn; ++w)
        sum += group[w] * reinterpret_cast<const Lanes*>(columns)[w];
      return (sum[0] + sum[1]) + (sum[2] + sum[3]);
    }
    VSR2_INLINE void set(int q, double weight) { reinterpret_cast<double*>(group)[q] = weight; }
  };

  template <bool kSprung>
  VSR2_INLINE void subtract_normal(const ContactRows& r, const Linear& w0, const Linear& w1,
                                   const Linear& vz, const Linear& support, int w,
                                   Lanes& from) const {
    Lanes speed = (r.nj0 * w0.group[w] + r.nj1 * w1.group[w]) + r.njz * vz.group[w];
    if constexpr (kSprung) speed += r.njs * support.group[w];
    from -= speed;
  }

  // One sweep of the linear parts, as functions of the variables before it.
  template <bool kSprung>
  VSR2_INLINE void linearise() {
    Linear x[4 * kOut] = {};  // the variables
    Linear w0{}, w1{}, w2{}, vx{}, vy{}, vz{}, support{};  // the speeds
    Linear open[4] = {};
    double d[4 * kOut] = {};
    const auto contacts = static_cast<std::size_t>(p_.count);
    const bool motor = p_.motor_inverse_mass > 0;
    for (int q = 1; q < count_; ++q) x[q].set(q - 1, 1.0);
    double greatest = 0.0;
    const ContactRows* first = nullptr;
    for (std::size_t i = 0; i < contacts; ++i) {
      const ContactRows& r = p_.rows[i];
      if (const int q = v_.normal[i]; q >= 0) {
        if (q == 0) {
          first = &r;
        } else {
          w0.set(q - 1, r.nd0);
          w1.set(q - 1, r.nd1);
          w2.set(q - 1, r.nd2);
          vz.set(q - 1, p_.inverse_mass);
          if constexpr (kSprung) support.set(q - 1, r.nds);
        }
        d[q] = r.dn;
        greatest = std::max(greatest, r.n);
      }
      if (const int q = v_.spin[i]; q >= 0) {
        w0.set(q - 1, r.sd0);
        w1.set(q - 1, r.sd1);
        w2.set(q - 1, r.sd2);
        if constexpr (kSprung) support.set(q - 1, r.sds);
        d[q] = r.ds;
      }
      if (const int q = v_.lateral[i]; q >= 0) {
        w0.set(q - 1, r.ad0);
        w1.set(q - 1, r.ad1);
        w2.set(q - 1, r.ad2);
        vy.set(q - 1, -p_.inverse_mass);
        w0.set(q, r.bd0);
        w1.set(q, r.bd1);
        w2.set(q, r.bd2);
        vx.set(q, p_.inverse_mass);
        support.set(q, r.bds);
        if constexpr (kSprung) support.set(q - 1, r.ads);
        d[q] = r.da;
        d[q + 1] = r.db;
      }
    }
    if (motor) {
      d[0] = p_.motor_change;
      greatest = std::max(greatest, std::fabs(p_.motor_impulse));
      for (int w = 0; w < kIn; ++w) {
        x[0].group[w] = -support.group[w] / p_.motor_inverse_mass;
        support.group[w] = Lanes{};
      }
    }
    rounding_ = kRounding * greatest;
    std::copy(d, d + 4 * kOut, reinterpret_cast<double*>(change_.group));
    for (std::size_t i = 0; i < contacts; ++i) {
      const ContactRows& r = p_.rows[i];
      const int q = v_.normal[i];
      before_first_[i] = 0.0;
      if (q < 0) {
        any_open_ = true;
        for (int w = 0; w < kIn; ++w)
          subtract_normal<kSprung>(r, w0, w1, vz, support, w, open[i].group[w]);
        // Before the first variable's turn its old value still counts.
        if (first != nullptr)
          before_first_[i] = -((r.nj0 * first->nd0 + r.nj1 * first->nd1) + r.njz * p_.inverse_mass +
                               (kSprung ? r.njs * first->nds : 0.0));
        continue;
      }
      if (q == 0) first = nullptr;
      for (int w = 0; w < kIn; ++w) {
        Lanes next = x[q].group[w] * r.nkeep;
        subtract_normal<kSprung>(r, w0, w1, vz, support, w, next);
        const Lanes delta = next - x[q].group[w];
        x[q].group[w] = next;
        w0.group[w] += r.nd0 * delta;
        w1.group[w] += r.nd1 * delta;
        w2.group[w] += r.nd2 * delta;
        vz.group[w] += p_.inverse_mass * delta;
        if constexpr (kSprung) support.group[w] += r.nds * delta;
      }
    }
    for (std::size_t i = 0; i < contacts; ++i) {
      const ContactRows& r = p_.rows[i];
      const int q = v_.spin[i];
      if (q < 0) continue;
      const double sign = pattern_.spin[i] == Pattern::upper ? 1.0 : -1.0;
      for (int w = 0; w < kIn; ++w) {
        Lanes next = x[q].group[w] - r.sj * w2.group[w];
        if constexpr (kSprung) next -= r.sjs * support.group[w];
        if (pattern_.spin[i] != Pattern::free) {
          spin_sum_[i].group[w] = next;
          next = (sign * p_.spinning_friction) * x[v_.normal[i]].group[w];
        }
        const Lanes delta = next - x[q].group[w];
        x[q].group[w] = next;
        w0.group[w] += r.sd0 * delta;
        w1.group[w] += r.sd1 * delta;
        w2.group[w] += r.sd2 * delta;
        if constexpr (kSprung) support.group[w] += r.sds * delta;
      }
    }
    for (std::size_t i = 0; i < contacts; ++i) {
      const ContactRows& r = p_.rows[i];
      const int q = v_.lateral[i];
      if (q < 0) continue;
      for (int w = 0; w < kIn; ++w) {
        Lanes a = x[q].group[w] -
                  ((r.aj0 * w0.group[w] + r.aj2 * w2.group[w]) + r.ajy * vy.group[w]);
        if constexpr (kSprung) a -= r.ajs * support.group[w];
        Lanes along = (r.bj1 * w1.group[w] + r.bj2 * w2.group[w]) + r.bjx * vx.group[w];
        if (motor || kSprung) along += r.bjs * support.group[w];
        Lanes b = x[q + 1].group[w] - along;
        if (pattern_.slides[i]) {
          a_sum_[i].group[w] = a;
          b_sum_[i].group[w] = b;
          // The impulse is mu n u / |u| with u = (a, b) before the bound.
          const double length = std::sqrt(r.a_sum * r.a_sum + r.b_sum * r.b_sum);
          const double ua = r.a_sum / length;
          const double ub = r.b_sum / length;
          const double turn = r.friction * r.n / length;
          const Lanes normal = r.friction * x[v_.normal[i]].group[w];
          const Lanes across = turn * (ua * b - ub * a);
          a = ua * normal - ub * across;
          b = ub * normal + ua * across;
        }
        const Lanes da = a - x[q].group[w];
        const Lanes db = b - x[q + 1].group[w];
        x[q].group[w] = a;
        x[q + 1].group[w] = b;
        w0.group[w] += r.ad0 * da + r.bd0 * db;
        w1.group[w] += r.ad1 * da + r.bd1 * db;
        w2.group[w] += r.ad2 * da + r.bd2 * db;
        vy.group[w] -= p_.inverse_mass * da;
        vx.group[w] += p_.inverse_mass * db;
        if (motor) support.group[w] -= p_.motor_inverse_mass * db;
        if constexpr (kSprung) support.group[w] += r.ads * da + r.bds * db;
      }
    }
    State* column = power_[0].column;
    for (int w = 0; w < kIn; ++w) {
      for (int o = 0; o < kOut; ++o)
        transpose(x[4 * o].group[w], x[4 * o + 1].group[w], x[4 * o + 2].group[w],
                  x[4 * o + 3].group[w], column[4 * w].group[o], column[4 * w + 1].group[o],
                  column[4 * w + 2].group[o], column[4 * w + 3].group[o]);
      if (any_open_)
        transpose(open[0].group[w], open[1].group[w], open[2].group[w], open[3].group[w],
                  open_[4 * w], open_[4 * w + 1], open_[4 * w + 2], open_[4 * w + 3]);
    }
    if (!any_open_) return;
    // Of closed contacts they stay at -1.
    open_base_ = Lanes{-1.0, -1.0, -1.0, -1.0};
    for (std::size_t i = 0; i < contacts; ++i)
      if (v_.normal[i] < 0) open_base_[i] = p_.rows[i].n_sum;
    for (int q = 0; q < count_ - 1; ++q) open_base_ += change_[q + 1] * open_[q];
    for (int i = 0; i < 4; ++i) open_first_[i] = i < p_.count ? before_first_[i] : 0.0;
    open_base_ += change_[0] * open_first_;
  }

  // Whether the pattern is that of the state `e` further on, and of the unbounded values in the
  // sweep after it.
  VSR2_INLINE bool holds(const State& e) const {
    if (p_.motor_inverse_mass > 0 && !(std::fabs(p_.motor_impulse + e[0]) < p_.motor_limit))
      return false;
    if (any_open_) {
      Lanes open = open_base_ + e[0] * open_first_;
      for (int q = 0; q < count_ - 1; ++q) open += e[q + 1] * open_[q];
      if (!(open[0] <= 0.0 && open[1] <= 0.0 && open[2] <= 0.0 && open[3] <= 0.0)) return false;
    }
    for (int k = 0; k < p_.count; ++k) {
      const auto i = static_cast<std::size_t>(k);
      if (v_.normal[i] < 0) continue;
      const ContactRows& r = p_.rows[i];
      const double n = r.n + e[v_.normal[i]];
      if (!(n > 0.0 && n < kGreatestImpulse)) return false;
      if (pattern_.spin[i] == Pattern::free) {
        const double s = v_.spin[i] < 0 ? r.s : r.s + e[v_.spin[i]];
        if (!(std::fabs(s) <= p_.spinning_friction * n)) return false;
      }
      const int q = v_.lateral[i];
      if (q >= 0 && !pattern_.slides[i]) {
        const double limit = r.friction * n;
        const double a = r.a + e[q];
        const double b = r.b + e[q + 1];
        if (!(a * a + b * b < limit * limit)) return false;
      }
      if ((v_.spin[i] >= 0 && pattern_.spin[i] != Pattern::free) ||
          (q >= 0 && pattern_.slides[i]))
        if (!bounds_hold(i, e)) return false;
    }
    return true;
  }

  // Of a contact that slides or whose spinning row is at its bound.
  VSR2_INLINE bool bounds_hold(std::size_t i, const State& e) const {
    const ContactRows& r = p_.rows[i];
    alignas(32) double next[4 * kIn] = {};
    for (int q = 0; q < count_ - 1; ++q) next[q] = e[q + 1] + change_[q + 1];
    double n = r.n;
    for (int q = 0; q < count_ - 1; ++q) n += next[q] * power_[0].column[q][v_.normal[i]];
    if (v_.spin[i] >= 0 && pattern_.spin[i] != Pattern::free) {
      const double s = r.s_sum + spin_sum_[i].of(next);
      if (!((pattern_.spin[i] == Pattern::upper ? s : -s) > p_.spinning_friction * n)) return false;
    }
    if (v_.lateral[i] < 0 || !pattern_.slides[i]) return true;
    const double limit = r.friction * n;
    const double a = r.a_sum + a_sum_[i].of(next);
    const double b = r.b_sum + b_sum_[i].of(next);
    return a * a + b * b >= limit * limit &&
           std::fabs(a * r.b_sum - b * r.a_sum) <=
               kMostTurn * (r.a_sum * r.a_sum + r.b_sum * r.b_sum);
  }

  const ContactProblem& p_;
  const Pattern& pattern_;
  const Variables& v_;
  const int count_;
  double rounding_ = 0.0;
  bool any_open_ = false;
  State change_;  // of the latest sweep
  // What the rows would take without their bounds.
  Lanes open_[4 * kIn];  // of open contacts, by variable
  Lanes open_base_;
  Lanes open_first_;
  double before_first_[4];
  Linear spin_sum_[4];
  Linear a_sum_[4];
  Linear b_sum_[4];
  Power power_[kMostPowers];
};

template <int kOut, int kIn>
VSR2_INLINE int jump_with(const ContactProblem& p, const Pattern& pattern, const Variables& v,
                          int most, double* e) {
  Jump<kOut, kIn> jump(p, pattern, v);
  return jump.run(most, e);
}

VSR2_INLINE int jump_any(const ContactProblem& p, const Pattern& pattern, const Variables& v,
                         int most, double* e) {
  if (v.count <= 4) return jump_with<1, 1>(p, pattern, v, most, e);
  if (v.count <= 8) return jump_with<2, 2>(p, pattern, v, most, e);
  if (v.count <= 12) return jump_with<3, 3>(p, pattern, v, most, e);
  if (v.count <= 13) return jump_with<4, 3>(p, pattern, v, most, e);
  return jump_with<5, 4>(p, pattern, v, most, e);
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
      if (p.sprung) c.support += r.nds * n;
    }
    if (v.spin[i] >= 0) {
      const double s = e[v.spin[i]];
      r.s += s;
      c.w0 += r.sd0 * s;
      c.w1 += r.sd1 * s;
      c.w2 += r.sd2 * s;
      if (p.sprung) c.support += r.sds * s;
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
      c.support += r.bds * b;
      if (p.sprung) c.support += r.ads * a;
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
