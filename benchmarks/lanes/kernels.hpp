#pragma once
// What the kernels of all levels take and give. No vectors, so that it is the same to all.

#include <cstddef>
#include <cstdint>

namespace vsr2::lanes {

/// A block on a level top that moves along x, and its contact: what all trials share.
struct Block {
  double mass, inertia[3], inverse_inertia[3], half[3];
  double top, height;  ///< of the top over the support's origin, and of that in W [m]
  double breaking, deepest, guard, guard_of_depth, top_half[2];
  double restitution, threshold, softness, erp, friction;
  double gravity, linear_damping, angular_damping, dt;
  double level;     ///< as kSticking.level
  int greedy_sets;  ///< as kSticking.greedy_sets
};

/// State of a trial, or of a register of trials. Contacts are the corners of the lower face.
template <typename T>
struct Rock {
  T p[3], q[4], v[3], w[3];          ///< q as w, x, y, z
  T place_x[4], place_y[4];          ///< where the corner touched, on the support [m]
  T kept[4];                         ///< 1: a contact, 0: none
  T normal[4], lateral_x[4], lateral_y[4];  ///< impulses [N s]
  T held, closed;                    ///< as FastStepper's
};
using OneRock = Rock<double>;
constexpr int kFields = sizeof(OneRock) / sizeof(double);

struct Motion {
  const double* position;  ///< of the support, at every step [m]
  std::int64_t size;
};
struct End {
  OneRock rock;
  std::int64_t steps;
  bool overturned;
};
struct Tally {
  std::int64_t steps = 0;   ///< of all trials
  std::int64_t alone = 0;   ///< of these, by the core's stepper
  std::int64_t passes = 0;  ///< of the register
};

/// The core's step for what a kernel does not take; false: the rock left the top.
using CoreStep = bool (*)(const Block&, OneRock&, double position, double velocity);

/// A trial ends with its motion, or where the rock's axis leans beyond this cosine: 0.75 rad, where a block
/// of 0.4 by 0.95 m is long past its balance at 0.40 rad and its lower face is still the same.
constexpr double kOverturned = 0.73;

/// Steps all trials from `start`.
using RunTrials = Tally (*)(const Block&, const OneRock& start, const Motion*, std::size_t count, CoreStep,
                            End*);
/// One step of one trial; false: it leaves the pattern, and nothing has changed.
using StepOne = bool (*)(const Block&, double position, double velocity, OneRock&);

/// Rows of a contact as ContactRow has them, in Bullet's order: normal, spin, lateral 1 and 2.
template <typename T>
struct SweptRow {
  T first, second, along, response[3], linear_response, target, keep, impulse;
};
template <typename T>
struct SweptProblem {
  SweptRow<T> rows[4][4];
  T friction, lever;
  T angular[3], linear[3];
};
/// So many sweeps over each of the problems.
using SweepAll = void (*)(SweptProblem<double>*, std::size_t count, int sweeps);

struct StepKernel {
  const char* level;
  const char* across;    ///< what lies side by side: "trials", or the "contacts" of one
  const char* impulses;  ///< their precision: "double" or "single"
  int lanes;
  RunTrials run;
};
struct SweepKernel {
  const char* level;
  int lanes;
  SweepAll run;
};
struct Level {
  const StepKernel* steps;
  std::size_t step_count;
  const SweepKernel* sweeps;
  std::size_t sweep_count;
  StepOne one;         ///< scalar
  StepOne one_single;  ///< the same, impulses in single precision
};
namespace portable { Level kernels(); }
namespace avx2 { Level kernels(); }
namespace avx512 { Level kernels(); }

}  // namespace vsr2::lanes
