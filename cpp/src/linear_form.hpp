#pragma once
// Linear forms in vector registers, as a sweep over the rows of a contact problem takes them in place
// of numbers; private to the core.

#include "always_inline.hpp"

namespace vsr2 {

/// Four doubles that the compiler maps on what vector registers there are; every lane rounds as a
/// scalar does.
typedef double Lanes __attribute__((vector_size(4 * sizeof(double)), may_alias));

// All of these are inlined: no vector passes between functions.
#pragma GCC diagnostic ignored "-Wpsabi"

/// A linear form of some variables: their weights, in groups of four.
template <int kGroups>
struct Form {
  Lanes group[kGroups];

  VSR2_INLINE void set(int q, double weight) { reinterpret_cast<double*>(group)[q] = weight; }
  VSR2_INLINE double of(const double* variables) const {
    Lanes sum = group[0] * reinterpret_cast<const Lanes*>(variables)[0];
    for (int w = 1; w < kGroups; ++w)
      sum += group[w] * reinterpret_cast<const Lanes*>(variables)[w];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
  }

  friend VSR2_INLINE Form operator*(double a, const Form& b) {
    Form out;
    for (int w = 0; w < kGroups; ++w) out.group[w] = a * b.group[w];
    return out;
  }
  friend VSR2_INLINE Form operator/(const Form& a, double b) {
    Form out;
    for (int w = 0; w < kGroups; ++w) out.group[w] = a.group[w] / b;
    return out;
  }
  friend VSR2_INLINE Form operator+(const Form& a, const Form& b) {
    Form out = a;
    return out += b;
  }
  friend VSR2_INLINE Form operator-(const Form& a, const Form& b) {
    Form out;
    for (int w = 0; w < kGroups; ++w) out.group[w] = a.group[w] - b.group[w];
    return out;
  }
  VSR2_INLINE Form operator-() const {
    Form out;
    for (int w = 0; w < kGroups; ++w) out.group[w] = -group[w];
    return out;
  }
  VSR2_INLINE Form& operator+=(const Form& b) {
    for (int w = 0; w < kGroups; ++w) group[w] += b.group[w];
    return *this;
  }
  friend VSR2_INLINE const Form& with_constant(const Form& linear, double) { return linear; }
  friend VSR2_INLINE Form driven(const Form&, const Form&) { return {}; }
};

/// Four forms' weights in group `w`, by variable.
template <int kGroups>
VSR2_INLINE void transpose(const Form<kGroups> rows[4], int w, Lanes& p, Lanes& q, Lanes& r,
                           Lanes& s) {
  const Lanes ab_low = __builtin_shufflevector(rows[0].group[w], rows[1].group[w], 0, 4, 2, 6);
  const Lanes ab_high = __builtin_shufflevector(rows[0].group[w], rows[1].group[w], 1, 5, 3, 7);
  const Lanes cd_low = __builtin_shufflevector(rows[2].group[w], rows[3].group[w], 0, 4, 2, 6);
  const Lanes cd_high = __builtin_shufflevector(rows[2].group[w], rows[3].group[w], 1, 5, 3, 7);
  p = __builtin_shufflevector(ab_low, cd_low, 0, 1, 4, 5);
  q = __builtin_shufflevector(ab_high, cd_high, 0, 1, 4, 5);
  r = __builtin_shufflevector(ab_low, cd_low, 2, 3, 6, 7);
  s = __builtin_shufflevector(ab_high, cd_high, 2, 3, 6, 7);
}

}  // namespace vsr2
