#pragma once
// What a rock at rest stands on; private to the core.

#include <array>
#include <vector>

#include <Eigen/Core>

#include "contact_laws.hpp"

namespace vsr2 {

/// The contacts by which the flat top of a pedestal presses on a rock.
struct Foothold {
  int count = 0;  ///< at most 4
  std::array<Eigen::Vector3d, 4> r_T;  ///< from the mass centre, along axes T, z the top's normal [m]
  Eigen::Matrix3d R_WT;
  FrictionBounds friction;    ///< the least of each contact at rest
  NormalLaw normal;           ///< of each contact
  double mass = 0.0;          ///< of the rock [kg]
  Eigen::Matrix3d inertia_T;  ///< about its mass centre [kg m^2]

  /// A vertex that may be the lowest while the contacts hold the rock.
  struct Low {
    Eigen::Vector3d r_T;  ///< from the mass centre [m]
    double offset;        ///< over the plane of the contacts [m]
  };
  std::vector<Low> low;       ///< those of a hull that are no contacts
  double same_height = 0.0;   ///< by which heights may differ that count as one [m]
};

}  // namespace vsr2
