// The Python module vsr2._native: conversions only. Python validates and allocates. What takes
// several arguments, and every constructor, takes them by name.

#include <algorithm>
#include <string>

#include "bindings.hpp"
#include "vsr2/build_facts.hpp"
#include "vsr2/constants.hpp"

using namespace vsr2;
using namespace vsr2::binding;

namespace {

bool is_masked(const py::object& object) {
  return py::isinstance(object, py::module_::import("numpy.ma").attr("MaskedArray"));
}

/// What an argument was given.
std::string described(const py::object& given) {
  if (given.is_none()) return "None";
  const std::string type = py::str(py::type::of(given).attr("__name__"));
  if (py::isinstance<py::array>(given))
    return std::string(is_masked(given) ? "a masked" : "an") + " array of " +
           std::string(py::str(given.attr("dtype"))) + " of shape " +
           std::string(py::str(given.attr("shape")));
  const bool number = PyLong_Check(given.ptr()) || PyFloat_Check(given.ptr());
  return number ? type + " " + std::string(py::str(given)) : "a value of type " + type;
}

/// A shape as numpy writes it, with n for any length.
std::string written(std::initializer_list<py::ssize_t> shape) {
  std::string out = "(";
  for (const py::ssize_t length : shape)
    out += (length == kAny ? "n" : std::to_string(length)) + (shape.size() == 1 ? "," : ", ");
  return (shape.size() == 1 ? out : out.substr(0, out.size() - 2)) + ")";
}

}  // namespace

py::array vsr2::binding::taken_array(const py::object& given, const char* name, Elements elements,
                                     std::initializer_list<py::ssize_t> shape) {
  const auto refusal = [&] {
    return std::string(name) + " must be an array of " +
           (elements == Elements::float64 ? "float64" : "integers") + " of shape " + written(shape) +
           ", not " + described(given);
  };
  if (!py::isinstance<py::array>(given) || is_masked(given)) throw py::type_error(refusal());
  auto array = py::reinterpret_borrow<py::array>(given);
  const char kind = array.dtype().kind();
  const bool fits = elements == Elements::float64 ? array.dtype().equal(py::dtype::of<double>())
                                                  : kind == 'i' || kind == 'u';
  if (!fits) throw py::type_error(refusal());
  const bool same = std::equal(shape.begin(), shape.end(), array.shape(), array.shape() + array.ndim(),
                               [](auto wanted, auto got) { return wanted == kAny || wanted == got; });
  if (!same) throw InvalidInput(refusal());
  return array;
}

void vsr2::binding::refuse_number(const py::object& given, const char* name, const char* wanted) {
  throw py::type_error(std::string(name) + " must be " + wanted + ", not " + described(given));
}

PYBIND11_MODULE(_native, m) {
  m.doc() = "Native core of VSR2.";
  static const py::handle invalid_input =
      py::exception<InvalidInput>(m, "InvalidInput", PyExc_ValueError).release();
  bind_enum<Fault>(m,
                   {{"bad_value", Fault::bad_value},
                    {"geometry", Fault::geometry},
                    {"motion", Fault::motion},
                    {"drive", Fault::drive},
                    {"engine_domain", Fault::engine_domain},
                    {"acts_already", Fault::acts_already},
                    {"no_rock", Fault::no_rock},
                    {"rock_present", Fault::rock_present}});
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
  bind_motions(m);
  m.def("build_facts", &build_facts);
  m.def("core_constants", &core_constants, "Chosen numbers of the core, by what they are of and by name.");
}
