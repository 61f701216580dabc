// Times kernels in lanes beside the core's stepper, and compares their bits and numbers.
//
//   lanes FILE ROUNDS
//
// FILE holds doubles: time step [s], the block's size [m] and density [kg/m^3], the values of its material
// in the order of kContactParameters, the number of motions, their lengths, and the samples [m]. Times are
// processor time, everything in turn within a round. lanes.py reads what is printed.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "contact_sweeps.hpp"
#include "fast_stepper.hpp"
#include "kernels.hpp"
#include "scene_shapes.hpp"
#include "vsr2/constants.hpp"

namespace {

using namespace vsr2;
using namespace vsr2::lanes;
using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kSigns[4][2] = {{-1, -1}, {-1, 1}, {1, 1}, {1, -1}};
constexpr int kSettling = 4000;  // steps, after which the block is at rest to the last bits
constexpr std::size_t kProblems = 256;
constexpr int kSweeps = 30;

double cpu_time() {
  timespec now;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

std::vector<double> numbers_of(const char* path) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  if (!file) {
    std::fprintf(stderr, "%s cannot be read\n", path);
    std::exit(2);
  }
  std::vector<double> out(static_cast<std::size_t>(file.tellg()) / sizeof(double));
  file.seekg(0);
  file.read(reinterpret_cast<char*>(out.data()), static_cast<std::streamsize>(out.size() * sizeof(double)));
  return out;
}

// The block, its trials and the core's stepper.
class Work {
 public:
  explicit Work(const std::vector<double>& given) {
    const double* at = given.data();
    EngineSettings engine{.kind = EngineKind::fast, .linear_damping = 0.0, .angular_damping = 0.0};
    engine.time_step = *at++;
    const Vector3d size(at[0], at[1], at[2]);
    at += 3;
    RockSpec rock;
    rock.mass = *at++ * size.prod();
    rock.parts = {BoxPart{size, {}}};
    const Vector3d square = size.cwiseAbs2();
    rock.principal_inertia = rock.mass / 12.0 * (Vector3d::Constant(square.sum()) - square);
    for (double& value : rock.material.all) value = *at++;
    PedestalSpec pedestal;
    pedestal.parts = {BoxPart{{10, 10, 0.5}, {}}};
    pedestal.material = rock.material;
    scene_ = std::make_shared<Scene>(engine, pedestal, rock);
    const auto count = static_cast<std::size_t>(*at++);
    const double* samples = at + count;
    for (std::size_t i = 0; i < count; ++i) {
      motions.push_back({samples, static_cast<std::int64_t>(at[i])});
      samples += motions.back().size;
    }
    const FastModel& m = *scene_->shapes().fast_model;
    const auto law = NormalLaw::of(m.pair);
    const double dt = engine.time_step;
    block = {.mass = m.mass,
             .inertia = {m.inertia[0], m.inertia[1], m.inertia[2]},
             .inverse_inertia = {m.inverse_inertia[0], m.inverse_inertia[1], m.inverse_inertia[2]},
             .half = {m.box_half[0], m.box_half[1], m.box_half[2]},
             .top = m.support_half.z(),
             .height = pedestal.p_WP0.z(),
             .breaking = m.breaking_threshold,
             .deepest = m.deepest,
             .guard = m.guard,
             .guard_of_depth = kTop.guard_of_depth,
             .top_half = {m.support_half.x(), m.support_half.y()},
             .restitution = law.restitution,
             .threshold = m.engine.restitution_velocity_threshold,
             .softness = law.softness(dt),
             .erp = law.erp(dt),
             .friction = m.pair["lateral_friction"],
             .gravity = m.engine.gravity,
             .linear_damping = m.engine.linear_damping,
             .angular_damping = m.engine.angular_damping,
             .dt = dt,
             .level = kSticking.level,
             .greedy_sets = static_cast<int>(kSticking.greedy_sets)};
    stepper().clear();
    stepper().state.p_WB = {0, 0, pedestal.top + block.half[2]};
    for (int k = 0; k < kSettling; ++k) step_core(0.0, 0.0);
    start = taken();
  }

