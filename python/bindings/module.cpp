// The Python module vsr2._native: conversions only. Python validates and allocates; the GIL is
// released while trials run.

#include <algorithm>
#include <cstring>
#include <functional>
#include <type_traits>

#include <pybind11/eigen.h>
#include <pybind11/native_enum.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "vsr2/batch.hpp"
#include "vsr2/build_facts.hpp"
#include "vsr2/engines.hpp"
#include "vsr2/recorded_world.hpp"

namespace py = pybind11;
using namespace vsr2;

namespace {

using Vector4 = Eigen::Vector4d;  // a quaternion x, y, z, w

/// A number that Python's True and False do not convert to.
template <typename T>
struct Number {
  T value;
  operator T() const { return value; }
};

/// What a value of type T is taken as: a field of a record, an argument of a function.
template <typename T>
using Taken = std::conditional_t<std::is_arithmetic_v<T> && !std::is_same_v<T, bool>, Number<T>, T>;

}  // namespace

template <typename T>
struct pybind11::detail::type_caster<Number<T>> {
  PYBIND11_TYPE_CASTER(Number<T>, make_caster<T>::name);
  bool load(handle source, bool convert) {
    make_caster<T> number;
    if (PyBool_Check(source.ptr()) || !number.load(source, convert)) return false;
    value.value = cast_op<T>(number);
    return true;
  }
};

namespace {

/// An argument that takes its own type alone.
py::arg strict(const char* name) { return py::arg(name).noconvert(); }

/// A keyword of a record: its name, and how it is reached (a member, or a function that returns a
/// reference to part of the record).
template <typename Access>
struct Field {
  const char* name;
  Access access;
};

template <typename T, typename F>
using ValueOf = std::remove_cvref_t<std::invoke_result_t<decltype(F::access), T&>>;

/// Binds a struct of settings: a constructor that takes every field by its name, and no other type
/// than the field's. Units are those of the struct's members.
template <typename T, typename... Fields>
py::class_<T> bind_record(py::module_& m, const char* name, const Fields&... fields) {
  py::class_<T> type(m, name);
  type.def(py::init([fields...](Taken<ValueOf<T, Fields>>... values) {
             T record;
             ((std::invoke(fields.access, record) = std::move(values)), ...);
             return record;
           }),
           py::kw_only(), strict(fields.name)...);
  return type;
}

/// An enumeration with the names of its values.
template <typename E>
void bind_enum(py::module_& m, const char* name, std::initializer_list<std::pair<const char*, E>> values) {
  py::native_enum<E> type(m, name, "enum.Enum");
  for (const auto& [label, value] : values) type.value(label, value);
  type.finalize();
}

/// Rows of three numbers; `kinds`: numpy's letters of the types that convert without loss.
template <typename Scalar>
std::vector<std::array<Scalar, 3>> rows3(const py::array& array, const char* kinds, const char* what) {
  if (std::strchr(kinds, array.dtype().kind()) == nullptr)
    throw py::type_error(std::string(what) + " must be of another type than " +
                         std::string(py::str(array.dtype())));
  if (array.ndim() != 2 || array.shape(1) != 3)
    throw InvalidInput(std::string(what) + " must have shape (n, 3)");
  const py::array_t<Scalar, py::array::c_style | py::array::forcecast> values(array);
  std::vector<std::array<Scalar, 3>> out(static_cast<std::size_t>(values.shape(0)));
  std::copy_n(values.data(), 3 * out.size(), out.empty() ? nullptr : out.front().data());
  if (array.dtype().kind() == 'u' &&
      std::any_of(values.data(), values.data() + values.size(), [](Scalar v) { return v < 0; }))
    throw InvalidInput(std::string(what) + " must be below 2^63");
  return out;
}

std::vector<Eigen::Vector3d> points(const py::array& array, const char* what) {
  std::vector<Eigen::Vector3d> out;
  for (const auto& row : rows3<double>(array, "fiu", what)) out.emplace_back(row.data());
  return out;
}

Pose make_pose(const Eigen::Vector3d& position, const Vector4& xyzw) {
  return {position, Eigen::Quaterniond(xyzw)};
}

/// Borrows the memory of a motion's channel. The array lives until the last trial that needs it is
/// gone, on whatever thread that is, and must not be written to.
Samples borrow(const py::array& array) {
  if (array.ndim() != 1 || !array.dtype().equal(py::dtype::of<double>()) ||
      (array.flags() & py::array::c_style) == 0)
    throw py::type_error("samples must be a contiguous array of float64 of shape (n,)");
  if (array.writeable())
    throw InvalidInput("samples are borrowed, so their array must be read-only; call setflags(write=False)");
  auto* kept = new py::array(array);
  const auto give_back = [kept](const double*) {
    if (!Py_IsInitialized()) return;
    const py::gil_scoped_acquire gil;
    delete kept;
  };
  return {std::shared_ptr<const double>(static_cast<const double*>(array.data()), give_back),
          static_cast<std::size_t>(array.size())};
}

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
  for (std::size_t i = 0; i < kContactParameters.size(); ++i)
    out[kContactParameters[i].name] = c.pair.all[i];
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
  m.def("combine", &combine, py::arg("a"), py::arg("b"));
}

