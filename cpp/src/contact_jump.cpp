#include "contact_jump.hpp"

#include <algorithm>
#include <cmath>

#include "hull_scan.hpp"
#include "linear_form.hpp"
#include "vsr2/constants.hpp"

namespace vsr2 {
namespace {

// Motor, 4 normal, 4 spinning and 8 lateral rows.
constexpr int kMostVariables = 17;
// Jumps of up to 2^23 sweeps; a study has at most 1e5, and longer ways take several jumps.
constexpr int kMostPowers = 24;
// Changes below this part of the greatest impulse are rounding: a few units in the last place, 2e-16.
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
    if (p.joint == Joint::motor) ++count;
    for (std::size_t i = 0; i < contacts; ++i)
      if (pattern.closed[i]) normal[i] = count++;
    bool stopped = false;
    for (std::size_t i = 0; i < contacts; ++i) {
      if (!pattern.closed[i] || !(p.rows[i].bounds.spinning(1.0) > 0)) continue;
      const bool is_free = pattern.spin[i] == Pattern::free;
      if (!is_free || !stopped) spin[i] = count++;
      stopped = is_free;
    }
    for (std::size_t i = 0; i < contacts; ++i) {
      if (!pattern.closed[i] || !(p.rows[i].bounds.lateral(1.0) > 0)) continue;
      lateral[i] = count;
      count += 2;
    }
  }
};

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
    with_joint(p.joint, [this](auto joint) VSR2_INLINE_LAMBDA { linearise<joint>(); });
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
    VSR2_INLINE double operator[](int r) const { return reinterpret_cast<const double*>(group)[r]; }
    VSR2_INLINE void set(int r, double value) { reinterpret_cast<double*>(group)[r] = value; }
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

  using Linear = Form<kIn>;

  // A sliding contact's impulse is mu n u / |u|, with u the pair before its bound.
  struct Slide {
    double cosine, sine;  // of u
    double turn;          // mu n / |u|
    explicit Slide(const ContactRows& rows) {
      const double u_1 = rows.lateral_1.unbounded, u_2 = rows.lateral_2.unbounded;
      const double length = std::sqrt(u_1 * u_1 + u_2 * u_2);
      cosine = u_1 / length;
      sine = u_2 / length;
      turn = rows.bounds.lateral(rows.normal.impulse) / length;
    }
    Slide() = default;
  };

  // Rows of linear forms, within the pattern.
  class FormRows {
   public:
    VSR2_INLINE explicit FormRows(Jump& jump) : jump_(jump) {
      for (int q = 1; q < jump.count_; ++q) variable_[q].set(q - 1, 1.0);
    }

    VSR2_INLINE Linear& motor() { return variable_[0]; }
    VSR2_INLINE Linear& normal(std::size_t i) {
      return jump_.v_.normal[i] < 0 ? open_[i] : variable_[jump_.v_.normal[i]];
    }
    VSR2_INLINE Linear& spin(std::size_t i) { return variable_[jump_.v_.spin[i]]; }
    VSR2_INLINE Linear& lateral_1(std::size_t i) { return variable_[jump_.v_.lateral[i]]; }
    VSR2_INLINE Linear& lateral_2(std::size_t i) { return variable_[jump_.v_.lateral[i] + 1]; }

    VSR2_INLINE void bound_motor(const Linear&) {}
    VSR2_INLINE void note_motor(const Linear&) {}

    // What an open row would take is noted, and nothing of it applied.
    VSR2_INLINE bool takes_normal(std::size_t i, const Linear& next) {
      if (jump_.v_.normal[i] >= 0) return true;
      open_[i] = next;
      return false;
    }
    VSR2_INLINE bool has_spin(std::size_t i) const { return jump_.v_.spin[i] >= 0; }
    VSR2_INLINE void bound_spin(std::size_t i, Linear& next) {
      const Pattern::Spin at = jump_.pattern_.spin[i];
      if (at == Pattern::free) return;
      jump_.spin_unbounded_[i] = next;
      const double sign = at == Pattern::upper ? 1.0 : -1.0;
      next = sign * jump_.p_.rows[i].bounds.spinning(normal(i));
    }
    VSR2_INLINE bool has_lateral(std::size_t i) const { return jump_.v_.lateral[i] >= 0; }
    VSR2_INLINE void bound_lateral(std::size_t i, Linear& next_1, Linear& next_2) {
      if (!jump_.pattern_.slides[i]) return;
      jump_.lateral_unbounded_1_[i] = next_1;
      jump_.lateral_unbounded_2_[i] = next_2;
      const Slide& slide = jump_.slide_[i];
      const Linear radial = jump_.p_.rows[i].bounds.lateral(normal(i));
      const Linear across = slide.turn * (slide.cosine * next_2 - slide.sine * next_1);
      next_1 = slide.cosine * radial - slide.sine * across;
      next_2 = slide.sine * radial + slide.cosine * across;
    }
    VSR2_INLINE void note_normal(std::size_t, const Linear&) {}
    VSR2_INLINE void note_spin(std::size_t, const Linear&) {}
    VSR2_INLINE void note_lateral(std::size_t, const Linear&, const Linear&) {}

    // Writes the variables' forms, and the open rows', as columns of the map.
    VSR2_INLINE void put() const {
      State* column = jump_.power_[0].column;
      Lanes* open = jump_.open_;
      for (int w = 0; w < kIn; ++w) {
        for (int o = 0; o < kOut; ++o)
          transpose(&variable_[4 * o], w, column[4 * w].group[o], column[4 * w + 1].group[o],
                    column[4 * w + 2].group[o], column[4 * w + 3].group[o]);
        if (jump_.any_open_)
          transpose(open_, w, open[4 * w], open[4 * w + 1], open[4 * w + 2], open[4 * w + 3]);
      }
    }

   private:
    Jump& jump_;
    Linear variable_[4 * kOut]{};
    Linear open_[4]{};
  };

  // One sweep of the linear parts, as functions of the variables before it.
  template <Joint kJoint>
  VSR2_INLINE void linearise() {
    VelocityChange<Linear> v;  // by a unit of each variable but the first
    change_ = {};
    const auto contacts = static_cast<std::size_t>(p_.count);
    double greatest = 0.0;
    const NormalRow* first = nullptr;
    for (std::size_t i = 0; i < contacts; ++i) {
      const ContactRows& rows = p_.rows[i];
      if (const int q = v_.normal[i]; q >= 0) {
        if (q == 0) first = &rows.normal;
        take<kJoint>(rows.normal, q, v);
        greatest = std::max(greatest, rows.normal.impulse);
      }
      if (const int q = v_.spin[i]; q >= 0) take<kJoint>(rows.spin, q, v);
      if (const int q = v_.lateral[i]; q >= 0) {
        if (pattern_.slides[i]) slide_[i] = Slide(rows);
        take<kJoint>(rows.lateral_1, q, v);
        take<kJoint>(rows.lateral_2, q + 1, v);
      }
    }
    if constexpr (kJoint == Joint::motor) {
      change_.set(0, p_.motor.change);
      greatest = std::max(greatest, std::fabs(p_.motor.impulse));
    }
    rounding_ = kRounding * greatest;
    for (std::size_t i = 0; i < contacts; ++i) {
      before_first_[i] = 0.0;
      if (v_.normal[i] == 0) first = nullptr;
      if (v_.normal[i] >= 0) continue;
      any_open_ = true;
      // Before the first variable's turn its old value still counts.
      if (first == nullptr) continue;
      VelocityChange<double> unit;
      first->template apply<kJoint>(1.0, unit);
      before_first_[i] = -p_.rows[i].normal.template speed<kJoint>(unit);
    }
    FormRows rows(*this);
    sweep<kJoint>(p_, rows, v);
    rows.put();
    if (any_open_) find_open_base();
  }

  // Takes a row as variable `q`: its latest change, and the velocities by a unit of it.
  template <Joint kJoint, typename Row>
  VSR2_INLINE void take(const Row& row, int q, VelocityChange<Linear>& v) {
    change_.set(q, row.change);
    if (q == 0) return;
    row.template respond<kJoint>(v, [q](Linear& velocity, double response) VSR2_INLINE_LAMBDA {
      velocity.set(q - 1, response);
    });
  }

  VSR2_INLINE void find_open_base() {
    open_base_ = Lanes{-1.0, -1.0, -1.0, -1.0};  // of closed contacts they stay
    for (std::size_t i = 0; i < static_cast<std::size_t>(p_.count); ++i)
      if (v_.normal[i] < 0) open_base_[i] = p_.rows[i].normal.unbounded;
    for (int q = 0; q < count_ - 1; ++q) open_base_ += change_[q + 1] * open_[q];
    for (int i = 0; i < 4; ++i) open_first_[i] = i < p_.count ? before_first_[i] : 0.0;
    open_base_ += change_[0] * open_first_;
  }

  // Whether the pattern is that of the state `e` further on, and of the unbounded values in the
  // sweep after it.
  VSR2_INLINE bool holds(const State& e) const {
    if (p_.joint == Joint::motor && !(std::fabs(p_.motor.impulse + e[0]) < p_.motor.limit))
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
      const double n = r.normal.impulse + e[v_.normal[i]];
      if (!(n > 0.0 && n < kGreatestImpulse)) return false;
      if (pattern_.spin[i] == Pattern::free) {
        const double s = v_.spin[i] < 0 ? r.spin.impulse : r.spin.impulse + e[v_.spin[i]];
        if (!(std::fabs(s) <= r.bounds.spinning(n))) return false;
      }
      const int q = v_.lateral[i];
      if (q >= 0 && !pattern_.slides[i]) {
        const double limit = r.bounds.lateral(n);
        const double a = r.lateral_1.impulse + e[q];
        const double b = r.lateral_2.impulse + e[q + 1];
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
    double n = r.normal.impulse;
    for (int q = 0; q < count_ - 1; ++q) n += next[q] * power_[0].column[q][v_.normal[i]];
    if (v_.spin[i] >= 0 && pattern_.spin[i] != Pattern::free) {
      const double s = r.spin.unbounded + spin_unbounded_[i].of(next);
      if (!((pattern_.spin[i] == Pattern::upper ? s : -s) > r.bounds.spinning(n))) return false;
    }
    if (v_.lateral[i] < 0 || !pattern_.slides[i]) return true;
    const double limit = r.bounds.lateral(n);
    const double a = r.lateral_1.unbounded + lateral_unbounded_1_[i].of(next);
    const double b = r.lateral_2.unbounded + lateral_unbounded_2_[i].of(next);
    const double u_1 = r.lateral_1.unbounded, u_2 = r.lateral_2.unbounded;
    return a * a + b * b >= limit * limit &&
           std::fabs(a * u_2 - b * u_1) <= kSweep.greatest_turn * (u_1 * u_1 + u_2 * u_2);
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
  Slide slide_[4];
  Linear spin_unbounded_[4];
  Linear lateral_unbounded_1_[4];
  Linear lateral_unbounded_2_[4];
  Power power_[kMostPowers];
};

VSR2_INLINE int jump_any(const ContactProblem& p, const Pattern& pattern, const Variables& v,
                         int most, double* e) {
  if (v.count <= 4) return Jump<1, 1>(p, pattern, v).run(most, e);
  if (v.count <= 8) return Jump<2, 2>(p, pattern, v).run(most, e);
  if (v.count <= 12) return Jump<3, 3>(p, pattern, v).run(most, e);
  if (v.count <= 13) return Jump<4, 3>(p, pattern, v).run(most, e);
  return Jump<5, 4>(p, pattern, v).run(most, e);
}

int jump_portable(const ContactProblem& p, const Pattern& pattern, const Variables& v, int most,
                  double* e) {
  return jump_any(p, pattern, v, most, e);
}

#if defined(__x86_64__) && defined(__GNUC__)
__attribute__((target("avx2")))
#endif
int jump_avx2(const ContactProblem& p, const Pattern& pattern, const Variables& v, int most, double* e) {
  return jump_any(p, pattern, v, most, e);
}

// Adds the changes `e` of the variables to the impulses and velocities.
template <Joint kJoint>
void add(ContactProblem& p, const Variables& v, const double* e) {
  if constexpr (kJoint == Joint::motor) {
    p.motor.impulse += e[0];
    p.motor.apply(e[0], p.change);
  }
  const auto add_to = [&](auto& row, double amount) {
    row.impulse += amount;
    row.template apply<kJoint>(amount, p.change);
  };
  for (std::size_t i = 0; i < static_cast<std::size_t>(p.count); ++i) {
    ContactRows& rows = p.rows[i];
    if (v.normal[i] >= 0) add_to(rows.normal, e[v.normal[i]]);
    if (v.spin[i] >= 0) add_to(rows.spin, e[v.spin[i]]);
    if (const int q = v.lateral[i]; q >= 0) {
      rows.lateral_1.impulse += e[q];
      rows.lateral_2.impulse += e[q + 1];
      apply_pair<kJoint>(rows.lateral_1, e[q], rows.lateral_2, e[q + 1], p.change);
    }
  }
}

}  // namespace

int jump(ContactProblem& p, const Pattern& pattern, int most) {
  if (pattern.motor_bounded || pattern.turning) return 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(p.count); ++i) {
    const ContactRows& r = p.rows[i];  // if just opened, its last impulses are no variables
    if (!pattern.closed[i] &&
        (r.normal.change != 0.0 || r.lateral_1.change != 0.0 || r.lateral_2.change != 0.0)) return 0;
  }
  const Variables v(p, pattern);
  if (v.count == 0) return 0;
  double e[kMostVariables + 4];
  const auto run = instruction_set() == InstructionSet::avx2 ? jump_avx2 : jump_portable;
  const int done = run(p, pattern, v, most, e);
  if (done == 0) return 0;
  with_joint(p.joint, [&](auto joint) { add<joint>(p, v, e); });
  return done;
}

}  // namespace vsr2