  FastStepper& stepper() {
    if (!stepper_) stepper_ = std::make_unique<FastStepper>(scene_->shapes().fast_model);
    return *stepper_;
  }
  bool step_core(double position, double velocity) {
    Support support;
    support.p_WP = {position, 0.0, block.height};
    support.v_WP.x() = velocity;
    if (stepper().detect(support) != FastStepper::Verdict::in_domain) return false;
    SupportMotor motor;
    stepper().advance(support, motor, block.dt);
    return true;
  }
  void give(const OneRock& rock) {
    FastStepper::Snapshot to{};
    for (int i = 0; i < 3; ++i) {
      to.state.p_WB[i] = rock.p[i];
      to.state.v_WB[i] = rock.v[i];
      to.state.w_WB[i] = rock.w[i];
    }
    to.state.q_WB = {rock.q[0], rock.q[1], rock.q[2], rock.q[3]};
    for (int k = 0; k < 4; ++k) {
      if (!(rock.kept[k] > 0)) continue;
      FastStepper::Contact& c = to.contacts[static_cast<std::size_t>(to.count++)];
      c.p_B = {kSigns[k][0] * block.half[0], kSigns[k][1] * block.half[1], -block.half[2]};
      c.p_P = {rock.place_x[k], rock.place_y[k], block.top};
      c.normal_impulse = rock.normal[k];
    }
    to.held = static_cast<std::int64_t>(rock.held);
    to.closed = static_cast<int>(rock.closed);
    stepper().restore(to);
  }
  OneRock taken() {
    const FastStepper::Snapshot from = stepper().snapshot();
    const RockState& s = from.state;
    OneRock out{};
    for (int i = 0; i < 3; ++i) out.p[i] = s.p_WB[i], out.v[i] = s.v_WB[i], out.w[i] = s.w_WB[i];
    out.q[0] = s.q_WB.w(), out.q[1] = s.q_WB.x(), out.q[2] = s.q_WB.y(), out.q[3] = s.q_WB.z();
    for (int i = 0; i < from.count; ++i) {
      const FastStepper::Contact& c = from.contacts[static_cast<std::size_t>(i)];
      int k = 0;
      while (k < 3 && !(kSigns[k][0] * c.p_B.x() > 0 && kSigns[k][1] * c.p_B.y() > 0)) ++k;
      out.place_x[k] = c.p_P.x();
      out.place_y[k] = c.p_P.y();
      out.kept[k] = 1.0;
      out.normal[k] = c.normal_impulse;
      out.lateral_x[k] = c.lateral_impulse_2;
      out.lateral_y[k] = -c.lateral_impulse_1;
    }
    out.held = static_cast<double>(from.held);
    out.closed = from.closed;
    return out;
  }

  // As the kernels run them.
  Tally by_core(std::vector<End>& ends) {
    Tally tally;
    for (std::size_t t = 0; t < motions.size(); ++t) {
      give(start);
      const double* x = motions[t].position;
      std::int64_t k = 1;
      bool fallen = false;
      for (; k < motions[t].size && !fallen; ++k) {
        const bool off = !step_core(x[k - 1], (x[k] - x[k - 1]) / block.dt);
        const Eigen::Quaterniond& q = stepper().state.q_WB;
        fallen = off || 1.0 - 2.0 * (q.x() * q.x() + q.y() * q.y()) < kOverturned;
      }
      ends[t] = {taken(), k - 1, fallen};
      tally.steps += ends[t].steps;
    }
    return tally;
  }

  Block block{};
  OneRock start{};
  std::vector<Motion> motions;