void bind_scene(py::module_& m) {
  bind_contact_values(m, std::make_index_sequence<kContactParameters.size()>{});
  bind_enum<EngineKind>(m, "EngineKind",
                        {{"auto", EngineKind::automatic},
                         {"parity", EngineKind::parity},
                         {"exact", EngineKind::exact},
                         {"fast", EngineKind::fast}});
  bind_enum<Handover>(m, "HandOver",
                      {{"none", Handover::none},
                       {"off_the_top", Handover::off_the_top},
                       {"motor_on_a_slope", Handover::motor_on_a_slope},
                       {"too_deep", Handover::too_deep}});
  bind_enum<FastRefusal>(m, "FastRefusal",
                         {{"none", FastRefusal::none},
                          {"several_parts", FastRefusal::several_parts},
                          {"pedestal_not_a_box", FastRefusal::pedestal_not_a_box},
                          {"no_friction_cone", FastRefusal::no_friction_cone},
                          {"rolling_friction", FastRefusal::rolling_friction},
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

  py::class_<HullPart>(m, "HullPart")
      .def(py::init([](const py::array& array) { return HullPart{points(array, "hull points")}; }),
           strict("points"));
  bind_record<BoxPart>(
      m, "BoxPart", Field{"size", &BoxPart::size},
      Field{"position", [](BoxPart& b) -> Eigen::Vector3d& { return b.pose.position; }},
      Field{"orientation", [](BoxPart& b) -> Vector4& { return b.pose.orientation.coeffs(); }});
  py::class_<TrianglesPart>(m, "TrianglesPart")
      .def(py::init([](const py::array& vertices, const py::array& faces) {
             return TrianglesPart{points(vertices, "vertices"),
                                  rows3<std::int64_t>(faces, "iu", "faces")};
           }),
           strict("vertices"), strict("faces"));

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
  bind_record<Mechanisms>(m, "Mechanisms",
                          Field{"impact_energy_ratio", &Mechanisms::impact_energy_ratio},
                          Field{"rocking_damping", &Mechanisms::rocking_damping},
                          Field{"rolling_resistance", &Mechanisms::rolling_resistance},
                          Field{"friction_ratio", &Mechanisms::friction_ratio},
                          Field{"friction_speed", &Mechanisms::friction_speed},
                          Field{"adhesion", &Mechanisms::adhesion},
                          Field{"catch_slack", &Mechanisms::catch_slack});

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

void bind_world(py::module_& m) {
  bind_enum<Drive>(m, "Drive",
                   {{"prescribed", Drive::prescribed},
                    {"prescribed_spatial", Drive::prescribed_spatial},
                    {"motor_position", Drive::motor_position},
                    {"motor_position_velocity", Drive::motor_position_velocity}});

  py::class_<WorldState>(m, "WorldState", "State of a world, opaque; pickles and copies.")
      .def(py::pickle(
          [](const WorldState& state) {
            const auto size = state.actions.size() * sizeof(WorldState::Action);
            return py::make_tuple(
                state.drive, py::bytes(reinterpret_cast<const char*>(state.actions.data()), size));
          },
          [](const py::tuple& content) {
            if (content.size() != 2 || !py::isinstance<py::bytes>(content[1]))
              throw InvalidInput("the state is not one of a world");
            const auto bytes = content[1].cast<std::string>();
            WorldState state{content[0].cast<Drive>(), {}};
            if (bytes.size() % sizeof(WorldState::Action) != 0)
              throw InvalidInput("the state is not one of a world");
            state.actions.resize(bytes.size() / sizeof(WorldState::Action));
            if (!bytes.empty()) std::memcpy(state.actions.data(), bytes.data(), bytes.size());
            state.check();
            return state;
          }));

  // The world behind vsr2.Simulation.
  py::class_<RecordedWorld>(m, "World")
      .def(py::init([](std::shared_ptr<Scene> scene, Drive drive) {
             return std::make_unique<RecordedWorld>(std::move(scene), drive);
           }),
           py::arg("scene"), py::arg("drive"))
      .def("spawn_rock",
           [](RecordedWorld& world, const Eigen::Vector3d& position, const Vector4& orientation) {
             world.spawn_rock(make_pose(position, orientation));
           },
           strict("position"), strict("orientation"))
      .def("delete_rock", &RecordedWorld::delete_rock)
      .def_property_readonly("has_rock", &RecordedWorld::has_rock)
      .def_property_readonly("engine", &RecordedWorld::engine, "Engine it was built with.")
      .def_property_readonly("hand_over", &RecordedWorld::handover,
                             "Why `fast` went on with `exact`, if it did.")
      .def("save_state", &RecordedWorld::save_state)
      .def("restore_state", &RecordedWorld::restore_state, py::arg("state"),
           py::call_guard<py::gil_scoped_release>())
      .def("settle",
           [](RecordedWorld& world, Taken<double> linear_speed, Taken<double> angular_speed,
              Taken<double> window, Taken<double> timeout) {
             return world.settle({.linear_speed = linear_speed,
                                  .angular_speed = angular_speed,
                                  .window = window},
                                 timeout);
           },
           py::kw_only(), strict("linear_speed"), strict("angular_speed"), strict("window"),
           strict("timeout"), py::call_guard<py::gil_scoped_release>(),
           "Holds the pedestal until the rock rests: steps taken, and whether it rests.")
      .def("set_rock_velocity", &RecordedWorld::set_rock_velocity, strict("linear"),
           strict("angular"))
      .def("step",
           [](RecordedWorld& world, Taken<double> position, Taken<double> velocity,
              Taken<double> transverse, Taken<double> vertical, Taken<double> pitch) {
             world.step({position, velocity, {transverse, vertical, pitch}});
           },
           strict("position"), strict("velocity"), strict("transverse") = 0.0,
           strict("vertical") = 0.0, strict("pitch") = 0.0)
      .def_property_readonly("pedestal",
                             [](const RecordedWorld& world) {
                               const PedestalState s = world.pedestal();
                               return std::make_pair(s.position, s.velocity);
                             })
      .def_property_readonly("excursion",
                             [](const RecordedWorld& world) {
                               const Excursion x = world.pedestal().excursion;
                               return std::make_tuple(x.transverse, x.vertical, x.pitch);
                             },
                             "Transverse and vertical displacement [m], pitch [rad].")
      .def_property_readonly("rock",
                             [](const RecordedWorld& world) {
                               const RockState s = world.rock();
                               return std::make_tuple(s.p_WB, Vector4(s.q_WB.coeffs()), s.v_WB, s.w_WB);
                             })
      .def("contacts", [](const RecordedWorld& world) {
        std::vector<ContactPoint> points;
        world.contacts(points);
        py::list out;
        for (const ContactPoint& point : points) out.append(contact_dict(point));
        return out;
      });
}

/// The numbers of a trial's row, in the order of its columns.
struct ResultColumn {
  const char* name;
  double TrialResult::* member;
  const char* meaning;
};
constexpr ResultColumn kResultColumns[] = {
    {"settling_time", &TrialResult::settling_time, "[s]"},
    {"simulated_time", &TrialResult::simulated_time, "after settling [s]"},
    {"overturning_time", &TrialResult::overturning_time,
     "irreversibly overturned from [s]; empty: never"},
    {"peak_tilt", &TrialResult::peak_tilt, "[rad]"},
    {"final_tilt", &TrialResult::final_tilt, "[rad]"},
    {"final_slip", &TrialResult::final_slip, "[m]"},
    {"final_yaw", &TrialResult::final_yaw, "[rad]"},
    {"peak_tracking_error", &TrialResult::peak_tracking_error,
     "commanded against achieved pedestal position [m]"},
};

/// Names of columns with their units or meanings.
using NamedColumns = std::vector<std::pair<std::string, std::string>>;
template <std::size_t kCount>
void bind_columns(py::module_& m, const char* name, const std::array<Column, kCount>& columns) {
  m.def(name, [&columns] {
    NamedColumns out;
    for (const Column& column : columns) out.emplace_back(column.name, column.unit);
    return out;
  });
}

/// A batch goes with the GIL released: its threads may need it to give borrowed memory back.
struct DeleteWithoutGil {
  void operator()(Batch* batch) const {
    const py::gil_scoped_release release;
    delete batch;
  }
};

void bind_trial(py::module_& m) {
  bind_enum<Status>(m, "Status",
                    {{"ok", Status::ok},
                     {"settling_timeout", Status::settling_timeout},
                     {"tail_timeout", Status::tail_timeout},
                     {"diverged", Status::diverged},
                     {"error", Status::error},
                     {"cancelled", Status::cancelled},
                     {"not_run", Status::not_run}});
  bind_enum<Outcome>(m, "Outcome",
                     {{"stable", Outcome::stable},
                      {"rocked", Outcome::rocked},
                      {"slid", Outcome::slid},
                      {"rotated", Outcome::rotated},
                      {"overturned", Outcome::overturned},
                      {"failed", Outcome::failed}});

  py::class_<Samples>(m, "Samples", "Set-points in the memory of a read-only array, which it keeps.")
      .def(py::init(&borrow), strict("values"));

  py::class_<SettledStart, std::shared_ptr<SettledStart>>(m, "SettledStart")
      .def(py::init([](std::shared_ptr<Scene> scene, Drive drive, const Eigen::Vector3d& position,
                       const Vector4& orientation, Taken<double> linear_speed,
                       Taken<double> angular_speed, Taken<double> window, Taken<double> timeout,
                       Taken<std::int64_t> log_every) {
             return std::make_shared<SettledStart>(
                 std::move(scene), drive, make_pose(position, orientation),
                 RestCriterion{.linear_speed = linear_speed,
                               .angular_speed = angular_speed,
                               .window = window}, timeout, log_every);
           }),
           py::kw_only(), py::arg("scene"), py::arg("drive"), strict("position"),
           strict("orientation"), strict("linear_speed"), strict("angular_speed"),
           strict("window"), strict("timeout"), strict("log_every"));

  using T = TrialSpec;
  bind_record<T>(
      m, "TrialSpec", Field{"start", &T::start}, Field{"motion_position", &T::position},
      Field{"motion_velocity", &T::velocity}, Field{"transverse", &T::transverse},
      Field{"vertical", &T::vertical}, Field{"pitch", &T::pitch}, Field{"tail", &T::tail},
      Field{"rest_linear_speed", [](T& t) -> double& { return t.tail_rest.linear_speed; }},
      Field{"rest_angular_speed", [](T& t) -> double& { return t.tail_rest.angular_speed; }},
      Field{"rest_window", [](T& t) -> double& { return t.tail_rest.window; }},
      Field{"overturned_tilt", [](T& t) -> double& { return t.outcome.overturned_tilt; }},
      Field{"toppled_tilt", [](T& t) -> double& { return t.outcome.toppled_tilt; }},
      Field{"rocked_tilt", [](T& t) -> double& { return t.outcome.rocked_tilt; }},
      Field{"slid_distance", [](T& t) -> double& { return t.outcome.slid_distance; }},
      Field{"rotated_angle", [](T& t) -> double& { return t.outcome.rotated_angle; }},
      Field{"stop_early", &T::stop_early}, Field{"log_every", &T::log_every},
      Field{"contacts_every", &T::contacts_every});

  py::class_<TrialResult> result(m, "TrialResult");
  for (const ResultColumn& column : kResultColumns)
    result.def_readonly(column.name, column.member, column.meaning);
  result.def_readonly("status", &TrialResult::status)
      .def_readonly("outcome", &TrialResult::outcome)
      .def_readonly("message", &TrialResult::message)
      .def_readonly("engine", &TrialResult::engine, "That started it; None where none did.")
      .def_readonly("hand_over", &TrialResult::handover, "Why `fast` went on with `exact`.")
      .def_readonly("steps", &TrialResult::steps)
      .def_property_readonly("settled_position",
                             [](const TrialResult& r) { return r.X_WB_settled.position; })
      .def_property_readonly("settled_orientation",
                             [](const TrialResult& r) { return Vector4(r.X_WB_settled.orientation.coeffs()); })
      .def_readonly("foot", &TrialResult::p_B_foot)
      .def("take_log", [](TrialResult& r) { return adopt(std::move(r.log), kLogColumns); },
           "State log, columns state_columns(); may be taken once.")
      .def("take_excursions",
           [](TrialResult& r) { return adopt(std::move(r.excursions), kExcursionColumns); },
           "Transverse and vertical displacement [m], pitch [rad]: one row a row of the state log, or none "
           "where the pedestal moved along x; may be taken once.")
      .def("take_contacts",
           [](TrialResult& r) { return adopt(std::move(r.contacts), kContactColumns); },
           "Contact log, columns contact_columns(); may be taken once.");

  py::class_<Batch, std::unique_ptr<Batch, DeleteWithoutGil>>(m, "Batch")
      .def(py::init([](Taken<int> threads) { return new Batch(threads); }), strict("threads"))
      .def("add", &Batch::add, py::arg("trial"))
      .def("close", &Batch::close)
      // Python signals are handled between the short waits, so Ctrl-C is noticed at once.
      .def("wait", [](Batch& batch, Taken<double> timeout) { return batch.wait(timeout); },
           strict("timeout"), py::call_guard<py::gil_scoped_release>())
      .def("exhausted", &Batch::exhausted, py::call_guard<py::gil_scoped_release>())
      .def("cancel", &Batch::cancel)
      .def("join", &Batch::join, py::call_guard<py::gil_scoped_release>())
      .def("take", [](Batch& batch, Taken<std::size_t> index) { return batch.take(index); },
           strict("index"));
}

}  // namespace

PYBIND11_MODULE(_native, m) {
  m.doc() = "Native core of VSR2.";
  bind_enum<InputFault>(m, "InputFault",
                        {{"bad_value", InputFault::value},
                         {"drive", InputFault::drive},
                         {"engine_domain", InputFault::engine_domain},
                         {"no_rock", InputFault::no_rock},
                         {"rock_present", InputFault::rock_present}});
  static const py::handle invalid_input =
      py::exception<InvalidInput>(m, "InvalidInput", PyExc_ValueError).release();
  py::register_exception_translator([](std::exception_ptr pointer) {
    try {
      if (pointer) std::rethrow_exception(pointer);
    } catch (const InvalidInput& error) {
      const py::object raised = invalid_input(error.what());
      raised.attr("fault") = error.fault();
      PyErr_SetObject(invalid_input.ptr(), raised.ptr());
    }
  });
  bind_scene(m);
  bind_world(m);
  bind_trial(m);
  m.def("build_facts", &build_facts);
  bind_columns(m, "state_columns", kStateLog);
  bind_columns(m, "contact_columns", kContactLog);
  m.def("result_columns", [] {
    NamedColumns out;
    for (const ResultColumn& column : kResultColumns) out.emplace_back(column.name, column.meaning);
    return out;
  });
}
