// The Python module vsr2._native: conversions only. Python validates and allocates.

#include "bindings.hpp"
#include "vsr2/build_facts.hpp"

using namespace vsr2;
using namespace vsr2::binding;

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
  bind_worlds(m);
  bind_trials(m);
  m.def("build_facts", &build_facts);
}
