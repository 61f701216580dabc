#pragma once
// A trial: settle, shake, let it come to rest, tell the outcome.

#include <atomic>
#include <cstdint>
#include <limits>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "vsr2/world.hpp"

namespace vsr2 {

enum class Status : std::int32_t {
  ok = 0,
  settling_timeout = 1,  ///< did not come to rest before the motion
  tail_timeout = 2,      ///< did not come to rest after the motion; the outcome is of the last state
  diverged = 3,          ///< the state became infinite or NaN
  error = 4,             ///< an exception; see the message
  cancelled = 5,
  not_run = 6,
};

enum class Outcome : std::int32_t {
  stable = 0,
  rocked = 1,
  slid = 2,
  rotated = 3,
  overturned = 4,
  failed = 5,  ///< no outcome: status tells why
};

struct RestCriterion {
  double linear_speed = 1e-3;   ///< relative to the pedestal [m/s]
  double angular_speed = 2e-3;  ///< [rad/s]
  double window = 0.25;         ///< [s]
};

struct OutcomeThresholds {
  double overturned_tilt = 1.4;  ///< irreversible [rad]
  double toppled_tilt = 0.35;    ///< at the end [rad]
  double rocked_tilt = 0.01;     ///< peak [rad]
  double slid_distance = 0.005;  ///< at the end [m]
  double rotated_angle = 0.035;  ///< at the end [rad]
};

class SettledStart;

struct TrialSpec {
  std::shared_ptr<SettledStart> start;        ///< scene, drive and settled start pose
  std::shared_ptr<const std::vector<double>> position;  ///< set-points, first at time 0 [m]
  std::shared_ptr<const std::vector<double>> velocity;  ///< set-points [m/s]; null: differences
  // Set-points besides x, as many as of the position; null: none. They need Drive::prescribed_spatial.
  std::shared_ptr<const std::vector<double>> transverse;  ///< along y [m]
  std::shared_ptr<const std::vector<double>> vertical;    ///< along z [m]
  std::shared_ptr<const std::vector<double>> pitch;       ///< about y [rad]
  double tail = 30.0;                         ///< longest run after the motion [s]
  RestCriterion tail_rest{0.02, 0.05, 0.5};   ///< ends the tail
  OutcomeThresholds outcome;
  bool stop_early = true;
  std::int64_t log_every = 0;                 ///< [time steps]; 0: none
  std::int64_t contacts_every = 0;            ///< [time steps]; 0: none
};

/// Columns of a state log row.
enum LogColumn : int {
  kTime, kCommandedPosition, kCommandedVelocity, kPedestalPosition, kPedestalVelocity,
  kRockX, kRockY, kRockZ, kRockQx, kRockQy, kRockQz, kRockQw,
  kRockVx, kRockVy, kRockVz, kRockWx, kRockWy, kRockWz,
  kLogColumns
};
/// Columns of an excursion log row, which goes with the state log row of the same index.
enum ExcursionColumn : int { kTransverse, kVertical, kPitch, kExcursionColumns };
/// Columns of a contact log row: time, rock point, pedestal point, normal, distance, normal and
/// two lateral impulses, two lateral directions.
inline constexpr int kContactColumns = 20;

struct TrialResult {
  Status status = Status::not_run;
  Outcome outcome = Outcome::failed;
  std::string message;
  std::string engine;  ///< that ran it; empty where none did
  double settling_time = std::numeric_limits<double>::quiet_NaN();   ///< shared and own [s]
  double simulated_time = std::numeric_limits<double>::quiet_NaN();  ///< after settling [s]
  double overturning_time = std::numeric_limits<double>::quiet_NaN();///< irreversible from [s]
  double peak_tilt = std::numeric_limits<double>::quiet_NaN();       ///< [rad]
  double final_tilt = std::numeric_limits<double>::quiet_NaN();      ///< [rad]
  double final_slip = std::numeric_limits<double>::quiet_NaN();      ///< [m]
  double final_yaw = std::numeric_limits<double>::quiet_NaN();       ///< [rad]
  double peak_tracking_error = std::numeric_limits<double>::quiet_NaN();  ///< [m]
  std::int64_t steps = 0;  ///< time steps of this trial, its own settling included
  /// NaN until settled.
  Pose X_WB_settled{Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()),
                    Eigen::Quaterniond(Eigen::Vector4d::Constant(std::numeric_limits<double>::quiet_NaN()))};
  Eigen::Vector3d p_B_foot = Eigen::Vector3d::Constant(
      std::numeric_limits<double>::quiet_NaN());  ///< body point whose travel is the slip [m]
  std::vector<double> log;       ///< rows of kLogColumns
  std::vector<double> excursions;  ///< rows of kExcursionColumns; empty: the pedestal moved along x
  std::vector<double> contacts;  ///< rows of kContactColumns
};

/// Where a rock comes to rest from a start pose. Trials that share one settle it once, in a world of
/// its own; each trial then starts a fresh world from the pose of rest and settles there again,
/// briefly. Thread safe.
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

 private:
  std::shared_ptr<const Scene> scene_;
  Drive drive_;
  Pose X_WB0_;
  RestCriterion rest_;
  double timeout_;
  std::int64_t log_every_;
  std::once_flag once_;
  TrialResult settled_;
};

/// Tilt of R_WB away from R_WB0: angle between the body's settled vertical and the vertical [rad].
double tilt_from(const Eigen::Quaterniond& q_WB0, const Eigen::Quaterniond& q_WB);
/// Turn about the vertical between the two (twist of the swing-twist decomposition) [rad].
double yaw_from(const Eigen::Quaterniond& q_WB0, const Eigen::Quaterniond& q_WB);

/// Tilt, turn, slip, fall and rest count relative to the moving pedestal.
/// Runs one trial in a freshly built world. Never throws for what happens in the trial: see status.
/// `cancel` is looked at every few steps.
TrialResult run_trial(const TrialSpec& spec, const std::atomic<bool>& cancel);

}  // namespace vsr2
