// The Python module vsr2._native: conversions only. Python validates and allocates; the GIL is
// released while trials run.

#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "vsr2/batch.hpp"
#include "vsr2/build_facts.hpp"
#include "vsr2/contact_model.hpp"
#include "vsr2/engines.hpp"

namespace py = pybind11;
using namespace vsr2;

namespace {

using Rows3 = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Faces = py::array_t<std::int32_t, py::array::c_style | py::array::forcecast>;
using Vector4 = Eigen::Vector4d;

/// A motion's samples, converted once and shared by all trials that use them.
struct Samples {
  std::shared_ptr<const std::vector<double>> values;
};

std::vector<Eigen::Vector3d> rows3(const Rows3& array, const char* what) {
  if (array.ndim() != 2 || array.shape(1) != 3)
    throw InvalidInput(std::string(what) + " must have shape (n, 3)");
  std::vector<Eigen::Vector3d> out(static_cast<std::size_t>(array.shape(0)));
  const double* data = array.data();
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = {data[3 * i], data[3 * i + 1], data[3 * i + 2]};
  return out;
}

Pose make_pose(const Eigen::Vector3d& position, const Vector4& xyzw) {
  return {position, Eigen::Quaterniond(xyzw[3], xyzw[0], xyzw[1], xyzw[2])};
}

Vector4 xyzw(const Eigen::Quaterniond& q) { return {q.x(), q.y(), q.z(), q.w()}; }

// Hands a vector to numpy without a copy.
py::array_t<double> adopt(std::vector<double>&& values, py::ssize_t columns) {
  auto owner = std::make_unique<std::vector<double>>(std::move(values));
  const auto rows = static_cast<py::ssize_t>(owner->size()) / columns;
  double* data = owner->data();
  py::capsule guard(owner.release(), [](void* p) { delete static_cast<std::vector<double>*>(p); });
  return py::array_t<double>({rows, columns}, data, guard);
}

py::dict contact_dict(const ContactPoint& c) {
  py::dict out;
  out["p_W_rock"] = c.p_W_rock;
  out["p_W_pedestal"] = c.p_W_pedestal;
  out["normal_W"] = c.normal_W;
  out["distance"] = c.distance;
  out["normal_impulse"] = c.normal_impulse;
  out["lateral_impulse"] = Eigen::Vector2d(c.lateral_impulse_1, c.lateral_impulse_2);
  out["lateral_direction_1"] = c.direction_1;
  out["lateral_direction_2"] = c.direction_2;
  out["lateral_friction"] = c.lateral_friction;
  out["restitution"] = c.restitution;
  out["spinning_friction"] = c.spinning_friction;
  out["stiffness"] = c.stiffness;
  out["damping"] = c.damping;
  return out;
}

void bind_scene(py::module_& m) {
  py::class_<Material>(m, "Material")
      .def(py::init([](double restitution, double lateral_friction, double spinning_friction,
                       double rolling_friction, double stiffness, double damping) {
             return Material{restitution, lateral_friction, spinning_friction, rolling_friction,
                             stiffness, damping};
           }),
           py::kw_only(), py::arg("restitution"), py::arg("lateral_friction"),
           py::arg("spinning_friction"), py::arg("rolling_friction"), py::arg("stiffness"),
           py::arg("damping"));

  py::enum_<EngineKind>(m, "EngineKind")
      .value("auto", EngineKind::automatic)
      .value("parity", EngineKind::parity)
      .value("exact", EngineKind::exact)
      .value("fast", EngineKind::fast);

  py::class_<EngineSettings>(m, "EngineSettings")
      .def(py::init([](EngineKind kind, double gravity, double time_step, int substeps, int solver_iterations,
                       double residual_threshold, double restitution_velocity_threshold,
                       bool cone_friction, bool deterministic_overlapping_pairs,
                       double collision_margin, double contact_breaking_threshold,
                       double linear_damping, double angular_damping) {
             return EngineSettings{kind, gravity, time_step, substeps, solver_iterations,
                                   residual_threshold, restitution_velocity_threshold,
                                   cone_friction, deterministic_overlapping_pairs,
                                   collision_margin, contact_breaking_threshold, linear_damping,
                                   angular_damping};
           }),
           py::kw_only(), py::arg("kind"), py::arg("gravity"), py::arg("time_step"), py::arg("substeps"),
           py::arg("solver_iterations"), py::arg("residual_threshold"),
           py::arg("restitution_velocity_threshold"), py::arg("cone_friction"),
           py::arg("deterministic_overlapping_pairs"), py::arg("collision_margin"),
           py::arg("contact_breaking_threshold"), py::arg("linear_damping"),
           py::arg("angular_damping"));

  py::class_<HullPart>(m, "HullPart")
      .def(py::init([](const Rows3& points) { return HullPart{rows3(points, "hull points")}; }),
           py::arg("points"));
  py::class_<BoxPart>(m, "BoxPart")
      .def(py::init([](const Eigen::Vector3d& size, const Eigen::Vector3d& position,
                       const Vector4& orientation) {
             return BoxPart{size, make_pose(position, orientation)};
           }),
           py::arg("size"), py::arg("position"), py::arg("orientation"));
  py::class_<TrianglesPart>(m, "TrianglesPart")
      .def(py::init([](const Rows3& vertices, const Faces& faces) {
             if (faces.ndim() != 2 || faces.shape(1) != 3)
               throw InvalidInput("triangles must have shape (m, 3)");
             TrianglesPart part{rows3(vertices, "vertices"), {}};
             part.faces.resize(static_cast<std::size_t>(faces.shape(0)));
             for (std::size_t i = 0; i < part.faces.size(); ++i)
               for (std::size_t k = 0; k < 3; ++k) part.faces[i][k] = faces.data()[3 * i + k];
             return part;
           }),
           py::arg("vertices"), py::arg("faces"));

  py::class_<PitchSpring>(m, "PitchSpring")
      .def(py::init([](double frequency, double damping, double compliance, double inertia) {
             return PitchSpring{frequency, damping, compliance, inertia};
           }),
           py::kw_only(), py::arg("frequency"), py::arg("damping"), py::arg("compliance"),
           py::arg("inertia"));
  py::class_<PedestalSpec>(m, "PedestalSpec")
      .def(py::init([](std::vector<Part> parts, const Eigen::Vector3d& origin, double mass,
                       const Eigen::Vector3d& base_size, double top, const Material& material,
                       double pitch_pivot, const std::optional<PitchSpring>& pitch_spring) {
             return PedestalSpec{std::move(parts), origin, mass, base_size, top, material,
                                 pitch_pivot, pitch_spring};
           }),
           py::kw_only(), py::arg("parts"), py::arg("origin"), py::arg("mass"),
           py::arg("base_size"), py::arg("top"), py::arg("material"), py::arg("pitch_pivot"),
           py::arg("pitch_spring") = std::nullopt);
  py::class_<RockSpec>(m, "RockSpec")
      .def(py::init([](std::vector<Part> parts, double mass, const Eigen::Vector3d& inertia,
                       bool inertia_from_aabb, const Eigen::Vector3d& mass_center,
                       const Vector4& principal_axes, const Material& material) {
             return RockSpec{std::move(parts), mass, inertia, inertia_from_aabb,
                             make_pose(mass_center, principal_axes), material};
           }),
           py::kw_only(), py::arg("parts"), py::arg("mass"), py::arg("principal_inertia"),
           py::arg("inertia_from_aabb"), py::arg("mass_center"), py::arg("principal_axes"),
           py::arg("material"));

  py::class_<Mechanisms>(m, "Mechanisms")
      .def(py::init([](double impact_energy_ratio, double rocking_damping,
                       double rolling_resistance, double friction_ratio, double friction_speed,
                       double adhesion, double catch_slack) {
             return Mechanisms{impact_energy_ratio, rocking_damping, rolling_resistance,
                               friction_ratio, friction_speed, adhesion, catch_slack};
           }),
           py::kw_only(), py::arg("impact_energy_ratio"), py::arg("rocking_damping"),
           py::arg("rolling_resistance"), py::arg("friction_ratio"), py::arg("friction_speed"),
           py::arg("adhesion"), py::arg("catch_slack"));

  py::class_<Scene, std::shared_ptr<Scene>>(m, "Scene")
      .def(py::init<EngineSettings, PedestalSpec, RockSpec, Mechanisms>(), py::kw_only(),
           py::arg("engine"), py::arg("pedestal"), py::arg("rock"), py::arg("mechanisms"))
      .def_property_readonly("rock_inertia", &Scene::rock_inertia)
      .def_property_readonly(
          "engine", [](const Scene& scene) { return to_string(choose_engine(scene)); },
          "Engine the scene gets.")
      .def_property_readonly(
          "fast_domain_violation",
          [](const Scene& scene) { return fast_domain_violation(scene); },
          "Why the engine `fast` does not take the scene; empty if it does.")
      .def_property_readonly("rock_hull_vertices", [](const Scene& scene) {
        const auto vertices = scene.rock_hull_vertices();
        py::array_t<double> out({static_cast<py::ssize_t>(vertices.size()), py::ssize_t{3}});
        for (std::size_t i = 0; i < vertices.size(); ++i)
          Eigen::Map<Eigen::Vector3d>(out.mutable_data() + 3 * i) = vertices[i];
        return out;
      });
}

void bind_world(py::module_& m) {
  py::enum_<Drive>(m, "Drive")
      .value("prescribed", Drive::prescribed)
      .value("prescribed_spatial", Drive::prescribed_spatial)
      .value("motor_position", Drive::motor_position)
      .value("motor_position_velocity", Drive::motor_position_velocity);

  // The world behind vsr2.Simulation.
  py::class_<World>(m, "World")
      .def(py::init([](std::shared_ptr<Scene> scene, Drive drive) {
             return make_world(std::move(scene), drive);
           }),
           py::arg("scene"), py::arg("drive"))
      .def("spawn_rock",
           [](World& world, const Eigen::Vector3d& position, const Vector4& orientation) {
             world.spawn_rock(make_pose(position, orientation));
           },
           py::arg("position"), py::arg("orientation"))
      .def("delete_rock", &World::delete_rock)
      .def_property_readonly("has_rock", &World::has_rock)
      .def(
          "engine",
          [](const World& world, const Scene& scene) {
            return engine_in_use(world, choose_engine(scene));
          },
          py::arg("scene"))
      .def("set_rock_velocity", &World::set_rock_velocity, py::arg("linear"), py::arg("angular"))
      .def("step",
           [](World& world, double position, double velocity, double transverse, double vertical,
              double pitch) {
             world.step({position, velocity, {transverse, vertical, pitch}});
           },
           py::arg("position"), py::arg("velocity"), py::arg("transverse") = 0.0,
           py::arg("vertical") = 0.0, py::arg("pitch") = 0.0)
      .def_property_readonly("pedestal",
                             [](const World& world) {
                               const PedestalState s = world.pedestal();
                               return std::make_pair(s.position, s.velocity);
                             })
      .def_property_readonly("excursion",
                             [](const World& world) {
                               const Excursion x = world.pedestal().excursion;
                               return std::make_tuple(x.transverse, x.vertical, x.pitch);
                             },
                             "Transverse and vertical displacement [m], pitch [rad].")
      .def_property_readonly("rock",
                             [](const World& world) {
                               const RockState s = world.rock();
                               return std::make_tuple(s.p_WB, xyzw(s.q_WB), s.v_WB, s.w_WB);
                             })
      .def("contacts", [](const World& world) {
        std::vector<ContactPoint> points;
        world.contacts(points);
        py::list out;
        for (const ContactPoint& point : points) out.append(contact_dict(point));
        return out;
      });
}

void bind_trial(py::module_& m) {
  py::enum_<Status>(m, "Status")
      .value("ok", Status::ok)
      .value("settling_timeout", Status::settling_timeout)
      .value("tail_timeout", Status::tail_timeout)
      .value("diverged", Status::diverged)
      .value("error", Status::error)
      .value("cancelled", Status::cancelled)
      .value("not_run", Status::not_run);
  py::enum_<Outcome>(m, "Outcome")
      .value("stable", Outcome::stable)
      .value("rocked", Outcome::rocked)
      .value("slid", Outcome::slid)
      .value("rotated", Outcome::rotated)
      .value("overturned", Outcome::overturned)
      .value("failed", Outcome::failed);

  py::class_<Samples>(m, "Samples")
      .def(py::init([](py::array_t<double, py::array::c_style | py::array::forcecast> array) {
             if (array.ndim() != 1) throw InvalidInput("samples must have shape (n,)");
             return Samples{std::make_shared<const std::vector<double>>(
                 array.data(), array.data() + array.size())};
           }),
           py::arg("values"));

  py::class_<SettledStart, std::shared_ptr<SettledStart>>(m, "SettledStart")
      .def(py::init([](std::shared_ptr<Scene> scene, Drive drive, const Eigen::Vector3d& position,
                       const Vector4& orientation, double linear_speed, double angular_speed,
                       double window, double timeout, std::int64_t log_every) {
             return std::make_shared<SettledStart>(
                 std::move(scene), drive, make_pose(position, orientation),
                 RestCriterion{linear_speed, angular_speed, window}, timeout, log_every);
           }),
           py::kw_only(), py::arg("scene"), py::arg("drive"), py::arg("position"),
           py::arg("orientation"), py::arg("linear_speed"), py::arg("angular_speed"),
           py::arg("window"), py::arg("timeout"), py::arg("log_every"));

  py::class_<TrialSpec>(m, "TrialSpec")
      .def(py::init([](std::shared_ptr<SettledStart> start, const Samples& motion_position,
                       const std::optional<Samples>& motion_velocity,
                       const std::optional<Samples>& transverse,
                       const std::optional<Samples>& vertical,
                       const std::optional<Samples>& pitch, double tail,
                       double rest_linear_speed, double rest_angular_speed, double rest_window,
                       double overturned_tilt, double toppled_tilt, double rocked_tilt,
                       double slid_distance, double rotated_angle, bool stop_early,
                       std::int64_t log_every, std::int64_t contacts_every) {
             TrialSpec spec;
             spec.start = std::move(start);
             spec.position = motion_position.values;
             if (motion_velocity) spec.velocity = motion_velocity->values;
             if (transverse) spec.transverse = transverse->values;
             if (vertical) spec.vertical = vertical->values;
             if (pitch) spec.pitch = pitch->values;
             spec.tail = tail;
             spec.tail_rest = {rest_linear_speed, rest_angular_speed, rest_window};
             spec.outcome = {overturned_tilt, toppled_tilt, rocked_tilt, slid_distance,
                             rotated_angle};
             spec.stop_early = stop_early;
             spec.log_every = log_every;
             spec.contacts_every = contacts_every;
             return spec;
           }),
           py::kw_only(), py::arg("start"), py::arg("motion_position"), py::arg("motion_velocity"),
           py::arg("transverse"), py::arg("vertical"), py::arg("pitch"), py::arg("tail"), py::arg("rest_linear_speed"), py::arg("rest_angular_speed"),
           py::arg("rest_window"), py::arg("overturned_tilt"), py::arg("toppled_tilt"),
           py::arg("rocked_tilt"), py::arg("slid_distance"), py::arg("rotated_angle"),
           py::arg("stop_early"), py::arg("log_every"), py::arg("contacts_every"));

  py::class_<TrialResult>(m, "TrialResult")
      .def_readonly("status", &TrialResult::status)
      .def_readonly("outcome", &TrialResult::outcome)
      .def_readonly("message", &TrialResult::message)
      .def_readonly("engine", &TrialResult::engine)
      .def_readonly("settling_time", &TrialResult::settling_time)
      .def_readonly("simulated_time", &TrialResult::simulated_time)
      .def_readonly("overturning_time", &TrialResult::overturning_time)
      .def_readonly("peak_tilt", &TrialResult::peak_tilt)
      .def_readonly("final_tilt", &TrialResult::final_tilt)
      .def_readonly("final_slip", &TrialResult::final_slip)
      .def_readonly("final_yaw", &TrialResult::final_yaw)
      .def_readonly("peak_tracking_error", &TrialResult::peak_tracking_error)
      .def_readonly("steps", &TrialResult::steps)
      .def_property_readonly("settled_position",
                             [](const TrialResult& r) { return r.X_WB_settled.position; })
      .def_property_readonly("settled_orientation",
                             [](const TrialResult& r) { return xyzw(r.X_WB_settled.orientation); })
      .def_readonly("foot", &TrialResult::p_B_foot)
      .def("take_log", [](TrialResult& r) { return adopt(std::move(r.log), kLogColumns); },
           "State log, shape (n, 18); may be taken once.")
      .def("take_excursions",
           [](TrialResult& r) { return adopt(std::move(r.excursions), kExcursionColumns); },
           "Transverse, vertical and pitch of the pedestal, one row a row of the state log, or none "
           "where it moved along x; may be taken once.")
      .def("take_contacts",
           [](TrialResult& r) { return adopt(std::move(r.contacts), kContactColumns); },
           "Contact log, shape (n, 20); may be taken once.");

  py::class_<Batch>(m, "Batch")
      .def(py::init<int>(), py::arg("threads"))
      .def("add", &Batch::add, py::arg("trial"))
      .def("close", &Batch::close)
      // Python signals are handled between the short waits, so Ctrl-C is noticed at once.
      .def("wait", &Batch::wait, py::arg("timeout"), py::call_guard<py::gil_scoped_release>())
      .def("exhausted", &Batch::exhausted, py::call_guard<py::gil_scoped_release>())
      .def("cancel", &Batch::cancel)
      .def("join", &Batch::join, py::call_guard<py::gil_scoped_release>())
      .def("take", &Batch::take, py::arg("index"));
}

void bind_contact_model(py::module_& m) {
  py::class_<ContactPair>(m, "ContactPair")
      .def_readonly("lateral_friction", &ContactPair::lateral_friction)
      .def_readonly("restitution", &ContactPair::restitution)
      .def_readonly("spinning_friction", &ContactPair::spinning_friction)
      .def_readonly("damping", &ContactPair::damping)
      .def_readonly("stiffness", &ContactPair::stiffness);
  m.def("combine", &combine, py::arg("a"), py::arg("b"));
  m.def("contact_softness",
        [](double stiffness, double damping, double time_step) {
          const ContactSoftness s = contact_softness(stiffness, damping, time_step);
          return std::make_pair(s.cfm, s.erp);
        },
        py::arg("stiffness"), py::arg("damping"), py::arg("time_step"));
  m.def("restitution_target", &restitution_target, py::arg("restitution"),
        py::arg("normal_velocity"), py::arg("velocity_threshold"));
  m.def("inverse_mass_along", &inverse_mass_along, py::arg("normal"), py::arg("inverse_mass_a"),
        py::arg("inverse_inertia_a"), py::arg("r_a"), py::arg("inverse_mass_b"),
        py::arg("inverse_inertia_b"), py::arg("r_b"));
  m.def("normal_impulse",
        [](double rebound_target, double normal_velocity, double penetration, double cfm,
           double erp, double time_step, double inverse_mass) {
          return normal_impulse(rebound_target, normal_velocity, penetration, {cfm, erp},
                                time_step, inverse_mass);
        },
        py::arg("rebound_target"), py::arg("normal_velocity"), py::arg("penetration"),
        py::arg("cfm"), py::arg("erp"), py::arg("time_step"), py::arg("inverse_mass"));
  m.def("diagonalise_inertia", &diagonalise_inertia, py::arg("tensor"));
}

}  // namespace

PYBIND11_MODULE(_native, m) {
  m.doc() = "Native core of VSR2.";
  py::register_exception<InvalidInput>(m, "InvalidInput", PyExc_ValueError);
  bind_scene(m);
  bind_world(m);
  bind_trial(m);
  bind_contact_model(m);
  m.def("build_facts", &build_facts);
  m.attr("LOG_COLUMNS") = static_cast<int>(kLogColumns);
  m.attr("CONTACT_COLUMNS") = kContactColumns;
}
