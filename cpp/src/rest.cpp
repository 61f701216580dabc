#include "vsr2/rest.hpp"

#include <algorithm>
#include <cmath>

namespace vsr2 {

std::int64_t steps_in(double time, double time_step) {
  return static_cast<std::int64_t>(std::llround(time / time_step));
}

RestClock::RestClock(const RestCriterion& criterion, double time_step, bool pedestal_swings)
    : criterion_(criterion),
      pedestal_swings_(pedestal_swings),
      needed_(std::max<std::int64_t>(1, steps_in(criterion.window, time_step))) {}

bool RestClock::at_rest(const RockState& rock, const PedestalMotion& pedestal) {
  const Eigen::Vector3d v = rock.v_WB - pedestal.velocity_at(rock.p_WB);
  const Eigen::Vector3d w = rock.w_WB - pedestal.w_WP;
  const bool still = !pedestal_swings_ || pedestal.w_WP.norm() < criterion_.angular_speed;
  const bool slow =
      still && v.norm() < criterion_.linear_speed && w.norm() < criterion_.angular_speed;
  quiet_ = slow ? quiet_ + 1 : 0;
  return at_rest_for(1);
}

}  // namespace vsr2
