#pragma once
// The numbers of the core that were chosen, by what they are of, each with unit and source. Results
// state them all in their provenance, by core_constants().
//
// Elsewhere stand, beside their use: the values of Bullet and PyBullet, guards against rounding, and
// what no bit of a result depends on.

#include <cstdint>
#include <map>
#include <string>
#include <variant>

namespace vsr2 {

/// When a rock rests, beside the criterion of a study: trial.cpp, trial_world.cpp.
struct RestConstants {
  /// Speeds of a rock that has come to rest, not one that trembles or creeps below the settling criterion
  /// [m/s], [rad/s]. Settled again from its pose it would be where it is, within 1e-9 m.
  double standing_speed = 1e-6;
  double standing_rate = 2e-6;
  /// A rock that leans may be about to leave its point of balance, where its speed grows as
  /// exp(sqrt(m g r / I) t); it must keep still for so many windows before the trial is stopped early.
  /// Chosen by hand.
  std::int64_t leaning_windows = 8;
  /// A rock that trembles on few points creeps while it counts as resting; it is stopped early only if
  /// so many times its creep over the rest of the tail leaves the outcome as it is [1]. Chosen by hand.
  double creep_allowance = 2.0;
};
inline constexpr RestConstants kRest;

/// Rocks at rest that are not stepped: quiet_stretch.cpp, trial.cpp.
struct QuietStretchConstants {
  /// A rock that is slower than this [m/s], [rad/s] for so long [s] rests, as in settling. A scanned rock
  /// on three points still trembles between 1e-4 and 1e-3 m/s. A quiet stretch leaves that out, which
  /// changes fewer outcomes than a start that is moved by 1e-6 m (docs/validation/engines.md).
  double still_speed = 1e-3;
  double still_rate = 2e-3;
  double still_window = 0.25;
  /// Deflections are taken for gone after so many times the memory of the contacts [1], e^-10 of them
  /// being left. After five times a block began to rock with velocities off by 1e-8 m/s, and 3 % of
  /// borderline outcomes differed; after ten 1.4 % do (studies/quiet_stretches.py).
  double faded = 10.0;
  /// Factor of what the motion adds to rest, for what the model of small deflections leaves out [1].
  /// Chosen by hand.
  double safety = 1.25;
};
inline constexpr QuietStretchConstants kQuietStretch;

/// Jumps over many sweeps: contact_jump.cpp, contact_sweeps.cpp.
struct SweepConstants {
  /// Greatest change of direction of a sliding contact that a jump makes [rad]: speed against error. Of
  /// 150 sweeps over two to four sliding contacts it leaves 13 to be done one by one, in the mean of
  /// 20,000 draws, with velocities within 2e-10 m/s of those of all sweeps; ten times as much leaves 11,
  /// and 6e-9 m/s. tests/cpp/test_fast_stepper.cpp bounds the error.
  double greatest_turn = 1e-5;
  /// The same in one sweep, after which a jump is tried [rad]; a tenth of what a jump may make, which then
  /// seldom fails.
  double greatest_turn_before = 1e-6;
};
inline constexpr SweepConstants kSweep;

/// Contacts that stick, solved at once: sticking_contacts.cpp.
struct StickingConstants {
  /// Heights that differ by less than this from their mean, per its size, count as equal [1]. A rock that
  /// rocks at the rate a over two contacts at the distance d then lacks the spin by which it follows
  /// their slope, at most 2 level a z / d: some 1e-6 m/s, as much as 150 sweeps stop short of on a level
  /// base (docs/validation/engines.md). Contacts of a level base differ by how far they have sunk in: of
  /// 66,000 steps of a block and a scanned rock that stand, rock and land, 20 differ by more, and 145 by
  /// more than 1e-5. Such a step is swept.
  double level = 1e-4;
  /// Sets of closed contacts that are reached by changing the contact that is most wrong. Of 66,000 steps
  /// of a block and a scanned rock that stand, rock and land five were enough, or the sets recurred, in
  /// 1 of 50.
  std::int64_t greedy_sets = 5;
};
inline constexpr StickingConstants kSticking;

/// Where the contact geometry of `fast` holds, beyond which Bullet takes over: fast_stepper.cpp.
///
/// Bullet's normal is the direction of least depth: vertical in a thick top, away from its edge. The
/// bounds are chosen by hand, well inside of where that ends.
struct TopConstants {
  double deepest_of_rock = 0.1;  ///< depth over half the size of the rock [1]
  double deepest_of_top = 0.2;   ///< depth over the least half edge of the top's box [1]
  /// Distance from the top's edge: over half the rock's size, over the collision margin, and over the depth,
  /// of which once would do [1].
  double guard_of_rock = 0.01;
  double guard_of_margin = 2.0;
  double guard_of_depth = 2.0;
};
inline constexpr TopConstants kTop;

// The constants of mechanisms, rock_mechanics.cpp, are chosen by hand, for rocks of a decimetre to some
// metres; what each decides stands in docs/explanation/mechanisms.md, and tests/cpp/test_mechanisms.cpp
// holds the mechanisms to closed forms with them.

/// Rolling resistance.
struct RollingConstants {
  double fading_rate = 0.01;  ///< it fades in over this rate [rad/s]
};
inline constexpr RollingConstants kRolling;

/// The bond between rock and pedestal.
struct BondConstants {
  double rest = 0.1;              ///< it forms after a rest of this length [s]
  double rest_speed = 0.01;       ///< at less than this speed [m/s]
  double rest_rate = 0.02;        ///< and less than this one [rad/s]
  double footprint_depth = 1e-3;  ///< over the vertices within this height of the lowest [m]
  double opening = 1e-4;          ///< and breaks when it has opened by this much [m]
};
inline constexpr BondConstants kBond;

/// The tether that catches a falling rock.
struct TetherConstants {
  double stiffness = 800.0;  ///< over m g h: a fall through h stretches it by 0.05 rad [1]
  double damping = 0.5;      ///< of the critical [1]
  double step = 0.04;        ///< greatest (natural frequency x time step)^2 [1]
};
inline constexpr TetherConstants kTether;

/// Impacts whose energy is set.
struct ImpactConstants {
  /// An impact begins with a blow at this speed [m/s] on a point that has borne nothing for `forget` [s],
  /// goes on while there are blows at `after_blow` [m/s], is over when none came for `quiet` [s], and is
  /// given up after `longest` [s]. A rock that comes back to its other edge within `forget` left at a
  /// speed near `blow`; the two ends of one edge may strike in turn for about as long.
  double blow = 0.04;
  double after_blow = 0.01;
  double quiet = 0.004;
  double longest = 0.03;
  double forget = 0.05;
  double full_loss = 0.02;  ///< share of energy that an impact takes from which on the ratio applies in full [1]
  double opens = 0.5;       ///< points that open at more than this share of the first blow's speed bear nothing [1]
  /// A motion is a rotation about a support if this share of its energy, at most, is not that of one [1].
  double other_motion = 0.1;
  double greatest_gain = 1.5;  ///< of energy, at most [1]
  /// Points of support nearer than this to one another, and to a line, are one and on it [m].
  double same_point = 2e-3;
};
inline constexpr ImpactConstants kImpact;

using Constant = std::variant<double, std::int64_t>;
/// All of the above, by what they are of and by name.
std::map<std::string, std::map<std::string, Constant>> core_constants();

}  // namespace vsr2
