#pragma once
// What the files of the binding have in common: records whose fields are taken by name and of their
// own type, enumerations, arrays and poses.

#include <cstdint>
#include <functional>
#include <initializer_list>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "vsr2/engines.hpp"
#include "vsr2/trial.hpp"

namespace vsr2::binding {

namespace py = pybind11;

using Vector4 = Eigen::Vector4d;  // a quaternion x, y, z, w

/// A number or an array as Python gave it; `taken` checks it, where the name of the argument is known.
template <typename T>
struct Given {
  py::object object;
};

template <typename T>
constexpr bool is_given =
    (std::is_arithmetic_v<T> && !std::is_same_v<T, bool>) || std::is_same_v<T, Eigen::Vector3d> ||
    std::is_same_v<T, Vector4>;

/// What a value of type T is taken as: a field of a record, an argument of a function.
template <typename T>
using Taken = std::conditional_t<is_given<T>, Given<T>, T>;

/// A type of the elements of arrays.
enum class Elements { float64, integers };
/// A length that an array may choose.
constexpr py::ssize_t kAny = -1;

/// The array that an argument is, never converted.
///
/// @throws py::type_error not an array, one with a mask, or one of other elements.
/// @throws InvalidInput another shape.
py::array taken_array(const py::object& given, const char* name, Elements elements,
                      std::initializer_list<py::ssize_t> shape);

/// What numbers of a type are called in errors.
template <typename T>
inline constexpr const char* kNumberName = "a float, or an integer equal to one";
template <>
inline constexpr const char* kNumberName<int> = "an integer of 32 bits";
template <>
inline constexpr const char* kNumberName<std::int64_t> = "an integer of 64 bits";
template <>
inline constexpr const char* kNumberName<std::size_t> = "an integer of 64 bits, not negative";

/// Refuses what is not a number of the type.
[[noreturn]] void refuse_number(const py::object& given, const char* name, const char* wanted);

/// The value of an argument; True and False are no numbers, nor are arrays, and no integer is taken
/// that lies between two floats.
///
/// @throws py::type_error another type.
/// @throws InvalidInput an array of another shape.
template <typename T>
T taken(const Given<T>& given, const char* name) {
  if constexpr (std::is_arithmetic_v<T>) {
    const py::object& object = given.object;
    py::detail::make_caster<T> number;
    bool fits = !PyBool_Check(object.ptr()) && !py::isinstance<py::array>(object) &&
                number.load(object, false);
    if constexpr (std::is_floating_point_v<T>)  // Python compares integers and floats exactly
      fits = fits && (!PyLong_Check(object.ptr()) || object.equal(py::float_(T(number))));
    if (!fits)
      refuse_number(object, name, kNumberName<T>);
    return T(number);
  } else {
    const py::array array = taken_array(given.object, name, Elements::float64, {T::RowsAtCompileTime});
    T out;
    for (py::ssize_t i = 0; i < T::RowsAtCompileTime; ++i)
      out[i] = *static_cast<const double*>(array.data(i));
    return out;
  }
}

/// Values of other types are their own.
template <typename T>
  requires(!is_given<T>)
T taken(T value, const char*) {
  return value;
}

/// The class in Python of an enumeration of the core: an enum.StrEnum, whose members are words.
template <typename E>
struct Word;
template <>
struct Word<Drive> {
  static constexpr char name[] = "Drive";
};
template <>
struct Word<EngineKind> {
  static constexpr char name[] = "EngineKind";
};
template <>
struct Word<FastRefusal> {
  static constexpr char name[] = "FastRefusal";
};
template <>
struct Word<Fault> {
  static constexpr char name[] = "Fault";
};
template <>
struct Word<Handover> {
  static constexpr char name[] = "HandOver";
};
template <>
struct Word<Outcome> {
  static constexpr char name[] = "Outcome";
};
template <>
struct Word<Status> {
  static constexpr char name[] = "Status";
};
/// The members, which live as long as the process.
template <typename E>
struct Words {
  static inline std::vector<std::pair<E, py::handle>> members;
};

template <typename E>
concept HasWord = requires { Word<E>::name; };

}  // namespace vsr2::binding

