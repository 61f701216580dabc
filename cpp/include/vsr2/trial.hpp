#pragma once
// A trial: settle, shake, let it come to rest, tell the outcome.

#include <array>
#include <atomic>
#include <cstdint>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "vsr2/rest.hpp"
#include "vsr2/world.hpp"

namespace vsr2 {

enum class Status {
  ok = 0,
  settling_timeout = 1,  ///< did not come to rest before the motion
  tail_timeout = 2,      ///< did not come to rest after the motion; the outcome is of the last state
  diverged = 3,          ///< the state became infinite or NaN
  error = 4,             ///< an exception; see the message
  cancelled = 5,
  not_run = 6,
};

enum class Outcome {
  stable = 0,
  rocked = 1,
  slid = 2,
  rotated = 3,
  overturned = 4,
  failed = 5,  ///< no outcome: status tells why
};

struct OutcomeThresholds {
  double overturned_tilt = 1.4;  ///< irreversible [rad]
  double toppled_tilt = 0.35;    ///< at the end [rad]
  double rocked_tilt = 0.01;     ///< peak [rad]
  double slid_distance = 0.005;  ///< at the end [m]
  double rotated_angle = 0.035;  ///< at the end [rad]
};

class SettledStart;

/// A channel's set-points in memory that its owner keeps in place, and unchanged, as long as any copy
/// of this lives. Copies share it; the last one frees it, on whatever thread that is.
class Samples {
 public:
  Samples() = default;
  Samples(std::shared_ptr<const double> values, std::size_t count)
      : values_(std::move(values)), count_(count) {}
  Samples(const std::shared_ptr<const std::vector<double>>& values)
      : values_(values, values->data()), count_(values->size()) {}
  std::size_t size() const { return count_; }
  const double* begin() const { return values_.get(); }
  const double* end() const { return begin() + count_; }
  double operator[](std::size_t k) const { return begin()[k]; }

