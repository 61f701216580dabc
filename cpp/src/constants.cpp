#include "vsr2/constants.hpp"

#include <cstddef>

namespace vsr2 {
namespace {

using Named = std::map<std::string, Constant>;

template <typename T>
struct Field {
  const char* name;
  std::variant<double T::*, std::int64_t T::*> member;
};

template <typename T, std::size_t n>
Named named(const T& constants, const Field<T> (&fields)[n]) {
  static_assert(sizeof(T) == n * sizeof(double) && sizeof(double) == sizeof(std::int64_t),
                "a constant has no name here, or is of a type that Constant has not");
  Named out;
  for (const Field<T>& field : fields)
    std::visit([&](auto member) { out[field.name] = constants.*member; }, field.member);
  return out;
}

}  // namespace

std::map<std::string, Named> core_constants() {
  using Quiet = QuietStretchConstants;
  return {
      {"rest", named(kRest, {{"standing_speed", &RestConstants::standing_speed},
                             {"standing_rate", &RestConstants::standing_rate},
                             {"leaning_windows", &RestConstants::leaning_windows},
                             {"creep_allowance", &RestConstants::creep_allowance}})},
      {"quiet_stretch", named(kQuietStretch, {{"still_speed", &Quiet::still_speed},
                                              {"still_rate", &Quiet::still_rate},
                                              {"still_window", &Quiet::still_window},
                                              {"faded", &Quiet::faded},
                                              {"safety", &Quiet::safety}})},
      {"sweep", named(kSweep, {{"greatest_turn", &SweepConstants::greatest_turn},
                               {"greatest_turn_before", &SweepConstants::greatest_turn_before}})},
      {"sticking", named(kSticking, {{"level", &StickingConstants::level},
                                     {"greedy_sets", &StickingConstants::greedy_sets}})},
      {"top", named(kTop, {{"deepest_of_rock", &TopConstants::deepest_of_rock},
                           {"deepest_of_top", &TopConstants::deepest_of_top},
                           {"guard_of_rock", &TopConstants::guard_of_rock},
                           {"guard_of_margin", &TopConstants::guard_of_margin},
                           {"guard_of_depth", &TopConstants::guard_of_depth}})},
      {"rolling", named(kRolling, {{"fading_rate", &RollingConstants::fading_rate}})},
      {"bond", named(kBond, {{"rest", &BondConstants::rest},
                             {"rest_speed", &BondConstants::rest_speed},
                             {"rest_rate", &BondConstants::rest_rate},
                             {"footprint_depth", &BondConstants::footprint_depth},
                             {"opening", &BondConstants::opening}})},
      {"tether", named(kTether, {{"stiffness", &TetherConstants::stiffness},
                                 {"damping", &TetherConstants::damping},
                                 {"step", &TetherConstants::step}})},
      {"impact", named(kImpact, {{"blow", &ImpactConstants::blow},
                                 {"after_blow", &ImpactConstants::after_blow},
                                 {"quiet", &ImpactConstants::quiet},
                                 {"longest", &ImpactConstants::longest},
                                 {"forget", &ImpactConstants::forget},
                                 {"full_loss", &ImpactConstants::full_loss},
                                 {"opens", &ImpactConstants::opens},
                                 {"other_motion", &ImpactConstants::other_motion},
                                 {"greatest_gain", &ImpactConstants::greatest_gain},
                                 {"same_point", &ImpactConstants::same_point}})},
  };
}

}  // namespace vsr2
