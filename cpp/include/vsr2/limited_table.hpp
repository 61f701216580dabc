#pragma once
// A table whose speed and acceleration are capped, and that comes back to its command.

#include <cstddef>

namespace vsr2 {

/// Limits of a table, and how it comes back to its command. Where x, v and a are the command's, and
/// p and s the table's place and speed before a step, it is pushed by
///
///   a + damping (v - s - a step) + stiffness (x - p - v step),
///
/// clipped to the limits; critically damped where damping^2 = 4 stiffness.
struct TableLimits {
  double speed = 0.0;         ///< greatest, to either side [m/s]
  double acceleration = 0.0;  ///< greatest, to either side [m/s^2]
  double stiffness = 0.0;     ///< [1/s^2]
  double damping = 0.0;       ///< [1/s]
  double step = 0.0;          ///< between samples [s]
};

/// Replaces a command by what a table does that begins at a place [m] and with a speed [m/s].
///
/// @param size samples of each array.
/// @param displacement of the command, then of the table [m].
/// @param velocity likewise [m/s].
/// @param acceleration likewise [m/s^2].
void follow_within_limits(const TableLimits& limits, double place, double speed, std::size_t size,
                          double* displacement, double* velocity, double* acceleration);

}  // namespace vsr2
