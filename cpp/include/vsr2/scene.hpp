#pragma once
// The scene: what a world is built from. Immutable after construction and shared by all worlds
// and threads; collision shapes are built once.
//
// Frames: W world (z up, pedestal moves along x); M the model frame in which the rock's collision
// parts are given; B the rock's body frame (origin at the mass centre, axes principal); P the
// pedestal frame, which starts at p_WP0 with the world's axes. SI units throughout.

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

#include <Eigen/Dense>

#include "vsr2/contact_model.hpp"
#include "vsr2/mechanisms.hpp"
#include "vsr2/pitch_spring.hpp"

namespace vsr2 {

/// What an error is about. The list is Python's, too, whose errors may be about any of these; so it
/// has members that the core never raises.
enum class Fault {
  bad_value,      ///< a value that nothing can use
  drive,          ///< a drive or set-point that does not go with motion or pedestal
  engine_domain,  ///< an engine that does not take the scene
  no_rock,
  rock_present,
  // Of Python alone: it reads the files of bodies and motions, and the core knows no effects.
  geometry,
  motion,
  acts_already,  ///< an effect that cannot act twice
};

/// Raised for a scene or trial that cannot be simulated; the message names the value.
class InvalidInput : public std::invalid_argument {
 public:
  explicit InvalidInput(const std::string& message, Fault fault = Fault::bad_value)
      : std::invalid_argument(message), fault_(fault) {}
  Fault fault() const { return fault_; }

 private:
  Fault fault_;
};

/// A rigid transform: position [m] and unit orientation.
struct Pose {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
};

/// How a scene is stepped. `parity`: Bullet's own code; `exact`: the same bits sooner; `fast`: the
/// same model to rounding, in a stepper for one convex rock on a flat top; `automatic`: `fast` where
/// it takes the scene, else `exact`.
enum class EngineKind { automatic, parity, exact, fast };

/// Settings of the physics engine (supplement S1.2).
struct EngineSettings {
  EngineKind kind = EngineKind::parity;
  double gravity = 9.81;     ///< downwards [m/s^2]
  double time_step = 1e-3;   ///< between two drive set-points [s]
  int substeps = 1;          ///< solver steps per time_step
  int solver_iterations = 150;
  double residual_threshold = 0.0;               ///< [(m/s)^2]
  /// Engine `fast`: contacts that stick are solved to where the sweeps lead in the end, and those of a
  /// hull are vertices, also where several are level.
  bool converged_contacts = true;
  /// Engine `fast`: a rock at rest is not stepped while it is bound to stay so.
  bool skip_quiet = true;
  double restitution_velocity_threshold = 0.2;   ///< [m/s]
  bool cone_friction = true;
  bool deterministic_overlapping_pairs = true;
  double collision_margin = 1e-3;                ///< [m]
  /// Distance at which a cached contact point is dropped, per angular motion disc (about the
  /// greatest radius) of the smaller shape [1].
  double contact_breaking_threshold = 0.02;
  // Bullet's default, as `parity` with PyBullet needs it, is the single-precision 0.04; a study has 0.
  double linear_damping = 0.04F;   ///< [1/s]
  double angular_damping = 0.04F;  ///< [1/s]
};

/// Convex hull of points, shape (k, 3) [m].
///
/// Copies share the points and the hull that Bullet makes of them, which the first scene of a copy has
/// it make: a scan of 33,000 points takes longer than a short trial. Thread safe.
class HullPart {
 public:
  /// Without points: of no scene, for variants that want a default.
  explicit HullPart(std::vector<Eigen::Vector3d> points = {});
  const std::vector<Eigen::Vector3d>& points() const;

  /// Bullet's hull of the points, for the core.
  struct Reduction;
  Reduction& reduction() const { return *reduction_; }

 private:
  std::shared_ptr<Reduction> reduction_;
};
/// Box with full edge lengths `size` [m] at `pose`.
struct BoxPart {
  Eigen::Vector3d size = Eigen::Vector3d::Ones();
  Pose pose;
};
/// Exact triangle surface (pedestals only).
struct TrianglesPart {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<std::array<std::int64_t, 3>> faces;
};
using Part = std::variant<HullPart, BoxPart, TrianglesPart>;

struct RockSpec {
  std::vector<Part> parts;  ///< in M
  double mass = 0.0;        ///< [kg]
  Eigen::Vector3d principal_inertia = Eigen::Vector3d::Zero();  ///< about B [kg m^2]
  bool inertia_from_aabb = false;  ///< Bullet's bounding-box inertia instead of principal_inertia
  Pose X_MB;
  ContactValues material;
};

struct PedestalSpec {
  std::vector<Part> parts;  ///< in P
  Eigen::Vector3d p_WP0 = Eigen::Vector3d(0, 0, 2.25);
  double mass = 2e5;  ///< carried by the prismatic joint [kg]
  Eigen::Vector3d base_size = Eigen::Vector3d(50, 14, 2);  ///< static base standing on z = 0 [m]
  double top = 2.5;   ///< greatest z of the pedestal at the start [m]
  ContactValues material;
  double pitch_pivot = 2.5;  ///< height of the pitch axis in W at the start; it lies over P's origin [m]
  std::optional<PitchSpring> pitch_spring;  ///< needs Drive::prescribed_spatial
};

/// A validated scene with its collision shapes. Thread safe: nothing changes after construction.
class Scene {
 public:
  /// @throws InvalidInput for values no engine can use (zero mass, empty parts, NaN, ...).
  Scene(EngineSettings engine, PedestalSpec pedestal, RockSpec rock, Mechanisms mechanisms = {});
  ~Scene();
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  const EngineSettings& engine() const { return engine_; }
  const PedestalSpec& pedestal() const { return pedestal_; }
  /// Without restitution where the mechanisms set the energy of impacts.
  const RockSpec& rock() const { return rock_; }
  const Mechanisms& mechanisms() const { return mechanisms_; }

  /// The rock's inertia about B that worlds use, after `inertia_from_aabb` [kg m^2].
  Eigen::Vector3d rock_inertia() const;
  /// Vertices of the rock's collision hulls in B after hull reduction, shape (k, 3) [m].
  std::vector<Eigen::Vector3d> rock_hull_vertices() const;

  /// Collision shapes, for the engines.
  struct Shapes;
  const Shapes& shapes() const { return *shapes_; }

 private:
  EngineSettings engine_;
  PedestalSpec pedestal_;
  RockSpec rock_;
  Mechanisms mechanisms_;
  std::unique_ptr<Shapes> shapes_;
};

}  // namespace vsr2