 private:
  std::shared_ptr<const Scene> scene_;
  std::unique_ptr<FastStepper> stepper_;
};

Work* work = nullptr;

bool core_step(const Block&, OneRock& rock, double position, double velocity) {
  work->give(rock);
  if (!work->step_core(position, velocity)) return false;
  rock = work->taken();
  return true;
}

std::vector<Level> levels() {
  std::vector<Level> out{portable::kernels()};
  if (__builtin_cpu_supports("avx2")) out.push_back(avx2::kernels());
  if (__builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
    out.push_back(avx512::kernels());
  return out;
}

bool equal(const std::vector<End>& a, const std::vector<End>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), [](const End& one, const End& other) {
    return one.steps == other.steps && one.overturned == other.overturned &&
           std::memcmp(&one.rock, &other.rock, sizeof(OneRock)) == 0;
  });
}

double greatest(const double* a, const double* b, int count) {
  double out = 0.0;
  for (int i = 0; i < count; ++i) out = std::max(out, std::fabs(a[i] - b[i]));
  return out;
}

// One step each from the same state, all along the trials of the scalar kernel.
void compare_with_core(const Level& level) {
  std::int64_t steps = 0, alone = 0, same = 0, sets = 0;
  double v = 0.0, w = 0.0, p = 0.0, q = 0.0, v_single = 0.0, w_single = 0.0;
  for (const Motion& motion : work->motions) {
    OneRock rock = work->start;
    for (std::int64_t k = 1; k < motion.size; ++k) {
      const double x = motion.position[k - 1], u = (motion.position[k] - x) / work->block.dt;
      OneRock core = rock, single = rock;
      if (!core_step(work->block, core, x, u)) break;
      ++steps;
      if (!level.one(work->block, x, u, rock)) {
        rock = core;
        ++alone;
      } else {
        same += std::memcmp(&rock, &core, offsetof(OneRock, place_x)) == 0;
        for (int i = 0; i < 4; ++i) sets += (rock.normal[i] > 0) != (core.normal[i] > 0);
        v = std::max(v, greatest(rock.v, core.v, 3));
        w = std::max(w, greatest(rock.w, core.w, 3));
        p = std::max(p, greatest(rock.p, core.p, 3));
        q = std::max(q, greatest(rock.q, core.q, 4));
        if (level.one_single(work->block, x, u, single)) {
          v_single = std::max(v_single, greatest(rock.v, single.v, 3));
          w_single = std::max(w_single, greatest(rock.w, single.w, 3));
        }
      }
      if (1.0 - 2.0 * (rock.q[1] * rock.q[1] + rock.q[2] * rock.q[2]) < kOverturned) break;
    }
  }
  const auto per = [&](std::int64_t part) { return static_cast<double>(part) / static_cast<double>(steps); };
  std::printf("check,steps,%lld\ncheck,share that only the core steps,%.5f\ncheck,share of equal bits,%.3f\n",
              static_cast<long long>(steps), per(alone), per(same));
  std::printf("check,contacts that only one closes,%lld\n", static_cast<long long>(sets));
  std::printf("check,velocity [m/s],%.2g\ncheck,rate [rad/s],%.2g\ncheck,position [m],%.2g\n", v, w, p);
  std::printf("check,orientation [1],%.2g\n", q);
  std::printf("check,velocity by single precision [m/s],%.2g\n", v_single);
  std::printf("check,rate by single precision [rad/s],%.2g\n", w_single);
}

