// Motions of the pedestal that the core computes.

#include "bindings.hpp"
#include "vsr2/limited_table.hpp"

using namespace vsr2;
using namespace vsr2::binding;

void vsr2::binding::bind_motions(py::module_& m) {
  using Number = Given<double>;
  m.def(
      "follow_within_limits",
      [](const py::object& displacement, const py::object& velocity, const py::object& acceleration,
         const Number& place, const Number& speed, const Number& greatest_speed,
         const Number& greatest_acceleration, const Number& stiffness, const Number& damping,
         const Number& time_step) {
        auto x = py::array_t<double>(taken_array(displacement, "displacement", Elements::float64, {kAny}));
        auto v = py::array_t<double>(taken_array(velocity, "velocity", Elements::float64, {x.size()}));
        auto a = py::array_t<double>(taken_array(acceleration, "acceleration", Elements::float64, {x.size()}));
        const TableLimits limits{taken(greatest_speed, "greatest_speed"),
                                 taken(greatest_acceleration, "greatest_acceleration"),
                                 taken(stiffness, "stiffness"), taken(damping, "damping"),
                                 taken(time_step, "time_step")};
        py::array_t<double> out({py::ssize_t(3), x.size()});
        double* const rows = out.mutable_data();
        const std::size_t size = x.size();
        for (std::size_t i = 0; i < size; ++i) {
          rows[i] = x.at(i);
          rows[size + i] = v.at(i);
          rows[2 * size + i] = a.at(i);
        }
        follow_within_limits(limits, taken(place, "place"), taken(speed, "speed"), size, rows, rows + size,
                             rows + 2 * size);
        return out;
      },
      py::kw_only(), py::arg("displacement"), py::arg("velocity"), py::arg("acceleration"), py::arg("place"),
      py::arg("speed"), py::arg("greatest_speed"), py::arg("greatest_acceleration"), py::arg("stiffness"),
      py::arg("damping"), py::arg("time_step"),
      "Displacement, velocity and acceleration of a table with limits that follows a command, shape (3, n).");
}
