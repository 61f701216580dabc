#pragma once
// Numbers of one trial, of a register of trials, and of the four contacts of a trial: one arithmetic, so
// that a kernel is written once. Every lane rounds as a scalar does.
//
// Included by kernels.cpp alone, which is compiled for each level of the processor; hence the namespace.

#include <cmath>
#include <cstdint>
#include <type_traits>

#include <immintrin.h>

#include "always_inline.hpp"

namespace vsr2::lanes::LEVEL {

template <int kLanes>
struct Of {
  typedef double Number __attribute__((vector_size(kLanes * sizeof(double))));
  typedef float Single __attribute__((vector_size(kLanes * sizeof(float))));
  typedef std::int64_t Flag __attribute__((vector_size(kLanes * sizeof(std::int64_t))));
};
template <>
struct Of<1> {
  typedef double Number;
  typedef float Single;
};

template <typename T>
constexpr bool kIsOne = std::is_arithmetic_v<T>;
template <typename T>
using Mask = decltype(T{} < T{});

/// Lanes of a number or mask.
template <typename T>
constexpr int lanes_of() {
  if constexpr (kIsOne<T>) return 1;
  else return sizeof(T) / sizeof(T{}[0]);
}
template <typename T>
VSR2_INLINE auto lane(const T& value, int i) {
  if constexpr (kIsOne<T>) return value;
  else return value[i];
}
template <typename T, typename Value>
VSR2_INLINE void set_lane(T& value, int i, Value to) {
  if constexpr (kIsOne<T>) value = to;
  else value[i] = to;
}
template <typename T>
VSR2_INLINE T all(double value) {
  using One = std::decay_t<decltype(lane(T{}, 0))>;
  return T{} + static_cast<One>(value);
}

template <typename T>
VSR2_INLINE T select(const Mask<T>& which, const T& yes, const T& no) {
  return which ? yes : no;
}
template <typename M>
VSR2_INLINE M both(const M& a, const M& b) {
  if constexpr (kIsOne<M>) return a && b;
  else return a & b;
}
template <typename M>
VSR2_INLINE M either(const M& a, const M& b) {
  if constexpr (kIsOne<M>) return a || b;
  else return a | b;
}
template <typename M>
VSR2_INLINE M opposite(const M& a) {
  if constexpr (kIsOne<M>) return !a;
  else return ~a;
}

/// A bit for each lane of a mask.
template <typename M>
VSR2_INLINE unsigned bits(const M& mask) {
  if constexpr (kIsOne<M>) {
    return mask;
  } else if constexpr (sizeof(mask[0]) == 4) {
    return bits(__builtin_convertvector(mask, typename Of<sizeof(M) / 4>::Flag));
  } else {
    unsigned out = 0;
    const auto* part = reinterpret_cast<const char*>(&mask);
#if defined(__AVX512DQ__)
    if constexpr (sizeof(M) >= 64) {
      for (unsigned i = 0; i < sizeof(M) / 64; ++i)
        out |= static_cast<unsigned>(_mm512_movepi64_mask(_mm512_loadu_si512(part + 64 * i))) << (8 * i);
      return out;
    }
#endif
#if defined(__AVX2__)
    for (unsigned i = 0; i < sizeof(M) / 32; ++i)
      out |= static_cast<unsigned>(_mm256_movemask_pd(
                 _mm256_loadu_pd(reinterpret_cast<const double*>(part + 32 * i)))) << (4 * i);
#else
    for (unsigned i = 0; i < sizeof(M) / 16; ++i)
      out |= static_cast<unsigned>(_mm_movemask_pd(
                 _mm_loadu_pd(reinterpret_cast<const double*>(part + 16 * i)))) << (2 * i);
#endif
    return out;
  }
}
template <typename M>
VSR2_INLINE bool any(const M& mask) {
  return bits(mask) != 0;
}

template <typename T>
VSR2_INLINE T root(const T& x) {
  if constexpr (kIsOne<T>) {
    return std::sqrt(x);
  } else {
    T out;
    for (int i = 0; i < lanes_of<T>(); ++i) out[i] = std::sqrt(x[i]);
    return out;
  }
}
template <typename T>
VSR2_INLINE T size(const T& x) {
  if constexpr (kIsOne<T>) return std::fabs(x);
  else return x < 0.0 ? -x : x;
}
template <typename T>
VSR2_INLINE T greater(const T& a, const T& b) {
  return select<T>(a < b, b, a);
}
template <typename T>
VSR2_INLINE T lesser(const T& a, const T& b) {
  return select<T>(b < a, b, a);
}
template <typename T>
VSR2_INLINE T clamped(const T& x, double limit) {
  return lesser<T>(greater<T>(x, all<T>(-limit)), all<T>(limit));
}
/// To the other precision.
template <typename To, typename From>
VSR2_INLINE To as(const From& from) {
  if constexpr (kIsOne<To>) return static_cast<To>(from);
  else return __builtin_convertvector(from, To);
}

// For the four contacts, too.
template <typename A, typename B>
VSR2_INLINE auto above(const A& a, const B& b) {
  return a > b;
}
template <typename M, typename T>
VSR2_INLINE T pick(const M& which, const T& yes, const T& no) {
  return which ? yes : no;
}

/// A value of each of four contacts, each a register of its own.
template <typename T>
struct Four {
  T at[4];
};
template <typename Make>
VSR2_INLINE auto each(Make make) {
  return Four<std::decay_t<decltype(make(0))>>{{make(0), make(1), make(2), make(3)}};
}
// Between four values, and of four values with one.
#define VSR2_EACH(name, ...)                                                                       \
  template <typename T>                                                                           \
  VSR2_INLINE auto name(const Four<T>& a, const Four<T>& b) {                                     \
    return each([&](int k) VSR2_INLINE_LAMBDA { const T &x = a.at[k], &y = b.at[k]; return __VA_ARGS__; }); \
  }                                                                                               \
  template <typename T>                                                                           \
  VSR2_INLINE auto name(const Four<T>& a, const T& y) {                                           \
    return each([&](int k) VSR2_INLINE_LAMBDA { const T& x = a.at[k]; return __VA_ARGS__; });      \
  }                                                                                               \
  template <typename T>                                                                           \
  VSR2_INLINE auto name(const T& x, const Four<T>& b) {                                           \
    return each([&](int k) VSR2_INLINE_LAMBDA { const T& y = b.at[k]; return __VA_ARGS__; });      \
  }
VSR2_EACH(operator+, x + y)
VSR2_EACH(operator-, x - y)
VSR2_EACH(operator*, x* y)
VSR2_EACH(operator/, x / y)
VSR2_EACH(above, above(x, y))
VSR2_EACH(both, both<T>(x, y))
VSR2_EACH(either, either<T>(x, y))
#undef VSR2_EACH
template <typename M>
VSR2_INLINE Four<M> opposite(const Four<M>& a) {
  return each([&](int k) VSR2_INLINE_LAMBDA { return opposite(a.at[k]); });
}
template <typename M, typename T>
VSR2_INLINE Four<T> pick(const Four<M>& which, const Four<T>& yes, const Four<T>& no) {
  return each([&](int k) VSR2_INLINE_LAMBDA { return select<T>(which.at[k], yes.at[k], no.at[k]); });
}
template <typename T>
VSR2_INLINE Four<T> size(const Four<T>& a) {
  return each([&](int k) VSR2_INLINE_LAMBDA { return size(a.at[k]); });
}

/// The same side by side in one register, of one trial.
using Row = Of<4>::Number;

// Of contact k.
template <typename T>
VSR2_INLINE const T& of(const Four<T>& four, int k) {
  return four.at[k];
}
template <typename V>
VSR2_INLINE auto of(const V& row, int k) {
  if constexpr (std::is_floating_point_v<std::decay_t<decltype(row[0])>>) return row[k];
  else return row[k] != 0;
}
template <typename T>
VSR2_INLINE void put(Four<T>& four, int k, const T& value) {
  four.at[k] = value;
}
template <typename V, typename Value>
VSR2_INLINE void put(V& row, int k, Value value) {
  if constexpr (std::is_same_v<Value, bool>) row[k] = -static_cast<std::int64_t>(value);
  else row[k] = value;
}

/// Of one contact, and the flags of all four.
template <typename F>
using One = std::decay_t<decltype(of(F{}, 0))>;
template <typename F>
using Flags = decltype(above(F{}, F{}));

template <typename F>
VSR2_INLINE F four(const One<F>& value) {
  F out;
  for (int k = 0; k < 4; ++k) put(out, k, value);
  return out;
}
/// In the order in which a loop adds.
template <typename F>
VSR2_INLINE One<F> sum(const F& four) {
  return ((of(four, 0) + of(four, 1)) + of(four, 2)) + of(four, 3);
}
/// Whether any contact has the flag.
template <typename G>
VSR2_INLINE auto some(const G& flags) {
  return either(either(of(flags, 0), of(flags, 1)), either(of(flags, 2), of(flags, 3)));
}

}  // namespace vsr2::lanes::LEVEL
