#pragma once
// Contacts that stick, solved at once; private to the core.
//
// Where no contact slides, the sweeps of contact_rows.hpp lead to one velocity, whatever their order.
// This finds it without them. Closed contacts of one height z below the mass centre, two or more of
// them, leave the rock three ways to move over the support: a turn (a, b) about the x and y axes
// through the height z, and a rise c. Its relative velocity is then
//
//   w = (a, b, 0),  u = (-z b, z a, c)
//
// and Gauss's principle of least constraint gives it from the relative velocity (w0, u0) before all
// impulses: with the inertia I about the mass centre and the mass m,
//
//   (I + m z^2) (a, b) = (I w0)_xy + m z (u0_y, -u0_x) + sum_i lambda_i (y_i, -x_i),
//   m c = m u0_z + sum_i lambda_i.
//
// The normal impulses lambda_i >= 0 are the linear complementarity problem of the rows' demand
// c + a y_i - b x_i + softness lambda_i >= target_i. One closed contact also lets the rock spin, which
// its spinning friction may stop.
//
// A support on a pitch joint moves too: by a change s of its rate about the axis p, which carries the
// mass centre by s e. That is one more unknown, with the inertia J of the joint. With D the matrix of
// x = (a, b, c) above, and n_i = (y_i, -x_i, 1) the row of a contact,
//
//   k = ((I p)_x + m z e_y, (I p)_y - m z e_x, m e_z),    S = J + p I p + m e^2 - k D^-1 k,
//   s = (p I w0 + m e u0 - k x) / S,
//
// with x from the equations above; the rock then moves by x - s D^-1 k over the support, and the
// compliance between contacts i and j is greater by (n_i D^-1 k) (n_j D^-1 k) / S. Points of one contact
// lie a little apart on rock and support, which the support's turning shows: u0 and e are taken with the
// mean gap of the closed contacts, and what a contact's own differs by adds to its rise.
//
// Source: Featherstone, "Rigid Body Dynamics Algorithms" (2008), ch. 3 (constrained motion) and 11
// (contact).
//
// The demand is that of the normal rows of contact_rows.hpp, but a direct solution needs the compliance
// of all rows at once, in the two or three motions that sticking leaves. A ContactRow holds one row
// over all seven velocities, divided by its own mass, so nothing of it is used here.

#include <array>

#include <Eigen/Core>

#include "contact_laws.hpp"

namespace vsr2 {

/// A contact as a step finds it.
struct StickingContact {
  double x, y, z;  ///< from the mass centre, along the support's axes [m]
  double target;   ///< normal velocity wanted [m/s]
  FrictionBounds bounds;
  Eigen::Vector3d gap = Eigen::Vector3d::Zero();  ///< from the support's point to the rock's [m]
  // Results [N s].
  double normal = 0.0;     ///< in: greater than 0 where the contact was closed before
  double lateral_x = 0.0;  ///< on the rock
  double lateral_y = 0.0;
};

/// A joint by which the support pitches.
struct StickingJoint {
  double response = 0.0;  ///< rate by an angular impulse; 0: no joint [1 / (kg m^2)]
  Eigen::Vector3d axis = Eigen::Vector3d::Zero();   ///< p, unit vector along the support's axes
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();   ///< of the support before the impulses [rad/s]
  Eigen::Vector3d carry = Eigen::Vector3d::Zero();  ///< e [m]
};

struct StickingProblem {
  std::array<StickingContact, 4> contacts;
  int count = 0;
  double mass = 0.0;                       ///< [kg]
  Eigen::Matrix3d inertia;                 ///< along the support's axes [kg m^2]
  double softness = 0.0;                   ///< of the normal rows [1/kg]
  StickingJoint joint;
  /// In: the rock's velocity relative to the support; out: the change of its own [rad/s], [m/s].
  Eigen::Vector3d angular, linear;
  double pitch_rate = 0.0;  ///< out: change of the support's [rad/s]
};

/// Whether all closed contacts stick; then the problem holds impulses and the change of the velocity.
bool solve_sticking(StickingProblem& problem);

}  // namespace vsr2
