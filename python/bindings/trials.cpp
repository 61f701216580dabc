// Trials, their results and columns, and batches of them; the GIL is released while they run.

#include "bindings.hpp"
#include "vsr2/batch.hpp"

namespace vsr2::binding {
namespace {

/// Whether an array views read-only arrays alone, and the last owns its memory or views `bytes`; as
/// `vsr2.read_only` has it.
bool is_read_only(const py::array& array) {
  py::object owner = array;
  while (py::isinstance<py::array>(owner)) {
    const auto view = py::reinterpret_borrow<py::array>(owner);
    if (view.writeable()) return false;
    if (!view.base()) return view.owndata();
    owner = py::reinterpret_borrow<py::object>(view.base());
    if (PyMemoryView_Check(owner.ptr())) owner = owner.attr("obj");
  }
  return PyBytes_CheckExact(owner.ptr());
}

/// Borrows the memory of a motion's channel. The array lives until the last trial that needs it is
/// gone, on whatever thread that is, and must stay read-only.
Samples borrow(const Given<py::array>& given) {
  const py::array array = taken_array(given.object, "values", Elements::float64, {kAny});
  if ((array.flags() & py::array::c_style) == 0)
    throw py::type_error("values must be contiguous in memory; give a copy");
  if (!is_read_only(array))
    throw InvalidInput(
        "samples are borrowed, so their array, and one that it is a view of, must be read-only and "
        "own its memory or view bytes; call setflags(write=False), or give a copy");
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

/// A column as Python has it.
struct NamedColumn {
  std::string name;
  std::string unit;
  std::string description;
  std::string missing;  ///< what it says that a value is NaN or empty
  std::string dtype;
  std::string vector = "";
  std::string quantity = "";
};

/// The numbers of a trial's row, in the order of its columns.
struct ResultColumn {
  Column column;
  double TrialResult::* member;
  const char* missing = "";
};
constexpr ResultColumn kResultColumns[] = {
    {{"settling_time", "s", "time that settling took"}, &TrialResult::settling_time},
    {{"simulated_time", "s", "time after settling"}, &TrialResult::simulated_time},
    {{"overturning_time", "s", "time from which on it had irreversibly overturned"},
     &TrialResult::overturning_time,
     "never"},
    {{"peak_tilt", "rad", "largest tilt from the settled pose"}, &TrialResult::peak_tilt},
    {{"final_tilt", "rad", "tilt from the settled pose at the end"}, &TrialResult::final_tilt},
    {{"final_slip", "m", "travel of the rock's foot at the end"}, &TrialResult::final_slip},
    {{"final_yaw", "rad", "turn about the vertical at the end"}, &TrialResult::final_yaw},
    {{"peak_tracking_error", "m", "largest distance of the pedestal from its set-point"},
     &TrialResult::peak_tracking_error},
};

/// A list of a log's columns, whose values are doubles.
template <std::size_t kCount>
void bind_columns(py::module_& m, const char* name, const std::array<Column, kCount>& columns) {
  m.def(name, [&columns] {
    std::vector<NamedColumn> out;
    for (const Column& one : columns)
      out.push_back({one.name, one.unit, std::string(one.description) + one.component, "", "float64",
                     one.vector, one.description});
    return out;
  });
}

/// What a settled start is made from.
struct StartArguments {
  std::shared_ptr<Scene> scene;
  Drive drive{};
  Pose X_WB;
  RestCriterion rest;
  double timeout = 0.0;  ///< [s]
  std::int64_t log_every = 0;
};

/// A batch goes with the GIL released: its threads may need it to give borrowed memory back.
struct DeleteWithoutGil {
  void operator()(Batch* batch) const {
    const py::gil_scoped_release release;
    delete batch;
  }
};

void bind_endings(py::module_& m) {
  bind_enum<Status>(m,
                    {{"ok", Status::ok},
                     {"settling_timeout", Status::settling_timeout},
                     {"tail_timeout", Status::tail_timeout},
                     {"diverged", Status::diverged},
                     {"error", Status::error},
                     {"cancelled", Status::cancelled},
                     {"not_run", Status::not_run}});
  bind_enum<Outcome>(m,
                     {{"stable", Outcome::stable},
                      {"rocked", Outcome::rocked},
                      {"slid", Outcome::slid},
                      {"rotated", Outcome::rotated},
                      {"overturned", Outcome::overturned},
                      {"failed", Outcome::failed}});
}

void bind_specification(py::module_& m) {
  py::class_<Samples>(m, "Samples", "Set-points in the memory of a read-only array, which it keeps.")
      .def(py::init(&borrow), py::kw_only(), py::arg("values"));

  using S = StartArguments;
  py::class_<SettledStart, std::shared_ptr<SettledStart>> start(m, "SettledStart");
  bind_constructor<S>(
      start,
      [](S s) {
        return std::make_shared<SettledStart>(std::move(s.scene), s.drive, s.X_WB, s.rest, s.timeout,
                                              s.log_every);
      },
      Field{"scene", &S::scene}, Field{"drive", &S::drive},
      Field{"position", [](S& s) -> Eigen::Vector3d& { return s.X_WB.position; }},
      Field{"orientation", [](S& s) -> Vector4& { return s.X_WB.orientation.coeffs(); }},
      Field{"linear_speed", [](S& s) -> double& { return s.rest.linear_speed; }},
      Field{"angular_speed", [](S& s) -> double& { return s.rest.angular_speed; }},
      Field{"window", [](S& s) -> double& { return s.rest.window; }},
      Field{"timeout", &S::timeout}, Field{"log_every", &S::log_every});

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
}

void bind_result(py::module_& m) {
  py::class_<TrialResult> result(m, "TrialResult", "Its numbers: result_columns().");
  for (const ResultColumn& column : kResultColumns)
    result.def_readonly(column.column.name, column.member, column.column.unit);
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
           "Columns excursion_columns(): one row a row of the state log, or none where the pedestal moved "
           "along x; may be taken once.")
      .def("take_contacts",
           [](TrialResult& r) { return adopt(std::move(r.contacts), kContactColumns); },
           "Contact log, columns contact_columns(); may be taken once.");
}

void bind_batch(py::module_& m) {
  py::class_<Batch, std::unique_ptr<Batch, DeleteWithoutGil>>(m, "Batch")
      .def(py::init([](const Taken<int>& threads) { return new Batch(taken(threads, "threads")); }),
           py::kw_only(), py::arg("threads"))
      .def("add", &Batch::add, py::arg("trial"))
      .def("close", &Batch::close)
      // Python signals are handled between the short waits, so Ctrl-C is seen at once.
      .def("wait",
           [](Batch& batch, const Taken<double>& given) {
             const double timeout = taken(given, "timeout");
             const py::gil_scoped_release release;
             return batch.wait(timeout);
           },
           py::arg("timeout"))
      .def("exhausted", &Batch::exhausted, py::call_guard<py::gil_scoped_release>())
      .def("cancel", &Batch::cancel)
      .def("join", &Batch::join, py::call_guard<py::gil_scoped_release>())
      .def("take",
           [](Batch& batch, const Taken<std::size_t>& index) {
             return batch.take(taken(index, "index"));
           },
           py::arg("index"));
}

// The table of trials: numbers, and words among which an enumeration's names are listed.
std::vector<NamedColumn> result_columns(const py::module_& m) {
  const auto word = [](const char* name, const std::string& description, const py::object& among,
                       const char* missing = "") {
    const auto names = py::str(", ").attr("join")(among).cast<std::string>();
    return NamedColumn{name, "", description + ": " + names, missing, "object"};
  };
  py::list engines(names_of(m, "EngineKind"));
  engines.attr("remove")("auto");  // which is the choice among them
  std::vector<NamedColumn> out{word("status", "how it ended", names_of(m, "Status")),
                               word("outcome", "what the rock did", names_of(m, "Outcome"))};
  for (const auto& [column, member, missing] : kResultColumns)
    out.push_back({column.name, column.unit, column.description, missing, "float64"});
  out.push_back({"steps", "1", "time steps that were taken, the trial's own settling included", "",
                 "int64"});
  out.push_back(word("engine", "engine that it began with", engines, "none ran"));
  out.push_back(word("hand_over", "why `fast` went on with `exact`", names_of(m, "HandOver")));
  out.push_back({"message", "", "text of the exception that ended a trial of status `error`",
                 "there was none", "object"});
  return out;
}

void bind_column_lists(py::module_& m) {
  using C = NamedColumn;
  bind_record<C>(m, "Column", Field{"name", &C::name}, Field{"unit", &C::unit},
                 Field{"description", &C::description}, Field{"missing", &C::missing},
                 Field{"dtype", &C::dtype})
      .def_readonly("name", &C::name)
      .def_readonly("unit", &C::unit, "1: a number without one; empty: no number.")
      .def_readonly("description", &C::description, "Without the unit.")
      .def_readonly("missing", &C::missing, "What NaN or an empty text says; empty: nothing.")
      .def_readonly("dtype", &C::dtype, "That numpy holds it with; text is of dtype object.")
      .def_readonly("vector", &C::vector, "Of which it is a component; empty: of none.")
      .def_readonly("quantity", &C::quantity, "Description without the component, of a column of a log.");
  bind_columns(m, "state_columns", kStateLog);
  bind_columns(m, "excursion_columns", kExcursionLog);
  bind_columns(m, "contact_columns", kContactLog);
  m.def("result_columns", [columns = result_columns(m)] { return columns; },
        "What running a trial gives in its row.");
}

}  // namespace

void bind_trials(py::module_& m) {
  bind_endings(m);
  bind_specification(m);
  bind_result(m);
  bind_batch(m);
  bind_column_lists(m);
}

}  // namespace vsr2::binding
