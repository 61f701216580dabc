#pragma once
// The contact parameters: of a body, and of a pair of bodies in contact (supplement S2.1). The table
// below is all that the core knows of them but for what they do in each engine.

#include <array>
#include <cstddef>
#include <string_view>

namespace vsr2 {

/// How two bodies' values a and b make the pair's. `bounded` is Bullet's, to +-10.
enum class PairRule {
  product,   ///< a b (Eq. 1)
  friction,  ///< bounded(a b) (Eq. 1)
  lever,     ///< bounded(a mu^b + b mu^a) (Eq. 1), mu the lateral friction
  series,    ///< 1 / (1 / a + 1 / b)
  sum,       ///< a + b
};

enum class Range { non_negative, positive };

struct ContactParameter {
  const char* name;
  const char* unit;  ///< empty: none
  double original;   ///< value of the original system (Table S1); a study has its own default
  Range range;
  PairRule pair;
};

/// A study's keys of the same names (`Material` in config/study.py) tell what each means. Stiffness and
/// damping are per contact point.
inline constexpr std::array kContactParameters{
    ContactParameter{"restitution", "", 0.35, Range::non_negative, PairRule::product},
    ContactParameter{"lateral_friction", "", 0.7, Range::non_negative, PairRule::friction},
    ContactParameter{"spinning_friction", "m", 0.5, Range::non_negative, PairRule::lever},
    ContactParameter{"rolling_friction", "m", 0.0, Range::non_negative, PairRule::lever},
    ContactParameter{"stiffness", "N/m", 2.6e9, Range::positive, PairRule::series},
    ContactParameter{"damping", "N s/m", 1.0e7, Range::non_negative, PairRule::sum},
};

/// Where a parameter stands in the table. A name that is not there does not compile.
struct ContactKey {
  std::size_t index = 0;
  consteval ContactKey(const char* name) {
    while (std::string_view(kContactParameters.at(index).name) != name) ++index;
  }
};

/// A value of each parameter: a body's, or those in force between a pair.
struct ContactValues {
  std::array<double, kContactParameters.size()> all = original();

  double& operator[](ContactKey key) { return all[key.index]; }
  double operator[](ContactKey key) const { return all[key.index]; }

 private:
  static constexpr std::array<double, kContactParameters.size()> original() {
    std::array<double, kContactParameters.size()> out{};
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = kContactParameters[i].original;
    return out;
  }
};

/// The values in force between two bodies.
ContactValues combine(const ContactValues& a, const ContactValues& b);

}  // namespace vsr2