template <vsr2::binding::HasWord E>
struct pybind11::detail::type_caster_enum_type_enabled<E> : std::false_type {};

template <vsr2::binding::HasWord E>
struct pybind11::detail::type_caster<E> {
  PYBIND11_TYPE_CASTER(E, const_name("vsr2._native.") + const_name(vsr2::binding::Word<E>::name));
  bool load(handle source, bool) {
    for (const auto& [member, word] : vsr2::binding::Words<E>::members) {
      if (!word.is(source)) continue;
      value = member;
      return true;
    }
    return false;
  }
  static handle cast(E source, return_value_policy, handle) {
    for (const auto& [member, word] : vsr2::binding::Words<E>::members)
      if (member == source) return word.inc_ref();
    throw cast_error("no word for a value of an enumeration");
  }
};

template <typename T>
struct pybind11::detail::type_caster<vsr2::binding::Given<T>> {
  static constexpr auto element() {
    if constexpr (std::is_base_of_v<Eigen::MatrixBase<T>, T>)
      return const_name("typing.Annotated[numpy.typing.NDArray[numpy.float64], \"[") +
             const_name<static_cast<std::size_t>(T::RowsAtCompileTime)>() + const_name("]\"]");
    else
      return make_caster<T>::name;
  }
  PYBIND11_TYPE_CASTER(vsr2::binding::Given<T>, element());
  bool load(handle source, bool) {
    value.object = reinterpret_borrow<object>(source);
    return true;
  }
};

namespace vsr2::binding {

/// A keyword of a record: its name, and how it is reached (a member, or a function that returns a
/// reference to part of the record).
template <typename Access>
struct Field {
  const char* name;
  Access access;
};

template <typename T, typename F>
using ValueOf = std::remove_cvref_t<std::invoke_result_t<decltype(F::access), T&>>;

/// Gives a class a constructor that takes every field of a record by its name, and no other type than
/// the field's; `make` makes the object from the record.
template <typename Record, typename Type, typename Make, typename... Fields>
void bind_constructor(Type& type, const Make& make, const Fields&... fields) {
  type.def(py::init([make, fields...](Taken<ValueOf<Record, Fields>>... values) {
             Record record;
             ((std::invoke(fields.access, record) = taken(std::move(values), fields.name)), ...);
             return make(std::move(record));
           }),
           py::kw_only(), py::arg(fields.name).noconvert()...);
}

/// Binds a struct of settings, made from its fields. Units are those of the struct's members.
template <typename T, typename... Fields>
py::class_<T> bind_record(py::module_& m, const char* name, const Fields&... fields) {
  py::class_<T> type(m, name);
  bind_constructor<T>(type, [](T record) { return record; }, fields...);
  return type;
}

/// An enumeration of words, with the names of its values.
template <typename E>
void bind_enum(py::module_& m, std::initializer_list<std::pair<const char*, E>> values) {
  py::list names;
  for (const auto& [label, value] : values) names.append(py::make_tuple(label, label));
  const py::object type = py::module_::import("enum").attr("StrEnum")(
      Word<E>::name, names, py::arg("module") = m.attr("__name__"));
  // Tables of results are columns of words, and print as such.
  type.attr("__repr__") = py::handle(reinterpret_cast<PyObject*>(&PyUnicode_Type)).attr("__repr__");
  for (const auto& [label, value] : values)
    Words<E>::members.emplace_back(value, py::object(type.attr(label)).release());
  m.attr(Word<E>::name) = type;
}

/// The names of the values of an enumeration of the module.
inline py::tuple names_of(const py::module_& m, const char* enumeration) {
  return py::tuple(m.attr(enumeration).attr("__members__"));
}

/// What a scene is made of, and the scene.
void bind_scene(py::module_& m);
/// Worlds that Python steps, and their states.
void bind_worlds(py::module_& m);
/// Trials, their results and columns, and batches of them.
void bind_trials(py::module_& m);
/// Motions of the pedestal that the core computes.
void bind_motions(py::module_& m);

}  // namespace vsr2::binding
