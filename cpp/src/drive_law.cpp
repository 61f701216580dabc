#include "drive_law.hpp"

#include <algorithm>
#include <cmath>

#include "velocity_damping.hpp"

namespace vsr2 {

PedestalState on_the_way(Drive drive, const PedestalState& start, const PedestalState& now,
                         const DriveTarget& target, int i, int n, double dt) {
  const auto place = [&](double from, double to) { return from + (to - from) * i / n; };
  PedestalState next;
  next.position = place(start.position, target.position);
  next.velocity = (next.position - now.position) / dt;
  if (drive != Drive::prescribed_spatial) return next;
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
    throw InvalidInput("the pedestal has a sprung pitch joint; it needs the drive prescribed_spatial",
                       Fault::drive);
}

void check_target(const PedestalSpec& pedestal, Drive drive, const DriveTarget& target) {
  const Excursion& x = target.excursion;
  if (drive != Drive::prescribed_spatial && (x.transverse != 0 || x.vertical != 0 || x.pitch != 0))
    throw InvalidInput("the pedestal moves along x only with this drive; use prescribed_spatial",
                       Fault::drive);
  if (pedestal.pitch_spring && x.pitch != 0)
    throw InvalidInput(
        "the pedestal pitches on a spring and takes no set-points of pitch; leave one of them out",
        Fault::drive);
}

double MotorLaw::damped(const EngineSettings& engine, double velocity, double dt) {
  return velocity - dt * velocity * damping_rate(engine.linear_damping, std::abs(velocity));
}

double MotorLaw::speed(Drive drive, const PedestalState& now, const DriveTarget& target, double dt) {
  return std::clamp(position_gain * (target.position - now.position) / dt + now.velocity +
                        velocity_gain * (velocity_reference(drive, target) - now.velocity),
                    -speed_limit, speed_limit);
}

}  // namespace vsr2
