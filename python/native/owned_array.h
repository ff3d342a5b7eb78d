#pragma once

/// @file
/// Memory of C++ as a NumPy array that owns it.

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

namespace segsim::python {

/// An array of `Scalar` over the memory that `data` points into, which lives as long as the
/// array and its views do; nothing is copied.
/// @param memory  Anything that frees its memory when it is destroyed.
template <class Scalar, class Memory>
[[nodiscard]] nanobind::object array_over(Scalar* data, std::unique_ptr<Memory> memory,
                                          const std::vector<std::size_t>& shape) {
  const nanobind::capsule owner(
      memory.get(), [](void* pointer) noexcept { delete static_cast<Memory*>(pointer); });
  static_cast<void>(memory.release());
  return nanobind::cast(nanobind::ndarray<nanobind::numpy, Scalar, nanobind::c_contig>(
      data, shape.size(), shape.data(), owner));
}

/// An array of the numbers that the elements consist of.
/// @param shape  With the numbers of one element as last axis, if they are several.
template <class Scalar, class Element>
[[nodiscard]] nanobind::object owned_array(std::vector<Element>&& elements,
                                           const std::vector<std::size_t>& shape) {
  auto memory = std::make_unique<std::vector<Element>>(std::move(elements));
  auto* data = reinterpret_cast<Scalar*>(memory->data());
  return array_over<Scalar>(data, std::move(memory), shape);
}
template <class Scalar>
[[nodiscard]] nanobind::object owned_array(std::vector<Scalar>&& numbers,
                                           const std::vector<std::size_t>& shape) {
  return owned_array<Scalar, Scalar>(std::move(numbers), shape);
}

}  // namespace segsim::python