 private:
  std::shared_ptr<const double> values_;
  std::size_t count_ = 0;
};

struct TrialSpec {
  std::shared_ptr<SettledStart> start;  ///< scene, drive and settled start pose
  Samples position;                     ///< set-points, first at time 0 [m]
  std::optional<Samples> velocity;      ///< set-points [m/s]; none: differences
  // Set-points besides x, as many as of the position. They need Drive::prescribed_spatial.
  std::optional<Samples> transverse;  ///< along y [m]
  std::optional<Samples> vertical;    ///< along z [m]
  std::optional<Samples> pitch;       ///< about y [rad]
  double tail = 30.0;                         ///< longest run after the motion [s]
  RestCriterion tail_rest{0.02, 0.05, 0.5};   ///< ends the tail
  OutcomeThresholds outcome;
  bool stop_early = true;
  std::int64_t log_every = 0;                 ///< [time steps]; 0: none
  std::int64_t contacts_every = 0;            ///< [time steps]; 0: none
};

/// A column of a table, for whoever reads it.
struct Column {
  const char* name;
  const char* unit;         ///< "1": a number without one; empty: no number
  const char* description;  ///< of the quantity, without the unit
  const char* vector = "";  ///< that it is a component of; empty: none
  const char* component = "";  ///< of the vector, as its description goes on
};
/// Columns of a state log row, the time first; the orientation is of the body frame B.
inline constexpr std::array<Column, 18> kStateLog{{
    {"time", "s", "time from the start of the motion"},
    {"commanded_position", "m", "set-point of the pedestal's position along x"},
    {"commanded_velocity", "m/s", "set-point of the pedestal's velocity along x"},
    {"pedestal_position", "m", "position of the pedestal along x"},
    {"pedestal_velocity", "m/s", "velocity of the pedestal along x"},
    {"rock_x", "m", "mass centre", "position", " along x"},
    {"rock_y", "m", "mass centre", "position", " along y"},
    {"rock_z", "m", "mass centre", "position", " along z"},
    {"rock_qx", "1", "orientation of the body frame", "body_orientation", ", quaternion's x"},
    {"rock_qy", "1", "orientation of the body frame", "body_orientation", ", quaternion's y"},
    {"rock_qz", "1", "orientation of the body frame", "body_orientation", ", quaternion's z"},
    {"rock_qw", "1", "orientation of the body frame", "body_orientation", ", quaternion's w"},
    {"rock_vx", "m/s", "velocity of the mass centre", "velocity", " along x"},
    {"rock_vy", "m/s", "velocity of the mass centre", "velocity", " along y"},
    {"rock_vz", "m/s", "velocity of the mass centre", "velocity", " along z"},
    {"rock_wx", "rad/s", "angular velocity", "angular_velocity", " about x"},
    {"rock_wy", "rad/s", "angular velocity", "angular_velocity", " about y"},
    {"rock_wz", "rad/s", "angular velocity", "angular_velocity", " about z"},
}};
/// One row a contact point. The normal points from pedestal to rock, a negative distance is
/// penetration, impulses are over one solver step.
inline constexpr std::array<Column, 20> kContactLog{{
    {"time", "s", "time from the start of the motion"},
    {"rock_point_x", "m", "point of the rock", "rock_point", " along x"},
    {"rock_point_y", "m", "point of the rock", "rock_point", " along y"},
    {"rock_point_z", "m", "point of the rock", "rock_point", " along z"},
    {"pedestal_point_x", "m", "point of the pedestal", "pedestal_point", " along x"},
    {"pedestal_point_y", "m", "point of the pedestal", "pedestal_point", " along y"},
    {"pedestal_point_z", "m", "point of the pedestal", "pedestal_point", " along z"},
    {"normal_x", "1", "normal from the pedestal to the rock", "normal", ", x"},
    {"normal_y", "1", "normal from the pedestal to the rock", "normal", ", y"},
    {"normal_z", "1", "normal from the pedestal to the rock", "normal", ", z"},
    {"distance", "m", "distance of the points along the normal, negative where they penetrate"},
    {"normal_impulse", "N s", "impulse along the normal over one solver step"},
    {"lateral_impulse_1", "N s", "impulse along the first lateral direction over one solver step"},
    {"lateral_impulse_2", "N s", "impulse along the second lateral direction over one solver step"},
    {"lateral_direction_1_x", "1", "first lateral direction", "lateral_direction_1", ", x"},
    {"lateral_direction_1_y", "1", "first lateral direction", "lateral_direction_1", ", y"},
    {"lateral_direction_1_z", "1", "first lateral direction", "lateral_direction_1", ", z"},
    {"lateral_direction_2_x", "1", "second lateral direction", "lateral_direction_2", ", x"},
    {"lateral_direction_2_y", "1", "second lateral direction", "lateral_direction_2", ", y"},
    {"lateral_direction_2_z", "1", "second lateral direction", "lateral_direction_2", ", z"},
}};
/// Columns of a log of Excursion, row by row with the state log.
inline constexpr std::array<Column, 3> kExcursionLog{{
    {"transverse", "m", "position of the pedestal along y"},
    {"vertical", "m", "position of the pedestal along z"},
    {"pitch", "rad", "turn of the pedestal about y"},
}};
inline constexpr int kTime = 0;
inline constexpr int kLogColumns = kStateLog.size();
inline constexpr int kExcursionColumns = kExcursionLog.size();
inline constexpr int kContactColumns = kContactLog.size();
/// A contact point as a row of kContactLog; `time` [s].
std::array<double, kContactColumns> contact_row(double time, const ContactPoint& contact);

struct TrialResult {
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  Status status = Status::not_run;
  Outcome outcome = Outcome::failed;
  std::string message;  ///< of the exception, with `error`
  std::optional<EngineKind> engine;  ///< that started it; none where none did
  Handover handover = Handover::none;  ///< why `fast` went on with `exact`
  double settling_time = kNone;        ///< shared and own [s]
  double simulated_time = kNone;       ///< after settling [s]
  double overturning_time = kNone;     ///< irreversible from [s]
  double peak_tilt = kNone;            ///< [rad]
  double final_tilt = kNone;           ///< [rad]
  double final_slip = kNone;           ///< [m]
  double final_yaw = kNone;            ///< [rad]
  double peak_tracking_error = kNone;  ///< [m]
  std::int64_t steps = 0;  ///< time steps of this trial, its own settling included
  /// NaN until settled.
  Pose X_WB_settled{Eigen::Vector3d::Constant(kNone),
                    Eigen::Quaterniond(Eigen::Vector4d::Constant(kNone))};
  Eigen::Vector3d p_B_foot = Eigen::Vector3d::Constant(kNone);  ///< whose travel is the slip [m]
  std::vector<double> log;       ///< rows of kStateLog
  /// A row of kExcursionLog for each of the log; empty: the pedestal moved along x.
  std::vector<double> excursions;
  std::vector<double> contacts;  ///< rows of kContactLog
};

/// Where a rock comes to rest from a start pose. Trials that share one settle it once, in a world of
/// its own; each trial then starts a fresh world from the pose of rest and settles there again, briefly.
/// Where that would change nothing it goes on with a copy of the first world instead. Thread safe.
class SettledStart {
 public:
  /// `timeout` [s], 0: no settling; `log_every` as in TrialSpec, 0: no settling log.
  SettledStart(std::shared_ptr<const Scene> scene, Drive drive, const Pose& X_WB0,
               const RestCriterion& rest, double timeout, std::int64_t log_every);

  const std::shared_ptr<const Scene>& scene() const { return scene_; }
  Drive drive() const { return drive_; }
  const RestCriterion& rest() const { return rest_; }
  double timeout() const { return timeout_; }
  std::int64_t log_every() const { return log_every_; }

  /// Settles on the first call, for all who call. Uses of the result: status, message,
  /// settling_time, X_WB_settled and log (times from the end of settling).
  const TrialResult& settle(const std::atomic<bool>& cancel);
  /// After settle(): a copy of the world in which the rock came to rest, or null.
  std::unique_ptr<World> settled_world() const { return world_ ? world_->copy() : nullptr; }

 private:
  std::shared_ptr<const Scene> scene_;
  Drive drive_;
  Pose X_WB0_;
  RestCriterion rest_;
  double timeout_;
  std::int64_t log_every_;
  std::once_flag once_;
  TrialResult settled_;
  std::unique_ptr<const World> world_;
};

/// Tilt of R_WB away from R_WB0: angle between the body's settled vertical and the vertical [rad].
double tilt_from(const Eigen::Quaterniond& q_WB0, const Eigen::Quaterniond& q_WB);
/// Turn about the vertical between the two (twist of the swing-twist decomposition) [rad].
double yaw_from(const Eigen::Quaterniond& q_WB0, const Eigen::Quaterniond& q_WB);

/// Tilt, turn, slip, fall and rest count relative to the moving pedestal.
/// Runs one trial from its settled start. Never throws for what happens in the trial: see status.
/// `cancel` is looked at in every step that is taken.
TrialResult run_trial(const TrialSpec& spec, const std::atomic<bool>& cancel);

}  // namespace vsr2
