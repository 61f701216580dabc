// Worlds that Python steps, behind vsr2.Simulation; conversions only.

#include <cstring>
#include <string_view>

#include "bindings.hpp"
#include "vsr2/recorded_world.hpp"
#include "vsr2/trial.hpp"

namespace vsr2::binding {
namespace {

// The pose of the arguments `position` and `orientation`.
Pose taken_pose(const Given<Eigen::Vector3d>& position, const Given<Vector4>& xyzw) {
  return {taken(position, "position"), Eigen::Quaterniond(taken(xyzw, "orientation"))};
}

// The criterion of the arguments `linear_speed`, `angular_speed` and `window`.
RestCriterion taken_rest(const Given<double>& linear_speed, const Given<double>& angular_speed,
                         const Given<double>& window) {
  return {.linear_speed = taken(linear_speed, "linear_speed"),
          .angular_speed = taken(angular_speed, "angular_speed"),
          .window = taken(window, "window")};
}

// The contact log's quantities, vectors as arrays, and the pair's values.
py::dict contact_dict(const ContactPoint& contact) {
  const auto row = contact_row(0.0, contact);
  py::dict out;
  for (std::size_t i = kTime + 1; i < row.size();) {
    const std::string_view vector = kContactLog[i].vector;
    if (vector.empty()) {
      out[kContactLog[i].name] = row[i];
      ++i;
      continue;
    }
    const std::size_t first = i;
    while (i < row.size() && kContactLog[i].vector == vector) ++i;
    out[kContactLog[first].vector] = py::array_t<double>(static_cast<py::ssize_t>(i - first), &row[first]);
  }
  for (std::size_t i = 0; i < kContactParameters.size(); ++i)
    out[kContactParameters[i].name] = contact.pair.all[i];
  return out;
}

void bind_world_state(py::module_& m) {
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
}

// What can be read from the world.
void bind_readings(py::class_<RecordedWorld>& bound) {
  bound
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
                             "Columns excursion_columns().")
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

}  // namespace

void bind_worlds(py::module_& m) {
  bind_enum<Drive>(m,
                   {{"prescribed", Drive::prescribed},
                    {"prescribed_spatial", Drive::prescribed_spatial},
                    {"motor_position", Drive::motor_position},
                    {"motor_position_velocity", Drive::motor_position_velocity}});

  bind_world_state(m);

  // The world behind vsr2.Simulation.
  py::class_<RecordedWorld> bound(m, "World");
  bound
      .def(py::init([](std::shared_ptr<Scene> scene, Drive drive) {
             return std::make_unique<RecordedWorld>(std::move(scene), drive);
           }),
           py::kw_only(), py::arg("scene").none(false), py::arg("drive"))
      .def("spawn_rock",
           [](RecordedWorld& world, const Taken<Eigen::Vector3d>& position,
              const Taken<Vector4>& orientation) {
             world.spawn_rock(taken_pose(position, orientation));
           },
           py::kw_only(), py::arg("position"), py::arg("orientation"))
      .def("delete_rock", &RecordedWorld::delete_rock)
      .def_property_readonly("has_rock", &RecordedWorld::has_rock)
      .def_property_readonly("engine", &RecordedWorld::engine, "Engine it was built with.")
      .def_property_readonly("hand_over", &RecordedWorld::handover,
                             "Why `fast` went on with `exact`, if it did.")
      .def("save_state", &RecordedWorld::save_state)
      .def("restore_state", &RecordedWorld::restore_state, py::arg("state"),
           py::call_guard<py::gil_scoped_release>())
      .def("settle",
           [](RecordedWorld& world, const Taken<double>& linear_speed,
              const Taken<double>& angular_speed, const Taken<double>& window,
              const Taken<double>& timeout) {
             const RestCriterion rest = taken_rest(linear_speed, angular_speed, window);
             const double longest = taken(timeout, "timeout");
             const py::gil_scoped_release release;
             return world.settle(rest, longest);
           },
           py::kw_only(), py::arg("linear_speed"), py::arg("angular_speed"), py::arg("window"),
           py::arg("timeout"),
           "Holds the pedestal until the rock rests: steps taken, and whether it rests.")
      .def("set_rock_velocity",
           [](RecordedWorld& world, const Taken<Eigen::Vector3d>& linear,
              const Taken<Eigen::Vector3d>& angular) {
             world.set_rock_velocity(taken(linear, "linear"), taken(angular, "angular"));
           },
           py::kw_only(), py::arg("linear"), py::arg("angular"))
      .def("step",
           [](RecordedWorld& world, const Taken<double>& position, const Taken<double>& velocity,
              const Taken<double>& transverse, const Taken<double>& vertical,
              const Taken<double>& pitch) {
             world.step({taken(position, "position"),
                         taken(velocity, "velocity"),
                         {taken(transverse, "transverse"), taken(vertical, "vertical"),
                          taken(pitch, "pitch")}});
           },
           py::kw_only(), py::arg("position"), py::arg("velocity"), py::arg("transverse") = 0.0,
           py::arg("vertical") = 0.0, py::arg("pitch") = 0.0);
  bind_readings(bound);
}

}  // namespace vsr2::binding
