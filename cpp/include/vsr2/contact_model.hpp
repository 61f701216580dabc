#pragma once
// The contact parameters: of a body, and of a pair of bodies in contact (supplement S2.1). The table
// below is all that the core knows of them but for what they do in each engine.

#include <array>
#include <cstddef>
#include <limits>
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

/// The values that a body may have.
struct Range {
  double least;
  double greatest = std::numeric_limits<double>::infinity();
  bool above = false;  ///< the least is left out
};
inline constexpr Range kNotNegative{0.0};
inline constexpr Range kPositive{.least = 0.0, .above = true};
inline constexpr Range kFraction{0.0, 1.0};

struct ContactParameter {
  const char* name;
  const char* unit;  ///< empty: none
  Range range;
  double original;  ///< value of the original system (Table S1)
  double usual;     ///< value of a study that gives none
  PairRule pair;
  bool fast = true;  ///< whether the engine `fast` has it; without, it takes 0 alone
};

/// Names, units, ranges and defaults are those of a study, too (`Material` in config/study.py), which
/// tells what each means. Stiffness and damping are per contact point.
inline constexpr std::array kContactParameters{
    ContactParameter{"restitution", "", kFraction, 0.35, 0.35, PairRule::product},
    ContactParameter{"lateral_friction", "", kNotNegative, 0.7, 0.7, PairRule::friction},
    ContactParameter{"spinning_friction", "m", kNotNegative, 0.5, 0.0, PairRule::lever},
    ContactParameter{"rolling_friction", "m", kNotNegative, 0.0, 0.0, PairRule::lever, false},
    ContactParameter{"stiffness", "N/m", kPositive, 2.6e9, 2.6e9, PairRule::series},
    ContactParameter{"damping", "N s/m", kNotNegative, 1.0e7, 1.0e7, PairRule::sum},
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
