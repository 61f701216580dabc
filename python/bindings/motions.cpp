// Motions of the pedestal that the core computes.

#include "bindings.hpp"
#include "vsr2/limited_table.hpp"

using namespace vsr2;
using namespace vsr2::binding;

void vsr2::binding::bind_motions(py::module_& m) {
  using Number = Given<double>;
  m.def(
      "follow_within_limits",
      [](const py::object& command, const Number& place, const Number& speed, const Number& greatest_speed,
         const Number& greatest_acceleration, const Number& stiffness, const Number& damping,
         const Number& time_step) {
        const py::array_t<double> given(taken_array(command, "command", Elements::float64, {3, kAny}));
        const TableLimits limits{taken(greatest_speed, "greatest_speed"),
                                 taken(greatest_acceleration, "greatest_acceleration"),
                                 taken(stiffness, "stiffness"), taken(damping, "damping"),
                                 taken(time_step, "time_step")};
        py::array_t<double> out({py::ssize_t(3), given.shape(1)});
        const auto from = given.unchecked<2>();
        auto to = out.mutable_unchecked<2>();
        for (py::ssize_t row = 0; row < 3; ++row)
          for (py::ssize_t i = 0; i < given.shape(1); ++i) to(row, i) = from(row, i);
        const std::size_t size = given.shape(1);
        double* const rows = out.mutable_data();
        follow_within_limits(limits, taken(place, "place"), taken(speed, "speed"), size, rows, rows + size,
                             rows + 2 * size);
        return out;
      },
      py::kw_only(), py::arg("command"), py::arg("place"), py::arg("speed"), py::arg("greatest_speed"),
      py::arg("greatest_acceleration"), py::arg("stiffness"), py::arg("damping"), py::arg("time_step"),
      "Displacement, velocity and acceleration of a table with limits that follows a command, shape (3, n).");
}
