#pragma once
// For how long a rock that rests on a moving pedestal stays at rest; private to the core.

#include <array>
#include <cstdint>
#include <optional>

#include "foothold.hpp"
#include "vsr2/trial.hpp"

namespace vsr2 {

/// Whether the contacts of a rock at rest go on to hold it, under a motion of the top.
///
/// While its contacts stick and press, the rock has three small motions q over the top: two tilts and a
/// rise (sticking_contacts.hpp). Contact i presses by its deflection d_i = n_i q, so that these obey the
/// linear equations that the stepper solves, with the same steps: with M the mass matrix of the three,
/// K the sum of n_i n_i^T, and F the forces that weight and top exert,
///
///     M (v' - v) = h F - K (v' + (erp / h) q) / softness,        q' = q + h v'.
///
/// Eigenvectors of K over M make three oscillators of them, and each takes a few operations a step.
/// The contacts hold the rock where every impulse is positive, every spring is compressed, the lateral
/// impulse of all lies within what friction bears of the normal ones, and no other vertex comes below all
/// contacts: it would be one more, which stays. What the motion adds
/// to rest is enlarged by kQuietStretch.safety, for what the model of small deflections leaves out.
///
/// Source of the modes: L. Meirovitch, "Fundamentals of Vibrations" (2001), ch. 7.
class Bearing {
 public:
  /// @param foothold outlives this.
  /// @param gravity [m/s^2].
  /// @param substep,substeps solver steps of a time step, each of `substep` [s].
  Bearing(const Foothold& foothold, double gravity, double substep, int substeps);

  /// Whether the contacts hold the rock on a top that does not move.
  bool stands() const { return stands_; }
  /// One more time step, in which the top's velocity changes by `dv_W` [m/s], in W; the first solver step
  /// takes all of it. Whether the contacts hold.
  bool advance(const Eigen::Vector3d& dv_W);
  /// Time in which a free motion of the slowest kind falls to 1 / e [s].
  double memory() const { return memory_; }

 private:
  // All three modes, of unit mass, by component. With the eigenvalue e and s = e / softness a step is
  // v' = (v + driven - restoring q) decay, q' = q + h v'.
  struct Modes {
    Eigen::Array3d decay;      ///< 1 / (1 + s)
    Eigen::Array3d restoring;  ///< s erp / h [1/s]
    Eigen::Matrix3d driven;    ///< by a change of the top's velocity along T
    Eigen::Array3d velocity = Eigen::Array3d::Zero();
    Eigen::Array3d place = Eigen::Array3d::Zero();
  };
  struct Contact {
    Eigen::RowVector3d rise;  ///< deflection by the modes
    double impulse;           ///< at rest, of a solver step [N s]
    double deflection;        ///< at rest, negative [m]
  };

  bool substep(const Eigen::Vector3d& dv_T);

  bool gains_contact(double lowest, const Eigen::Vector3d& place) const;

  const Foothold& foothold_;
  Modes modes_;
  Eigen::Matrix3d shapes_;  ///< of the modes: tilts about x and y of T [rad], rise [m]
  Eigen::Vector3d rest_;    ///< where the modes rest
  std::array<Contact, 4> contacts_;
  int count_ = 0;
  bool stands_ = false;
  double h_;
  int substeps_;
  double spring_ = 0.0;   ///< impulse by a deflection [kg/s]
  double damper_ = 0.0;   ///< impulse by a velocity [kg]
  double memory_ = 0.0;
  double mass_;
  FrictionBounds friction_;
  Eigen::Matrix3d R_TW_;
  Eigen::Matrix<double, 2, 3> swing_;  ///< velocity of the mass centre along the top, by the modes
  Eigen::Vector2d lateral_;            ///< impulse at rest, along the top [N s]
};

/// What is known of a rock at rest.
struct QuietStretch {
  std::int64_t last;      ///< set-point up to which it is still; that of now where it has to be stepped
  std::int64_t ask_from;  ///< first set-point from which to ask again
};

/// The set-points of a trial, and between which of them a rock at rest need not be stepped.
class QuietStretches {
 public:
  /// @param spec outlives this.
  explicit QuietStretches(const TrialSpec& spec);

  /// For how long the rock of `world` is still as it is at set-point `k`, contacts without memory of what
  /// was before, at most to `end`. `held`: time steps since one of its contacts opened, closed or slid;
  /// none where the rock is slow instead. Where asking was in vain it waits twice as long as before.
  QuietStretch from(const World& world, std::optional<std::int64_t> held, std::int64_t k,
                    std::int64_t end);

 private:
  Eigen::Vector3d velocity_change(std::int64_t k) const;
  QuietStretch predict(const World& world, std::optional<std::int64_t> held, std::int64_t k,
                       std::int64_t end);

  const TrialSpec& spec_;
  Foothold foothold_;  ///< kept for its memory
  std::int64_t wait_ = 1;  ///< before asking again [steps]
  double dt_;
  int substeps_;
};

}  // namespace vsr2
