#pragma once
// What the mechanisms of a scene do to the rock, step by step, in whatever engine; private to the
// core.

#include <array>
#include <cstddef>
#include <memory>
#include <vector>

#include "vsr2/world.hpp"

namespace vsr2 {

/// A contact between rock and pedestal as a step used it.
struct Touch {
  Eigen::Vector3d p_W;       ///< on the rock, at the start of the step [m]
  Eigen::Vector3d normal_W;  ///< from pedestal to rock, unit
  double impulse;            ///< along the normal [N s]
};

/// Mechanisms in action on one rock. A value: copies go on independently with the same bits.
///
/// A step is: begin_step(), the engine's contacts, friction_scale() for each of them, the engine's
/// solution, end_step(). Nothing allocates after construction.
class RockMechanics {
 public:
  explicit RockMechanics(const Scene& scene);

  /// Whether the scene has any mechanism.
  static bool needed(const Scene& scene);

  /// A rock was put down: forgets all that was.
  void start(const RockState& rock, const PedestalMotion& pedestal);
  /// The rock, at rest on the pedestal, was moved with it by `way` [m], without turning.
  void carry(const RockState& rock, const PedestalMotion& pedestal, const Eigen::Vector3d& way);
  /// A copy that another thread may go on with.
  RockMechanics independent() const;
  /// Adds the forces of a step to the rock's velocity; false: nothing changed.
  bool begin_step(RockState& rock, double dt);
  /// Factor of the coefficient of friction at a contact.
  double friction_scale(const Eigen::Vector3d& p_W, const Eigen::Vector3d& normal_W) const;
  /// Takes note of a step and sets the energy of an impact that is over; false: no velocity changed.
  /// `pedestal` is the motion over the step, `touches` its contacts.
  bool end_step(RockState& rock, const PedestalMotion& pedestal, const std::vector<Touch>& touches,
                double dt);

 private:
  struct Velocity {
    Eigen::Vector3d v;  ///< of B's origin [m/s]
    Eigen::Vector3d w;  ///< [rad/s]
    Eigen::Vector3d at(const Eigen::Vector3d& r) const { return v + w.cross(r); }
  };
  static Velocity relative(const RockState& rock, const PedestalMotion& pedestal);
  Eigen::Matrix3d inertia_W(const RockState& rock) const;

  bool resist_rocking(RockState& rock, double dt) const;
  bool pull_bond(RockState& rock, double dt) const;
  bool pull_tether(RockState& rock, double dt) const;
  void follow_bond(const RockState& rock, const std::vector<Touch>& touches, double dt);
  void form_bond(const RockState& rock, const std::vector<Touch>& touches);
  double height_of_bond(const RockState& rock) const;
  bool follow_impact(RockState& rock, const PedestalMotion& pedestal,
                     const std::vector<Touch>& touches, double dt);
  bool close_impact(RockState& rock, const PedestalMotion& pedestal, const Eigen::Vector3d& force,
                    double dt);
  /// Index of the support at a point that bore the rock lately; their number: there is none.
  std::size_t support_at(const Eigen::Vector3d& p_B) const;
  void note_support(const std::vector<Touch>& touches, double dt);
  static Velocity in_body(const RockState& rock, const Velocity& velocity);
  double kinetic_energy(const Velocity& velocity_B) const;

  /// What the rock turns about after an impact, in B: a point, or a line through it.
  struct Pivot {
    Eigen::Vector3d p_B = Eigen::Vector3d::Zero();
    Eigen::Vector3d chord = Eigen::Vector3d::Zero();  ///< unit, or zero: a point
  };
  /// False: there is none.
  bool find_pivot(const Velocity& now_B, const Eigen::Vector3d& up_B, Pivot& pivot) const;
  /// The rotation about a pivot nearest to a velocity, in the metric of the inertia.
  Velocity about(const Pivot& pivot, const Velocity& velocity_B) const;

  Mechanisms mechanisms_;
  double mass_;
  double gravity_;
  Eigen::Vector3d inertia_;
  struct Outline {
    std::vector<Eigen::Vector3d> vertices;   ///< of the rock's hulls in B [m]
    std::vector<Eigen::Vector2d> footprint;  ///< room for form_bond()
  };
  std::shared_ptr<Outline> outline_;  ///< shared by copies, which belong to one thread

  PedestalMotion pedestal_;  ///< over the latest step
  RockState before_;         ///< at the start of the step, without its forces
  // Contact forces of the latest step.
  double normal_force_ = 0.0;  ///< [N]
  Eigen::Vector3d centre_W_ = Eigen::Vector3d::Zero();

  enum class Bond { none, holds, broken };
  Bond bond_ = Bond::none;
  double rested_ = 0.0;     ///< [s]
  double strength_ = 0.0;   ///< sigma A [N]
  double bond_height_ = 0.0;
  Eigen::Vector3d bond_B_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d bond_normal_P_ = Eigen::Vector3d::UnitZ();  ///< of the top, which may slope

  Eigen::Vector3d up_B_ = Eigen::Vector3d::UnitZ();  ///< the pedestal's normal at the start
  double start_height_ = 0.0;                        ///< of the mass centre over the lowest vertex [m]

  // Points that bear a rock within an impact; one beyond is not noted.
  static constexpr std::size_t kSupports = 16;
  struct Support {
    Eigen::Vector3d p_B;
    double idle;  ///< since it last bore the rock [s]
  };
  struct Impact {
    bool open = false;
    double elapsed = 0.0;  ///< [s]
    double quiet = 0.0;    ///< since its last blow [s]
    double blow = 0.0;     ///< speed of the first one [m/s]
    double energy = 0.0;   ///< before it [J]
    double lead = 0.0;     ///< half a step's work at the speed before it [J]
    double work = 0.0;     ///< of weight and inertia force since it began [J]
    double greatest_work = 0.0;
    Velocity before_B{Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
    // Points that bore the rock lately, in an impact or not.
    std::array<Support, kSupports> support;
    std::size_t supports = 0;
  };
  Impact impact_;
};

}  // namespace vsr2
