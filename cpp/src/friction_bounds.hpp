#pragma once
// What a contact's friction bears; private to the core.

#include "always_inline.hpp"
#include "vsr2/contact_model.hpp"

namespace vsr2 {

/// Bounds of a contact's friction by its normal impulse: lambda_t <= mu lambda_n for the size of the
/// lateral impulse, |lambda_s| <= r lambda_n for the spinning one (supplement S2.1). The one place where
/// contact parameters bound rows: sweeps over numbers and over linear forms, contacts that stick and
/// rocks at rest take the bounds from here. All of them take a bound as proportional to lambda_n.
struct FrictionBounds {
  double coefficient = 0.0;  ///< mu [1]
  double lever = 0.0;        ///< r [m]

  /// `scale`: factor of the lateral friction [1].
  static FrictionBounds of(const ContactValues& pair, double scale) {
    return {.coefficient = pair["lateral_friction"] * scale, .lever = pair["spinning_friction"]};
  }

  /// Greatest lateral impulse [N s].
  template <typename Scalar>
  VSR2_INLINE Scalar lateral(const Scalar& normal) const {
    return coefficient * normal;
  }
  /// Greatest spinning impulse [N m s].
  template <typename Scalar>
  VSR2_INLINE Scalar spinning(const Scalar& normal) const {
    return lever * normal;
  }
};

}  // namespace vsr2
