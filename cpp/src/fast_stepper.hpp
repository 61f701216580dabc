#pragma once
// One convex rock on the flat top of a moving support, with Bullet's contact model and order of
// integration, without Bullet; private to the core.
//
// What is copied from Bullet 3.24 is the arithmetic of the model, not its bits: swept contacts differ by
// rounding after one step from the same state. With converged contacts those that stick are solved at
// once, to where the sweeps lead, and a hull's contacts are vertices. Frames: W, B as in scene.hpp; L the
// pedestal; P the support, origin at the centre of its box, z normal to the top.

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "contact_rows.hpp"
#include "hull_scan.hpp"
#include "low_vertices.hpp"
#include "vsr2/scene.hpp"
#include "vsr2/world.hpp"

namespace vsr2 {

/// What the stepper needs to know of a scene: shared by all its worlds.
struct FastModel {
  /// Of a scene for which fast_refusal() has no reason.
  explicit FastModel(const Scene& scene);

  bool is_box = false;
  PointColumns vertices;  ///< of a hull, in B [m]
  double radius = 0.0;    ///< of the vertices about B's origin [m]
  Eigen::Vector3d box_half = Eigen::Vector3d::Zero();
  Eigen::Vector3d p_BC = Eigen::Vector3d::Zero();  ///< of the part [m]
  Eigen::Matrix3d R_BC = Eigen::Matrix3d::Identity();
  /// Vertices this near the lowest are as low in Bullet's search for the closest points, which swept
  /// contacts then ask [m].
  double same_height = 0.0;
  std::unique_ptr<btConvexHullShape> hull;
  std::unique_ptr<btBoxShape> support_box;
  btTransform X_BS;  ///< of the hull
  /// Bullet takes the first body of a pair for its choice among contact points: the rock where a
  /// compound wraps it alone, else the support.
  bool rock_is_first = false;
  /// A compound wraps one of them, so Bullet looks at the contacts it has before it adds new ones.
  bool is_wrapped = false;
  Eigen::Vector3d bounds_centre = Eigen::Vector3d::Zero();  ///< of Bullet's bounding box, in C [m]
  Eigen::Vector3d bounds_half = Eigen::Vector3d::Zero();    ///< its half edges [m]
  double margin = 0.0;  ///< of the hull and of the support's top [m]
  Eigen::Vector3d support_half = Eigen::Vector3d::Zero();  ///< [m]
  Pose X_LP;  ///< a box that is turned or off centre in the pedestal's frame
  double breaking_threshold = 0.0;                         ///< [m]
  double deepest = 0.0;  ///< greatest penetration the contact geometry holds for [m]
  double guard = 0.0;    ///< least distance of contacts from the top's edge, without depth [m]

  double mass = 0.0;
  Eigen::Vector3d inverse_inertia = Eigen::Vector3d::Zero();
  Eigen::Vector3d inertia = Eigen::Vector3d::Zero();
  EngineSettings engine;
  ContactValues pair;
};

/// Motion of the support at the start of a step; velocities are those over the step.
struct Support : PedestalMotion {
  bool level = true;  ///< R_WP is the identity and w_WP zero: saves the rotations
};

/// A joint by which the support feels the contacts: a motor along x, or a sprung pitch about y.
struct SupportMotor {
  double inverse_mass = 0.0;     ///< 0: no motor, the support's motion is prescribed [1/kg]
  double target_velocity = 0.0;  ///< [m/s]
  double maximum_impulse = 0.0;  ///< [N s]
  double pitch_response = 0.0;   ///< rate of pitch by an angular impulse [1 / (kg m^2)]
  Eigen::Vector3d p_WA = Eigen::Vector3d::Zero();  ///< of the pitch axis [m]
  double velocity_change = 0.0;  ///< result [m/s] or [rad/s]

