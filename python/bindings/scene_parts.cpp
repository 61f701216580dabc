// What a scene is made of: contact values, engine, bodies, mechanisms; conversions only.

#include <algorithm>
#include <array>
#include <string>
#include <vector>

#include "bindings.hpp"
#include "vsr2/engines.hpp"

namespace vsr2::binding {
namespace {

/// Rows of three numbers of an argument.
template <typename Scalar>
std::vector<std::array<Scalar, 3>> rows3(const py::array& array) {
  const py::array_t<Scalar, py::array::c_style | py::array::forcecast> values(array);
  std::vector<std::array<Scalar, 3>> out(static_cast<std::size_t>(values.shape(0)));
  std::copy_n(values.data(), 3 * out.size(), out.empty() ? nullptr : out.front().data());
  return out;
}

/// Points [m]: float64 alone, since other types of numbers may lose digits.
std::vector<Eigen::Vector3d> points(const Given<py::array>& given, const char* name) {
  std::vector<Eigen::Vector3d> out;
  for (const auto& row : rows3<double>(taken_array(given.object, name, Elements::float64, {kAny, 3})))
    out.emplace_back(row.data());
  return out;
}

/// Indices of vertices, of whatever integer type.
std::vector<std::array<std::int64_t, 3>> indices(const Given<py::array>& given, const char* name) {
  const py::array array = taken_array(given.object, name, Elements::integers, {kAny, 3});
  auto out = rows3<std::int64_t>(array);
  if (array.dtype().kind() != 'u') return out;
  for (const auto& face : out)
    if (*std::min_element(face.begin(), face.end()) < 0)
      throw InvalidInput(std::string(name) + " must be below 2^63");
  return out;
}

template <std::size_t... kIndex>
void bind_contact_values(py::module_& m, std::index_sequence<kIndex...>) {
  py::class_<ContactValues> type = bind_record<ContactValues>(
      m, "ContactValues",
      Field{kContactParameters[kIndex].name,
            [](ContactValues& values) -> double& { return values.all[kIndex]; }}...);
  for (std::size_t i = 0; i < kContactParameters.size(); ++i)
    type.def_property_readonly(
        kContactParameters[i].name, [i](const ContactValues& values) { return values.all[i]; },
        kContactParameters[i].unit);
  m.def("combine", &combine, py::kw_only(), py::arg("a"), py::arg("b"));

  using P = ContactParameter;
  py::class_<P>(m, "ContactParameter", "What a contact parameter may be, and is where nothing is given.")
      .def_readonly("name", &P::name)
      .def_readonly("unit", &P::unit, "Empty: none.")
      .def_property_readonly("least", [](const P& p) { return p.range.least; })
      .def_property_readonly("greatest", [](const P& p) { return p.range.greatest; })
      .def_property_readonly("above", [](const P& p) { return p.range.above; }, "Whether the least is left out.")
      .def_readonly("original", &P::original, "Value of the original system.")
      .def_readonly("usual", &P::usual, "Value of a study that gives none.")
      .def_readonly("fast", &P::fast, "Whether the engine `fast` has it; without, it takes 0 alone.");
  m.def("contact_parameters", [] {
    return std::vector<ContactParameter>(kContactParameters.begin(), kContactParameters.end());
  });
}

void bind_engine(py::module_& m) {
  bind_enum<EngineKind>(m,
                        {{"auto", EngineKind::automatic},
                         {"parity", EngineKind::parity},
                         {"exact", EngineKind::exact},
                         {"fast", EngineKind::fast}});
  // For settings in which an engine is a word.
  const py::object literal = py::module_::import("typing").attr("Literal");
  m.attr("EngineMode") = py::object(literal[names_of(m, "EngineKind")]);
  bind_enum<Handover>(m,
                      {{"none", Handover::none},
                       {"off_the_top", Handover::off_the_top},
                       {"motor_on_a_slope", Handover::motor_on_a_slope},
                       {"too_deep", Handover::too_deep}});
  bind_enum<FastRefusal>(m,
                         {{"none", FastRefusal::none},
                          {"several_parts", FastRefusal::several_parts},
                          {"pedestal_not_a_box", FastRefusal::pedestal_not_a_box},
                          {"no_friction_cone", FastRefusal::no_friction_cone},
                          {"contact_parameter", FastRefusal::contact_parameter},
                          {"no_margin", FastRefusal::no_margin}});
  using E = EngineSettings;
  bind_record<E>(m, "EngineSettings", Field{"kind", &E::kind}, Field{"gravity", &E::gravity},
                 Field{"time_step", &E::time_step}, Field{"substeps", &E::substeps},
                 Field{"solver_iterations", &E::solver_iterations},
                 Field{"residual_threshold", &E::residual_threshold},
                 Field{"converged_contacts", &E::converged_contacts},
                 Field{"skip_quiet", &E::skip_quiet},
                 Field{"restitution_velocity_threshold", &E::restitution_velocity_threshold},
                 Field{"cone_friction", &E::cone_friction},
                 Field{"deterministic_overlapping_pairs", &E::deterministic_overlapping_pairs},
                 Field{"collision_margin", &E::collision_margin},
                 Field{"contact_breaking_threshold", &E::contact_breaking_threshold},
                 Field{"linear_damping", &E::linear_damping},
                 Field{"angular_damping", &E::angular_damping});
}

void bind_parts(py::module_& m) {
  py::class_<HullPart>(m, "HullPart")
      .def(py::init([](const Given<py::array>& given) { return HullPart(points(given, "points")); }),
           py::kw_only(), py::arg("points"));
  bind_record<BoxPart>(
      m, "BoxPart", Field{"size", &BoxPart::size},
      Field{"position", [](BoxPart& b) -> Eigen::Vector3d& { return b.pose.position; }},
      Field{"orientation", [](BoxPart& b) -> Vector4& { return b.pose.orientation.coeffs(); }});
  py::class_<TrianglesPart>(m, "TrianglesPart")
      .def(py::init([](const Given<py::array>& vertices, const Given<py::array>& faces) {
             return TrianglesPart{points(vertices, "vertices"), indices(faces, "faces")};
           }),
           py::kw_only(), py::arg("vertices"), py::arg("faces"));
}

void bind_bodies(py::module_& m) {
  bind_record<PitchSpring>(m, "PitchSpring", Field{"frequency", &PitchSpring::frequency},
                           Field{"damping", &PitchSpring::damping},
                           Field{"compliance", &PitchSpring::compliance},
                           Field{"inertia", &PitchSpring::inertia});
  using P = PedestalSpec;
  bind_record<P>(m, "PedestalSpec", Field{"parts", &P::parts}, Field{"origin", &P::p_WP0},
                 Field{"mass", &P::mass}, Field{"base_size", &P::base_size},
                 Field{"top", &P::top}, Field{"material", &P::material},
                 Field{"pitch_pivot", &P::pitch_pivot},
                 Field{"pitch_spring", &P::pitch_spring});
  using R = RockSpec;
  bind_record<R>(m, "RockSpec", Field{"parts", &R::parts}, Field{"mass", &R::mass},
                 Field{"principal_inertia", &R::principal_inertia},
                 Field{"inertia_from_aabb", &R::inertia_from_aabb},
                 Field{"mass_center", [](R& r) -> Eigen::Vector3d& { return r.X_MB.position; }},
                 Field{"principal_axes", [](R& r) -> Vector4& { return r.X_MB.orientation.coeffs(); }},
                 Field{"material", &R::material});
}

void bind_mechanisms(py::module_& m) {
  bind_record<Mechanisms>(m, "Mechanisms",
                          Field{"impact_energy_ratio", &Mechanisms::impact_energy_ratio},
                          Field{"rocking_damping", &Mechanisms::rocking_damping},
                          Field{"rolling_resistance", &Mechanisms::rolling_resistance},
                          Field{"friction_ratio", &Mechanisms::friction_ratio},
                          Field{"friction_speed", &Mechanisms::friction_speed},
                          Field{"adhesion", &Mechanisms::adhesion},
                          Field{"catch_slack", &Mechanisms::catch_slack});
}

}  // namespace

void bind_scene(py::module_& m) {
  bind_contact_values(m, std::make_index_sequence<kContactParameters.size()>{});
  bind_engine(m);
  bind_parts(m);
  bind_bodies(m);
  bind_mechanisms(m);
  py::class_<Scene, std::shared_ptr<Scene>>(m, "Scene")
      .def(py::init<EngineSettings, PedestalSpec, RockSpec, Mechanisms>(), py::kw_only(),
           py::arg("engine"), py::arg("pedestal"), py::arg("rock"), py::arg("mechanisms"))
      .def_property_readonly("rock_inertia", &Scene::rock_inertia)
      .def_property_readonly("engine", &choose_engine, "Engine the scene gets.")
      .def_property_readonly("fast_refusal", &fast_refusal,
                             "Why the engine `fast` does not take the scene.")
      .def_property_readonly("rock_hull_vertices", [](const Scene& scene) {
        const auto vertices = scene.rock_hull_vertices();
        py::array_t<double> out({static_cast<py::ssize_t>(vertices.size()), py::ssize_t{3}});
        for (std::size_t i = 0; i < vertices.size(); ++i)
          Eigen::Map<Eigen::Vector3d>(out.mutable_data() + 3 * i) = vertices[i];
        return out;
      });
}

}  // namespace vsr2::binding
