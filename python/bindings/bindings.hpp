#pragma once
// What the files of the binding have in common: records whose fields are taken by name and of their
// own type, enumerations, arrays and poses.

#include <functional>
#include <initializer_list>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <pybind11/eigen.h>
#include <pybind11/native_enum.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "vsr2/scene.hpp"

namespace vsr2::binding {

namespace py = pybind11;

using Vector4 = Eigen::Vector4d;  // a quaternion x, y, z, w

/// A number that Python's True and False do not convert to, nor integers between two floats.
template <typename T>
struct Number {
  T value;
  operator T() const { return value; }
};

/// What a value of type T is taken as: a field of a record, an argument of a function.
template <typename T>
using Taken = std::conditional_t<std::is_arithmetic_v<T> && !std::is_same_v<T, bool>, Number<T>, T>;

}  // namespace vsr2::binding

template <typename T>
struct pybind11::detail::type_caster<vsr2::binding::Number<T>> {
  PYBIND11_TYPE_CASTER(vsr2::binding::Number<T>, make_caster<T>::name);
  bool load(handle source, bool convert) {
    make_caster<T> number;
    if (PyBool_Check(source.ptr()) || !number.load(source, convert)) return false;
    value.value = cast_op<T>(number);
    if constexpr (std::is_floating_point_v<T>)  // Python compares integers and floats exactly
      return !PyLong_Check(source.ptr()) || source.equal(float_(value.value));
    return true;
  }
};

namespace vsr2::binding {

/// An argument that takes its own type alone.
inline py::arg strict(const char* name) { return py::arg(name).noconvert(); }

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

inline bool is_float64(const py::array& array) {
  return array.dtype().equal(py::dtype::of<double>());
}

inline Pose make_pose(const Eigen::Vector3d& position, const Vector4& xyzw) {
  return {position, Eigen::Quaterniond(xyzw)};
}

/// What a scene is made of, and the scene.
void bind_scene(py::module_& m);
/// Worlds that Python steps, and their states.
void bind_worlds(py::module_& m);
/// Trials, their results and columns, and batches of them.
void bind_trials(py::module_& m);

}  // namespace vsr2::binding