  /// The motor's row, at a velocity of the support along x [m/s].
  MotorRow row(double velocity) const {
    return {inverse_mass, target_velocity - velocity, maximum_impulse};
  }
};

class FastStepper {
 public:
  explicit FastStepper(std::shared_ptr<const FastModel> model)
      : model_(std::move(model)), low_(model_->vertices.view(), model_->radius) {}

  RockState state;  ///< of the rock; the orientation's sign is arbitrary
  /// Factors of the contacts' lateral friction.
  std::array<double, 4> friction_scale{1.0, 1.0, 1.0, 1.0};

  /// The contact geometry no longer holds from here on.
  enum class Verdict { in_domain, off_the_top, too_deep };

  /// Forgets all contacts.
  void clear();
  struct Contact;
  struct Snapshot;
  /// State and contacts, to take a step back.
  Snapshot snapshot() const;
  void restore(const Snapshot& snapshot);
  /// First half of a step: contacts for the state and support as they are. On any verdict other
  /// than in_domain nothing was changed.
  Verdict detect(const Support& support);
  /// Second half: velocities, impulses, positions.
  void advance(const Support& support, SupportMotor& motor, double dt);

  struct Contact {
    Eigen::Vector3d p_B;  ///< on the rock
    Eigen::Vector3d p_P;  ///< on the support
    Eigen::Vector3d r_P;  ///< rock point from the mass centre, along P's axes
    Eigen::Vector3d s_P;  ///< support point from P's origin, along P's axes
    double distance;
    double normal_impulse;
    double lateral_impulse_1;  ///< on the rock, along -y of P
    double lateral_impulse_2;  ///< on the rock, along x of P
  };
  struct Snapshot {
    RockState state;
    std::array<Contact, 4> contacts;
    int count;
    std::int64_t held;
    int closed;
  };
  const FastModel& model() const { return *model_; }
  int contact_count() const { return count_; }
  const Contact& contact(int i) const { return contacts_[i]; }
  /// Whether a vertex, from the mass centre along P's axes, is one of the contacts or would replace one.
  bool keeps(const Eigen::Vector3d& vertex_P) const;
  /// Sweeps of the latest step that were done one by one; 0: no contact slid, and none was needed.
  int iterations() const { return iterations_; }
  /// Steps since a contact opened, closed or slid.
  std::int64_t held() const { return held_; }

 private:
  bool closest_by_bullet(const Support& support, Eigen::Vector3d& p_W_rock,
                         Eigen::Vector3d& p_W_support, double& distance) const;
  struct ContactStep;
  bool stick(const ContactStep& step, const Support& support, const SupportMotor& motor,
             VelocityChange<double>& change);
  void sweep(const ContactStep& step, const Support& support, const SupportMotor& motor,
             VelocityChange<double>& change);
  // Contacts have their impulses; `held`: those that pressed before stick and press, and no others.
  void note_closed(bool held);
  void move(const Eigen::Vector3d& v, const Eigen::Vector3d& w, double dt);
  // The rock's pose in the support's frame.
  struct RockOverTop {
    Eigen::Matrix3d R_PB;
    Eigen::Vector3d p_PB;
  };
  Verdict detect_box(const RockOverTop& rock);
  Verdict detect_hull(const RockOverTop& rock, const Support& support);
  bool is_off_the_edge(const Eigen::Vector3d& point, double depth) const;
  bool boxes_meet(const RockOverTop& rock) const;
  void refresh(const RockOverTop& rock);
  void add(const Eigen::Vector3d& p_B, const Eigen::Vector3d& p_P, double distance);
  int slot_when_full(const Eigen::Vector3d& point, double distance) const;

  std::shared_ptr<const FastModel> model_;
  std::array<Contact, 4> contacts_{};
  int count_ = 0;
  int iterations_ = 0;
  std::int64_t held_ = 0;
  int closed_ = 0;  ///< contacts that pressed in the latest step
  LowVertices low_;
};

}  // namespace vsr2