// Contacts of a block that stands, lands or slides.
std::vector<ContactProblem> problems() {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> even(-1.0, 1.0);
  const Block& b = work->block;
  std::vector<ContactProblem> out(kProblems);
  for (ContactProblem& problem : out) {
    const Vector3d axis = Vector3d(even(random), even(random), even(random)).normalized();
    const Matrix3d R = Eigen::AngleAxisd(0.05 * even(random), axis).toRotationMatrix();
    const RockResponse rock{1.0 / b.mass, R * Vector3d(b.inverse_inertia).asDiagonal() * R.transpose()};
    const Vector3d v = 0.1 * Vector3d(even(random), even(random), even(random) - 0.5);
    const Vector3d w = 0.2 * Vector3d(even(random), even(random), even(random));
    problem.count = 4;
    for (int k = 0; k < 4; ++k) {
      const Vector3d r = R * Vector3d(kSigns[k][0] * b.half[0], kSigns[k][1] * b.half[1], -b.half[2]);
      const Vector3d slip = v + w.cross(r);
      ContactRows& rows = problem.rows[static_cast<std::size_t>(k)];
      rows.bounds = {b.friction, 0.01};
      rows.normal.fill<Joint::none>(rock, r, {}, -slip.z() + 1e-3 * even(random), b.softness);
      rows.spin.fill<Joint::none>(rock, r, {}, -w.z());
      rows.lateral_1.fill<Joint::none>(rock, r, {}, slip.y());
      rows.lateral_2.fill<Joint::none>(rock, r, {}, -slip.x());
    }
  }
  return out;
}

template <typename Row>
SweptRow<double> swept(const Row& row, bool turns) {
  SweptRow<double> out{};
  out.first = row.first;
  if (!turns) out.second = row.second, out.along = row.along, out.linear_response = row.linear_response;
  std::copy_n(row.angular_response, 3, out.response);
  out.target = row.target;
  return out;
}
std::vector<SweptProblem<double>> in_rows(const std::vector<ContactProblem>& given) {
  std::vector<SweptProblem<double>> out(given.size());
  for (std::size_t i = 0; i < given.size(); ++i) {
    out[i] = {};
    for (std::size_t k = 0; k < 4; ++k) {
      const ContactRows& rows = given[i].rows[k];
      auto& to = out[i].rows[k];
      to[0] = swept(rows.normal, false);
      to[0].keep = rows.normal.keep;
      to[1] = swept(rows.spin, true);
      to[2] = swept(rows.lateral_1, false);
      to[3] = swept(rows.lateral_2, false);
    }
    out[i].friction = given[i].rows[0].bounds.coefficient;
    out[i].lever = given[i].rows[0].bounds.lever;
  }
  return out;
}

struct Line {
  const char *kind, *level, *across, *impulses;
  int lanes;
  bool bits;
  double alone = 0.0, overturned = 0.0;
};
void print(const Line& line, const std::vector<double>& times) {
  std::printf("%s,%s,%s,%s,%d,%s,%.6f,%.4f", line.kind, line.level, line.across, line.impulses, line.lanes,
              line.bits ? "yes" : "no", line.alone, line.overturned);
  for (double time : times) std::printf(",%.3f", time);
  std::printf("\n");
}

struct StepRun {
  const StepKernel* kernel;  ///< null: the core
  std::vector<End> ends;
  std::vector<double> times;
  Tally tally;
};

void time_steps(const std::vector<Level>& all, int rounds) {
  std::vector<StepRun> runs(1);
  for (const Level& level : all)
    for (std::size_t i = 0; i < level.step_count; ++i) runs.push_back({level.steps + i, {}, {}, {}});
  for (int round = 0; round < rounds; ++round) {
    for (StepRun& run : runs) {
      run.ends.resize(work->motions.size());
      const double begun = cpu_time();
      run.tally = run.kernel ? run.kernel->run(work->block, work->start, work->motions.data(),
                                               work->motions.size(), core_step, run.ends.data())
                             : work->by_core(run.ends);
      run.times.push_back(1e9 * (cpu_time() - begun) / static_cast<double>(run.tally.steps));
    }
  }
  // The first level has the scalar kernels, in double and in single precision.
  for (const StepRun& run : runs) {
    const StepRun& scalar = run.kernel && *run.kernel->impulses == 's' ? runs[2] : runs[1];
    const auto fallen = std::count_if(run.ends.begin(), run.ends.end(),
                                      [](const End& end) { return end.overturned; });
    Line line{"step", "portable", "the core", "double", 1, equal(run.ends, scalar.ends)};
    if (run.kernel)
      line = {"step", run.kernel->level, run.kernel->across, run.kernel->impulses, run.kernel->lanes, line.bits};
    line.alone = static_cast<double>(run.tally.alone) / static_cast<double>(run.tally.steps);
    line.overturned = static_cast<double>(fallen) / static_cast<double>(run.ends.size());
    print(line, run.times);
  }
}

