// Views of NumPy arrays, with errors that name the argument, and copies.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/core/error.hpp"

namespace sfmcpp::bindings {

namespace py = pybind11;

// Numbers in the bytes of a file or in packed records may begin anywhere.
template <class Array>
bool is_aligned(const Array& array) {
  constexpr auto kAlignment = alignof(typename Array::value_type);
  return array.size() == 0 || reinterpret_cast<std::uintptr_t>(array.data()) % kAlignment == 0;
}

// The array must have this dtype and be C-contiguous: a copy would not be seen by the caller.
template <class T>
std::span<T> view(const py::dict& arrays, const char* name) {
  if (!arrays.contains(name)) throw InvalidArgument(std::string(name) + ": missing");
  const py::object value = arrays[name];
  if (!py::isinstance<py::array_t<std::remove_const_t<T>, py::array::c_style>>(value)) {
    throw InvalidArgument(std::string(name) + ": must be a C-contiguous array of dtype " +
                          py::str(py::dtype::of<std::remove_const_t<T>>()).cast<std::string>());
  }
  auto array = value.cast<py::array_t<std::remove_const_t<T>, py::array::c_style>>();
  if (!is_aligned(array)) {
    throw InvalidArgument(std::string(name) + ": must be aligned in memory, as a copy of it is");
  }
  const auto size = static_cast<std::size_t>(array.size());
  if constexpr (std::is_const_v<T>) {
    return {array.data(), size};
  } else {
    if (!array.writeable()) throw InvalidArgument(std::string(name) + ": must be writeable");
    return {array.mutable_data(), size};
  }
}

// A copy, of one dimension.
template <class T>
py::array_t<T> array_of(const std::vector<T>& values) {
  return py::array_t<T>(static_cast<py::ssize_t>(values.size()), values.data());
}

// The vector itself, of one dimension. What a reader needs for a moment leaves the store of buffers
// pages that the next solve finds there.
template <class T>
py::array_t<T> array_from(AlignedVector<T> values) {
  auto kept = std::make_unique<AlignedVector<T>>(std::move(values));
  const auto size = static_cast<py::ssize_t>(kept->size());
  const T* data = kept->data();
  const py::capsule owner(kept.get(),
                          [](void* vector) { delete static_cast<AlignedVector<T>*>(vector); });
  static_cast<void>(kept.release());
  return py::array_t<T>(size, data, owner);
}

// Keeps views of arrays from dangling while others have the GIL: they may take an array out of its
// dictionary, so it is held, and NumPy resizes no array that has a weak reference, even where it is
// told not to count references. Numbers may still change under the views.
class KeptArrays {
 public:
  // Of arrays, also named ones, dictionaries with arrays, and vectors of these.
  template <class... Kept>
  explicit KeptArrays(const Kept&... kept) {
    (keep(kept), ...);
  }

 private:
  void keep(const py::array& array) {
    held_.push_back(array);
    unresized_.emplace_back(py::handle(array));
  }
  void keep(const py::dict& arrays) {
    for (const auto& [name, value] : arrays)
      if (py::isinstance<py::array>(value)) keep(py::reinterpret_borrow<py::array>(value));
  }
  void keep(const std::pair<std::string, py::array>& named) { keep(named.second); }
  template <class T>
  void keep(const std::vector<T>& several) {
    for (const T& each : several) keep(each);
  }

  std::vector<py::array> held_;
  std::vector<py::weakref> unresized_;
};

}  // namespace sfmcpp::bindings
