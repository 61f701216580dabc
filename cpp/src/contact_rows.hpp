#pragma once
// The rows of a contact between a rock and a flat support, and the one algebra that sweeps over
// numbers and over linear forms share; private to the core.
//
// A row i demands a relative velocity in one direction. With v = (w, u, q) the changes of the rock's
// angular velocity w [rad/s] and linear velocity u [m/s] along the support's axes and of the
// support's joint rate q [rad/s or m/s], lambda_i its impulse [N s; N m s for spinning], J_i its
// Jacobian and M the masses, projected Gauss-Seidel makes each row in turn
//
//   lambda_i <- project(lambda_i + k_i^-1 (b_i - c_i lambda_i - J_i v)),    k_i = J_i M^-1 J_i^T + c_i,
//   v <- v + M^-1 J_i^T (change of lambda_i),
//
// with b_i the velocity wanted less the one without impulses [m/s or rad/s] and c_i the softness over
// the time step [1/kg] of normal rows (supplement S2.2). The method is the sequential impulse of
// Catto, "Iterative Dynamics with Temporal Coherence" (2005); rows, bounds and order are those of
// Bullet's btMultiBodyConstraintSolver (normal rows, spinning rows, then pairs of lateral rows, each
// pair projected onto the disc of radius mu lambda_n).

#include <algorithm>
#include <type_traits>

#include <Eigen/Dense>

#include "always_inline.hpp"

namespace vsr2 {

/// What of the support yields to the contacts: nothing, a motor along x, or a sprung pitch about y.
enum class Joint { none, motor, pitch };

/// Calls `act` with the kind as a type, whose value is a constant.
template <typename Act>
VSR2_INLINE auto with_joint(Joint kind, Act act) {
  switch (kind) {
    case Joint::pitch: return act(std::integral_constant<Joint, Joint::pitch>{});
    case Joint::motor: return act(std::integral_constant<Joint, Joint::motor>{});
    default: return act(std::integral_constant<Joint, Joint::none>{});
  }
}

/// Changes of velocity along the support's axes: numbers, or linear forms in each entry.
template <typename Scalar>
struct VelocityChange {
  Scalar angular[3]{};  ///< of the rock [rad/s]
  Scalar linear[3]{};   ///< of the rock [m/s]
  Scalar joint{};       ///< of the support's joint [rad/s or m/s]
};

/// Adds the constant part of an affine function. A linear form has none: constants drop out of the
/// changes between sweeps.
inline double with_constant(double linear, double constant) { return linear + constant; }

/// The joint's speed after its motor's impulse, which changes it by `change`. The motor of a linear
/// form is free, so that it undoes the whole speed, without rounding.
inline double driven(double speed, double change) { return speed + change; }

/// Response of the rock to unit impulses.
struct RockResponse {
  double inverse_mass;              ///< [1/kg]
  Eigen::Matrix3d inverse_inertia;  ///< along the support's axes [1/(kg m^2)]
};
/// The joint as a contact feels it.
struct JointAtContact {
  Eigen::Vector3d slip = Eigen::Vector3d::Zero();  ///< of the rock over the support by a unit rate [m or 1]
  double spin = 0.0;      ///< of the rock over the support about z by a unit rate [1]
  double response = 0.0;  ///< rate by a unit of its own impulse [1 / (kg m^2) or 1/kg]
};

/// A row, with the entries of its Jacobian that are not 0 on a support whose normal is z: about the
/// axes kFirst and kSecond, and in the sense kSense along the axis kLinear (-1: none, it turns).
template <int kFirst, int kSecond, int kLinear, int kSense>
struct ContactRow {
  static constexpr double kSign = kSense;

  // J_i / k_i: from velocities to impulses.
  double first, second, along, joint;
  // M^-1 J_i^T: change of the velocities by a unit impulse.
  double angular_response[3], linear_response, joint_response;
  double target;              ///< b_i / k_i [N s]
  double keep;                ///< 1 - c_i / k_i: share of a normal impulse that softness leaves [1]
  double inverse_mass;        ///< k_i [1/kg; 1/(kg m^2) for spinning]
  double impulse = 0.0;       ///< lambda_i [N s]
  double change = 0.0;        ///< of the impulse in the latest sweep [N s]
  double unbounded = 0.0;     ///< the impulse of the latest sweep before its projection [N s]

  /// The row's direction about the mass centre, for a contact at `r` from it: r x d [m; 1 for spinning].
  static Eigen::Vector3d lever(const Eigen::Vector3d& r) {
    if constexpr (kLinear < 0) return {0, 0, kSign};
    if constexpr (kLinear == 0) return {0, kSign * r.z(), -kSign * r.y()};
    if constexpr (kLinear == 1) return {-kSign * r.z(), 0, kSign * r.x()};
    return {kSign * r.y(), -kSign * r.x(), 0};
  }

