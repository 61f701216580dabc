#include "vsr2/limited_table.hpp"

#include <algorithm>

namespace vsr2 {

void follow_within_limits(const TableLimits& limits, double place, double speed, std::size_t size,
                          double* displacement, double* velocity, double* acceleration) {
  const double step = limits.step;
  for (std::size_t i = 0; i < size; ++i) {
    const double x = displacement[i], v = velocity[i], a = acceleration[i];
    const double wanted = a + limits.damping * (v - speed - a * step) + limits.stiffness * (x - place - v * step);
    const double push = std::clamp(wanted, -limits.acceleration, limits.acceleration);
    const double next = std::clamp(speed + push * step, -limits.speed, limits.speed);
    place += 0.5 * (speed + next) * step;
    displacement[i] = place;
    velocity[i] = next;
    acceleration[i] = (next - speed) / step;
    speed = next;
  }
}

}  // namespace vsr2