void time_sweeps(const std::vector<Level>& all, int rounds) {
  const std::vector<ContactProblem> given = problems();
  const std::vector<SweptProblem<double>> rows = in_rows(given);
  struct Run {
    const SweepKernel* kernel;
    std::vector<SweptProblem<double>> swept;
    std::vector<double> times;
  };
  std::vector<ContactProblem> by_core;
  std::vector<Run> runs(1);
  for (const Level& level : all)
    for (std::size_t i = 0; i < level.sweep_count; ++i) runs.push_back({level.sweeps + i, {}, {}});
  constexpr int kRepeats = 40;
  for (int round = 0; round < rounds; ++round) {
    for (Run& run : runs) {
      double took = 0.0;
      std::int64_t sweeps = 0;
      for (int repeat = 0; repeat < kRepeats; ++repeat) {
        if (run.kernel) run.swept = rows;
        else by_core = given;
        const double begun = cpu_time();
        if (run.kernel) {
          run.kernel->run(run.swept.data(), run.swept.size(), kSweeps);
          sweeps += static_cast<std::int64_t>(kProblems) * kSweeps;
        } else {
          for (ContactProblem& problem : by_core) sweeps += solve(problem, kSweeps, 1e-300);
        }
        took += cpu_time() - begun;
      }
      run.times.push_back(1e9 * took / static_cast<double>(sweeps));
    }
  }
  // The core sums as the scalar kernel does, so their bits are compared, too.
  for (const Run& run : runs) {
    bool bits = true;
    for (std::size_t i = 0; i < kProblems; ++i) {
      if (run.kernel)
        bits = bits && std::memcmp(&run.swept[i], &runs[1].swept[i], sizeof(run.swept[i])) == 0;
      else
        bits = bits && greatest(by_core[i].change.angular, runs[1].swept[i].angular, 3) == 0.0 &&
               greatest(by_core[i].change.linear, runs[1].swept[i].linear, 3) == 0.0;
    }
    Line line{"sweep", "portable", "the core", "double", 1, bits};
    if (run.kernel) line = {"sweep", run.kernel->level, "trials", "double", run.kernel->lanes, bits};
    print(line, run.times);
  }
  std::int64_t open = 0, slide = 0;
  for (const ContactProblem& problem : by_core)
    for (const ContactRows& one : problem.rows) {
      open += one.normal.impulse == 0.0;
      const double l = std::hypot(one.lateral_1.impulse, one.lateral_2.impulse);
      slide += one.normal.impulse > 0.0 && l >= 0.999999 * one.bounds.lateral(one.normal.impulse);
    }
  std::printf("check,share of swept contacts that are open,%.3f\ncheck,share that slides,%.3f\n",
              static_cast<double>(open) / (4.0 * kProblems), static_cast<double>(slide) / (4.0 * kProblems));
}

}  // namespace

int main(int count, char** words) {
  if (count != 3) {
    std::fprintf(stderr, "usage: lanes FILE ROUNDS\n");
    return 2;
  }
  const std::vector<double> given = numbers_of(words[1]);
  const int rounds = std::atoi(words[2]);
  Work here(given);
  work = &here;
  const std::vector<Level> all = levels();
  compare_with_core(all.front());
  time_steps(all, rounds);
  time_sweeps(all, rounds);
  return 0;
}
