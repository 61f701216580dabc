#include "vsr2/world.hpp"

#include <cmath>

#include "foothold.hpp"

namespace vsr2 {
namespace {

Eigen::Matrix3d turn_about_y(double sine, double cosine) {
  Eigen::Matrix3d turn;
  turn << cosine, 0, sine, 0, 1, 0, -sine, 0, cosine;
  return turn;
}

// The same bits as of a pitch of zero: one of its zeros is negative.
const Eigen::Matrix3d kLevel = turn_about_y(0.0, 1.0);

}  // namespace

Eigen::Vector3d pitch_axis(const PedestalSpec& pedestal, const PedestalState& state) {
  return {pedestal.p_WP0.x() + state.position, pedestal.p_WP0.y() + state.excursion.transverse,
          pedestal.pitch_pivot + state.excursion.vertical};
}

PedestalMotion pedestal_motion(const PedestalSpec& pedestal, const PedestalState& state) {
  // P's origin lies by this over the pitch axis.
  const double arm = pedestal.p_WP0.z() - pedestal.pitch_pivot;
  const Excursion& x = state.excursion;
  const Excursion& rate = state.excursion_rate;
  const bool level = x.pitch == 0;  // most pedestals never pitch
  const double sine = level ? 0.0 : std::sin(x.pitch);
  const double cosine = level ? 1.0 : std::cos(x.pitch);
  return {.p_WP = pedestal.p_WP0 + Eigen::Vector3d(state.position + arm * sine, x.transverse,
                                                   x.vertical + arm * (cosine - 1.0)),
          .R_WP = level ? kLevel : turn_about_y(sine, cosine),
          .v_WP = {state.velocity + arm * cosine * rate.pitch, rate.transverse,
                   rate.vertical - arm * sine * rate.pitch},
          .w_WP = {0, rate.pitch, 0}};
}

void require_rock(bool has_rock) {
  if (!has_rock) throw InvalidInput("there is no rock", Fault::no_rock);
}

void require_no_rock(bool has_rock) {
  if (has_rock) throw InvalidInput("there is a rock already; delete it first", Fault::rock_present);
}

bool World::foothold(Foothold&) const { return false; }

void World::carry(const DriveTarget&, const DriveTarget&) {
  throw InvalidInput("this world cannot carry its rock");
}

void check_start(const Pose& X_WB) {
  // The original's start orientation has five digits and is used as it stands.
  constexpr double tolerance = 1e-3;
  if (!X_WB.position.allFinite() || !X_WB.orientation.coeffs().allFinite() ||
      std::abs(X_WB.orientation.norm() - 1.0) > tolerance)
    throw InvalidInput("the rock's start pose is not finite or its quaternion is not of norm 1");
}

}  // namespace vsr2
