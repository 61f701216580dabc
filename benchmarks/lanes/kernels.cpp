// The kernels of one level of the processor; LEVEL names it, and the compiler's flags set it.

#include "kernels.hpp"

#include "block_step.hpp"
#include "sweep_in_lanes.hpp"

namespace vsr2::lanes::LEVEL {
namespace {

// Lane i of all fields; a Rock holds nothing else.
template <typename T>
VSR2_INLINE void load(Rock<T>& to, int i, const OneRock& from) {
  auto* fields = reinterpret_cast<T*>(&to);
  const auto* values = reinterpret_cast<const double*>(&from);
  for (int f = 0; f < kFields; ++f) set_lane(fields[f], i, values[f]);
}
template <typename T>
OneRock unloaded(const Rock<T>& from, int i) {
  OneRock out;
  const auto* fields = reinterpret_cast<const T*>(&from);
  auto* values = reinterpret_cast<double*>(&out);
  for (int f = 0; f < kFields; ++f) values[f] = lane(fields[f], i);
  return out;
}

// Trials in lockstep, each in its own phase; a lane is filled again where its trial ends.
template <typename T, typename F, typename S, typename G>
Tally run(const Block& b, const OneRock& start, const Motion* motions, std::size_t count, CoreStep core,
          End* ends) {
  constexpr int n = lanes_of<T>();
  static constexpr double kStill[2] = {0.0, 0.0};
  Tally tally;
  Rock<T> rock;
  const double* at[n];
  std::int64_t left[n], stride[n];
  std::size_t trial[n], next = 0;
  int flying = 0;
  const auto fill = [&](int i) {
    load(rock, i, start);
    if (next == count) {
      at[i] = kStill, stride[i] = 0, left[i] = -1;
      return;
    }
    trial[i] = next;
    at[i] = motions[next].position, stride[i] = 1, left[i] = motions[next].size - 1;
    ++next;
    ++flying;
  };
  for (int i = 0; i < n; ++i) fill(i);
  while (flying > 0) {
    T here, there;
    for (int i = 0; i < n; ++i) set_lane(here, i, at[i][0]), set_lane(there, i, at[i][1]);
    const T velocity = (there - here) / all<T>(b.dt);
    unsigned alone = bits(step<T, F, S, G>(b, here, velocity, rock));
    unsigned off = 0;
    ++tally.passes;
    for (; alone != 0; alone &= alone - 1) {
      const int i = __builtin_ctz(alone);
      OneRock one = unloaded(rock, i);
      if (!core(b, one, lane(here, i), lane(velocity, i))) off |= 1U << i;
      load(rock, i, one);
      ++tally.alone;
    }
    const T& x = rock.q[1];
    const T& y = rock.q[2];
    const unsigned fallen = bits(Mask<T>(1.0 - 2.0 * (x * x + y * y) < kOverturned)) | off;
    for (int i = 0; i < n; ++i) {
      at[i] += stride[i];
      if (--left[i] != 0 && !(fallen >> i & 1U)) continue;
      if (left[i] < 0) continue;
      ends[trial[i]] = {unloaded(rock, i), motions[trial[i]].size - 1 - left[i], (fallen >> i & 1U) != 0};
      tally.steps += ends[trial[i]].steps;
      --flying;
      fill(i);
    }
  }
  return tally;
}

template <typename T>
void sweep_all(SweptProblem<double>* problems, std::size_t count, int sweeps) {
  constexpr int n = lanes_of<T>();
  constexpr int fields = sizeof(SweptProblem<double>) / sizeof(double);
  for (std::size_t at = 0; at + n <= count; at += n) {
    SweptProblem<T> together;
    auto* to = reinterpret_cast<T*>(&together);
    for (int i = 0; i < n; ++i)
      for (int f = 0; f < fields; ++f)
        set_lane(to[f], i, reinterpret_cast<const double*>(&problems[at + i])[f]);
    for (int k = 0; k < sweeps; ++k) sweep(together);
    for (int i = 0; i < n; ++i)
      for (int f = 0; f < fields; ++f)
        reinterpret_cast<double*>(&problems[at + i])[f] = lane(to[f], i);
  }
}

bool one_step(const Block& b, double position, double velocity, OneRock& rock) {
  return !step<double, Four<double>, double, Four<double>>(b, position, velocity, rock);
}
bool one_step_single(const Block& b, double position, double velocity, OneRock& rock) {
  return !step<double, Four<double>, float, Four<float>>(b, position, velocity, rock);
}

template <int n>
using N = typename Of<n>::Number;
template <int n>
using S = typename Of<n>::Single;
template <int n>
constexpr RunTrials trials = run<N<n>, Four<N<n>>, N<n>, Four<N<n>>>;
template <int n>
constexpr RunTrials single = run<N<n>, Four<N<n>>, S<n>, Four<S<n>>>;

#define VSR2_TEXT_OF(x) #x
#define VSR2_TEXT(x) VSR2_TEXT_OF(x)
constexpr const char* kLevel = VSR2_TEXT(LEVEL);

constexpr StepKernel kSteps[] = {
#if defined(__AVX2__)
    {kLevel, "trials", "double", 4, trials<4>},
    {kLevel, "trials", "double", 8, trials<8>},
    {kLevel, "contacts", "double", 4, run<double, Row, double, Row>},
#if defined(__AVX512F__)
    {kLevel, "trials", "single", 8, single<8>},
#else
    {kLevel, "trials", "single", 4, single<4>},
#endif
#else
    {kLevel, "trials", "double", 1, trials<1>},
    {kLevel, "trials", "single", 1, single<1>},
#endif
};
constexpr SweepKernel kSweeps[] = {
#if defined(__AVX2__)
    {kLevel, 4, sweep_all<N<4>>},
    {kLevel, 8, sweep_all<N<8>>},
#else
    {kLevel, 1, sweep_all<N<1>>},
#endif
};

}  // namespace

Level kernels() {
  return {kSteps, sizeof(kSteps) / sizeof(kSteps[0]), kSweeps, sizeof(kSweeps) / sizeof(kSweeps[0]), one_step,
          one_step_single};
}

}  // namespace vsr2::lanes::LEVEL
