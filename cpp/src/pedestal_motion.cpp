#include <cmath>

#include "vsr2/world.hpp"

namespace vsr2 {

Eigen::Vector3d pitch_axis(const PedestalSpec& pedestal, const PedestalState& state) {
  return {pedestal.p_WP0.x() + state.position, pedestal.p_WP0.y() + state.excursion.transverse,
          pedestal.pitch_pivot + state.excursion.vertical};
}

PedestalMotion pedestal_motion(const PedestalSpec& pedestal, const PedestalState& state) {
  // P's origin lies by this over the pitch axis.
  const double arm = pedestal.p_WP0.z() - pedestal.pitch_pivot;
  const Excursion& x = state.excursion;
  const Excursion& rate = state.excursion_rate;
  const double sine = std::sin(x.pitch);
  const double cosine = std::cos(x.pitch);
  PedestalMotion motion;
  motion.p_WP = pedestal.p_WP0 + Eigen::Vector3d(state.position + arm * sine, x.transverse,
                                                 x.vertical + arm * (cosine - 1.0));
  motion.R_WP << cosine, 0, sine, 0, 1, 0, -sine, 0, cosine;
  motion.v_WP = {state.velocity + arm * cosine * rate.pitch, rate.transverse,
                 rate.vertical - arm * sine * rate.pitch};
  motion.w_WP = {0, rate.pitch, 0};
  return motion;
}

PedestalState on_the_way(const PedestalState& start, const PedestalState& now,
                         const DriveTarget& target, int i, int n, double dt) {
  const auto place = [&](double from, double to) { return from + (to - from) * i / n; };
  PedestalState next;
  next.position = place(start.position, target.position);
  next.velocity = (next.position - now.position) / dt;
  const auto follow = [&](double Excursion::* part) {
    next.excursion.*part = place(start.excursion.*part, target.excursion.*part);
    next.excursion_rate.*part = (next.excursion.*part - now.excursion.*part) / dt;
  };
  follow(&Excursion::transverse);
  follow(&Excursion::vertical);
  follow(&Excursion::pitch);
  return next;
}

void check_drive(const PedestalSpec& pedestal, Drive drive) {
  if (pedestal.pitch_spring && drive != Drive::prescribed_spatial)
    throw InvalidInput("the pedestal has a sprung pitch joint; it needs the drive prescribed_spatial");
}

void check_target(const PedestalSpec& pedestal, Drive drive, const DriveTarget& target) {
  const Excursion& x = target.excursion;
  if (drive != Drive::prescribed_spatial && (x.transverse != 0 || x.vertical != 0 || x.pitch != 0))
    throw InvalidInput("the pedestal moves along x only with this drive; use prescribed_spatial");
  if (pedestal.pitch_spring && x.pitch != 0)
    throw InvalidInput(
        "the pedestal pitches on a spring and takes no set-points of pitch; leave one of them out");
}

}  // namespace vsr2