  /// `r`: from the mass centre to the contact [m]; `wanted`: b_i; `softness`: c_i.
  template <Joint kJoint>
  VSR2_INLINE void fill(const RockResponse& rock, const Eigen::Vector3d& r, const JointAtContact& yields,
                        double wanted, double softness = 0.0) {
    const auto& K = rock.inverse_inertia;
    const Eigen::Vector3d about = lever(r);
    const double a = about[kFirst];
    double mass = 0.0;
    if constexpr (kSecond < 0) {
      for (int i = 0; i < 3; ++i) angular_response[i] = K(i, kFirst) * a;
      mass = a * angular_response[kFirst];
    } else {
      const double b = about[kSecond];
      for (int i = 0; i < 3; ++i) angular_response[i] = K(i, kFirst) * a + K(i, kSecond) * b;
      mass = a * angular_response[kFirst] + b * angular_response[kSecond] + rock.inverse_mass;
    }
    inverse_mass = mass + softness;
    double by_joint = 0.0;
    if constexpr (feels(kJoint)) {
      by_joint = kSign * (kLinear < 0 ? yields.spin : yields.slip[std::max(kLinear, 0)]);
      joint_response = yields.response * by_joint;
      inverse_mass += by_joint * joint_response;
    }
    const double effective = 1.0 / inverse_mass;
    first = a * effective;
    if constexpr (kLinear >= 0) {
      linear_response = kSign * rock.inverse_mass;
      second = about[kSecond] * effective;
      along = kSign * effective;
    }
    if constexpr (feels(kJoint)) joint = by_joint * effective;
    target = wanted * effective;
    if constexpr (kLinear == 2) keep = 1.0 - softness * effective;
  }

  /// Whether the row feels the joint: a motor moves along x only.
  static constexpr bool feels(Joint kind) {
    return kind == Joint::pitch || (kind == Joint::motor && kLinear == 0);
  }

  /// J_i v / k_i: the impulse that would undo the row's share of the velocity [N s].
  template <Joint kJoint, typename Scalar>
  VSR2_INLINE Scalar speed(const VelocityChange<Scalar>& v) const {
    Scalar sum = first * v.angular[kFirst];
    if constexpr (kSecond >= 0) sum = (sum + second * v.angular[kSecond]) + along * v.linear[kLinear];
    if constexpr (feels(kJoint)) sum += joint * v.joint;
    return sum;
  }

  /// The impulse that meets the row's demand, whatever its bounds; `present`: the one it has [N s].
  template <Joint kJoint, typename Scalar>
  VSR2_INLINE Scalar demanded(const Scalar& present, const VelocityChange<Scalar>& v) const {
    // Only the normal row is soft.
    if constexpr (kLinear == 2) return with_constant(keep * present, target) - speed<kJoint>(v);
    return with_constant(present, target) - speed<kJoint>(v);
  }

  /// Calls `act` with each velocity that an impulse changes and its response to a unit of it.
  template <Joint kJoint, typename Scalar, typename Act>
  VSR2_INLINE void respond(VelocityChange<Scalar>& v, Act act) const {
    for (int i = 0; i < 3; ++i) act(v.angular[i], angular_response[i]);
    if constexpr (kLinear >= 0) act(v.linear[kLinear], linear_response);
    if constexpr (feels(kJoint)) act(v.joint, joint_response);
  }

  /// Adds what a change of the impulse does to the velocities.
  template <Joint kJoint, typename Scalar>
  VSR2_INLINE void apply(const Scalar& amount, VelocityChange<Scalar>& v) const {
    respond<kJoint>(v, [&](Scalar& velocity, double response) VSR2_INLINE_LAMBDA {
      velocity += response * amount;
    });
  }
};

using NormalRow = ContactRow<0, 1, 2, 1>;      // along z
using SpinningRow = ContactRow<2, -1, -1, 1>;  // about z
using Lateral1Row = ContactRow<0, 2, 1, -1>;   // along -y
using Lateral2Row = ContactRow<1, 2, 0, 1>;    // along x

/// As apply() of both rows of a lateral pair, whose effects are added before they are taken in.
template <Joint kJoint, typename Scalar>
VSR2_INLINE void apply_pair(const Lateral1Row& row_1, const Scalar& amount_1,
                            const Lateral2Row& row_2, const Scalar& amount_2,
                            VelocityChange<Scalar>& v) {
  for (int i = 0; i < 3; ++i)
    v.angular[i] += row_1.angular_response[i] * amount_1 + row_2.angular_response[i] * amount_2;
  v.linear[1] += row_1.linear_response * amount_1;
  v.linear[0] += row_2.linear_response * amount_2;
  if constexpr (Lateral1Row::feels(kJoint))
    v.joint += row_1.joint_response * amount_1 + row_2.joint_response * amount_2;
  else if constexpr (Lateral2Row::feels(kJoint))
    v.joint += row_2.joint_response * amount_2;
}

/// The row of a joint motor along x, which acts on the support alone: J_i v = q.
struct MotorRow {
  double inverse_mass = 0.0;  ///< k_i, of the support; 0: no motor [1/kg]
  double wanted = 0.0;        ///< b_i, change of the joint's speed [m/s]
  double limit = 0.0;         ///< of the impulse [N s]
  double impulse = 0.0;       ///< [N s]
  double change = 0.0;        ///< of the impulse in the latest sweep [N s]

  /// As those of a ContactRow.
  template <typename Scalar>
  VSR2_INLINE Scalar demanded(const Scalar& present, const VelocityChange<Scalar>& v) const {
    return present + with_constant(-v.joint, wanted) / inverse_mass;
  }
  template <typename Scalar>
  VSR2_INLINE void apply(const Scalar& amount, VelocityChange<Scalar>& v) const {
    v.joint = driven(v.joint, inverse_mass * amount);
  }
  double bounded(double demand) const { return std::clamp(demand, -limit, limit); }
};

}  // namespace vsr2
