#pragma once
// When a rock rests.

#include <cstdint>

#include "vsr2/world.hpp"

namespace vsr2 {

struct RestCriterion {
  double linear_speed = 1e-3;   ///< relative to the pedestal [m/s]
  double angular_speed = 2e-3;  ///< [rad/s]
  double window = 0.25;         ///< [s]
};

/// Time steps in a time [s].
std::int64_t steps_in(double time, double time_step);

/// Counts how long the rock has been slow relative to the pedestal, and a pedestal that swings on a
/// spring slow too, without a break.
class RestClock {
 public:
  RestClock(const RestCriterion& criterion, double time_step, bool pedestal_swings);
  /// Takes note of a time step; true: it has rested for a window.
  bool at_rest(const RockState& rock, const PedestalMotion& pedestal);
  /// It is known to have rested for so many time steps more.
  void rested(std::int64_t steps) { quiet_ += steps; }
  std::int64_t window_steps() const { return needed_; }
  bool at_rest_for(std::int64_t windows) const { return quiet_ >= windows * needed_; }
  std::int64_t quiet_steps() const { return quiet_; }

 private:
  RestCriterion criterion_;
  bool pedestal_swings_;
  std::int64_t needed_;
  std::int64_t quiet_ = 0;
};

}  // namespace vsr2
