#pragma once
// A pedestal that pitches on a spring, off by default.

#include <limits>

namespace vsr2 {

/// The pedestal's pitch axis (PedestalSpec::pitch_pivot) as a joint on a spring and a dashpot. With w
/// the angular frequency, I the inertia and a the acceleration of the axis along x,
///
///   pitch'' + 2 damping w pitch' + w^2 pitch = -w^2 compliance a + M / I.
///
/// M is the moment about the axis of all that the rock exerts on the pedestal: contact forces, friction
/// included, and the reactions of the mechanisms. The rock's contacts are solved together with
/// the joint, so that neither may be too light for the other.
struct PitchSpring {
  double frequency = 10.0;  ///< without a rock and damping, w / (2 pi) [Hz]
  double damping = 0.1;     ///< damping ratio [1]
  double compliance = 0.0;  ///< lean against a constant acceleration [rad / (m/s^2)]
  /// Of the pedestal about the axis [kg m^2]; infinite: the rock does not push back.
  double inertia = std::numeric_limits<double>::infinity();
};

}  // namespace vsr2
