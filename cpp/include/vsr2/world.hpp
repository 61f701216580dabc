#pragma once
// A world: one rock on one driven pedestal, advanced step by step.

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "vsr2/scene.hpp"

namespace vsr2 {

/// How the pedestal follows its set-points.
enum class Drive {
  prescribed,                ///< exactly: position reached at the end of each step
  prescribed_spatial,        ///< the same, with the excursion besides x
  motor_position,            ///< Bullet's joint motor, position reference only (recordings, S1.3)
  motor_position_velocity,   ///< Bullet's joint motor, both references (cosine modes, S1.3)
};

/// Where the pedestal is besides x; or the rates of that.
struct Excursion {
  double transverse = 0.0;  ///< along y [m]
  double vertical = 0.0;    ///< along z [m]
  double pitch = 0.0;       ///< about y, on the axis at PedestalSpec::pitch_pivot [rad]
};

/// Set-point for the end of a step.
struct DriveTarget {
  double position = 0.0;  ///< [m]
  double velocity = 0.0;  ///< [m/s]
  Excursion excursion;    ///< with `prescribed_spatial` only; else it must be zero
};

/// Position and velocity are of the pitch axis where the pedestal pitches.
struct PedestalState {
  double position = 0.0;  ///< displacement along x from the start [m]
  double velocity = 0.0;  ///< [m/s]
  Excursion excursion;
  Excursion excursion_rate;
};

/// Rigid motion of the pedestal's frame P.
struct PedestalMotion {
  Eigen::Vector3d p_WP = Eigen::Vector3d::Zero();  ///< [m]
  Eigen::Matrix3d R_WP = Eigen::Matrix3d::Identity();
  Eigen::Vector3d v_WP = Eigen::Vector3d::Zero();  ///< [m/s]
  Eigen::Vector3d w_WP = Eigen::Vector3d::Zero();  ///< [rad/s]

  /// Velocity of the pedestal's material at a point of the world [m/s].
  Eigen::Vector3d velocity_at(const Eigen::Vector3d& p_W) const { return v_WP + w_WP.cross(p_W - p_WP); }
};
/// Point of the pitch axis in W, over the start of P's origin but for the displacement [m].
Eigen::Vector3d pitch_axis(const PedestalSpec& pedestal, const PedestalState& state);
/// The pedestal turns about its pitch axis, which itself moves along x, y and z.
PedestalMotion pedestal_motion(const PedestalSpec& pedestal, const PedestalState& state);

struct RockState {
  Eigen::Vector3d p_WB = Eigen::Vector3d::Zero();  ///< mass centre [m]
  Eigen::Quaterniond q_WB = Eigen::Quaterniond::Identity();
  Eigen::Vector3d v_WB = Eigen::Vector3d::Zero();  ///< [m/s]
  Eigen::Vector3d w_WB = Eigen::Vector3d::Zero();  ///< angular velocity in W [rad/s]
};

/// One contact point between rock and pedestal (or base), as the last step used it.
struct ContactPoint {
  Eigen::Vector3d p_W_rock;      ///< [m]
  Eigen::Vector3d p_W_pedestal;  ///< [m]
  Eigen::Vector3d normal_W;      ///< from pedestal to rock, unit
  double distance;               ///< negative: penetration [m]
  double normal_impulse;         ///< over the last solver step [N s]
  double lateral_impulse_1;      ///< along direction_1 [N s]
  double lateral_impulse_2;      ///< along direction_2 [N s]
  Eigen::Vector3d direction_1;
  Eigen::Vector3d direction_2;
  ContactValues pair;  ///< that the solver used
};

/// What a rock stands on; within the core only.
struct Foothold;

/// Why a world of the engine `fast` went on with Bullet.
enum class Handover {
  none,
  off_the_top,       ///< the rock's lowest point came near the edge of the pedestal's top
  motor_on_a_slope,  ///< a motor along x drives a top that is not level
  too_deep,          ///< the rock went deeper into the pedestal than the contact geometry holds for
};

/// @throws InvalidInput if there is no rock, or if there is one.
void require_rock(bool has_rock);
void require_no_rock(bool has_rock);
/// @throws InvalidInput for a pose that no rock can start from.
void check_start(const Pose& X_WB);

/// A world owns its state and shares the scene. One thread at a time.
class World {
 public:
  virtual ~World() = default;
  /// Puts a rock at X_WB, at rest. @throws InvalidInput if there is one already or the pose is bad.
  virtual void spawn_rock(const Pose& X_WB) = 0;
  /// @throws InvalidInput if there is none.
  virtual void delete_rock() = 0;
  virtual bool has_rock() const = 0;
  /// Sets the rock's velocities [m/s], [rad/s] in W.
  virtual void set_rock_velocity(const Eigen::Vector3d& v_WB, const Eigen::Vector3d& w_WB) = 0;
  /// Advances by one time step (all its substeps) towards the set-point.
  virtual void step(const DriveTarget& target) = 0;
  virtual PedestalState pedestal() const = 0;
  virtual RockState rock() const = 0;
  /// Replaces `out` by the current contacts of the rock.
  virtual void contacts(std::vector<ContactPoint>& out) const = 0;
  /// Since the rock was spawned.
  virtual Handover handover() const { return Handover::none; }

  // What the engine `fast` can besides, as long as Bullet has not taken over.

  /// Replaces `out` by what the rock stands on, its low vertices left out. Whether that is known: not
  /// where the world cannot carry(), or the rock is in the air.
  virtual bool foothold(Foothold& out) const;
  /// Adds the low vertices to a foothold of this state.
  virtual void add_low_vertices(Foothold&) const {}
  /// Time steps since a contact of the foothold opened, closed or slid.
  virtual std::int64_t steps_held() const { return 0; }
  /// Moves pedestal and rock as one body to set-point `to`, as if the time step before had led there
  /// from `from`, without turning. @throws InvalidInput where there is no foothold.
  virtual void carry(const DriveTarget& from, const DriveTarget& to);
  /// A world that goes on from here with the same bits; null where it cannot be had.
  virtual std::unique_ptr<World> copy() const { return nullptr; }
};

}  // namespace vsr2
