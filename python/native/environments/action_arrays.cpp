#include "python/native/environments/action_arrays.h"

#include <cmath>
#include <cstdint>
#include <string>

#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include "core/error.h"

namespace segsim::python {
namespace {

namespace nb = nanobind;
using namespace nb::literals;

template <class Number>
using Numbers = nb::ndarray<const Number, nb::c_contig, nb::device::cpu>;

/// An array of that kind of numbers. @param kinds  NumPy's letters of those that are accepted.
template <class Number>
Numbers<Number> numbers_of(nb::handle value, const char* type, const std::string& kinds,
                           const char* expected) {
  const nb::object numpy = nb::module_::import_("numpy");
  const nb::object array = numpy.attr("asarray")(value);
  const nb::object dtype = array.attr("dtype");
  if (kinds.find(nb::cast<std::string>(dtype.attr("kind"))) == std::string::npos) {
    throw core::InputError::expected("actions", expected, nb::str(dtype).c_str());
  }
  return nb::cast<Numbers<Number>>(numpy.attr("ascontiguousarray")(array, "dtype"_a = type));
}

template <class Number>
void check_shape(const Numbers<Number>& numbers, const std::vector<std::size_t>& expected) {
  bool same = numbers.ndim() == expected.size();
  for (std::size_t axis = 0; same && axis < expected.size(); ++axis) {
    same = numbers.shape(axis) == expected[axis];
  }
  if (same) return;
  const auto text = [](std::size_t axes, const auto& side) {
    std::string sides;
    for (std::size_t axis = 0; axis < axes; ++axis) {
      sides += (axis == 0 ? "" : ", ") + std::to_string(side(axis));
    }
    return "[" + sides + "]";
  };
  throw core::InputError::expected(
      "actions", "shape " + text(expected.size(), [&](std::size_t k) { return expected[k]; }),
      text(numbers.ndim(), [&](std::size_t k) { return numbers.shape(k); }));
}

}  // namespace

ActionArrays::ActionArrays(nb::handle array, const sim::DiscreteActions* discrete,
                           std::size_t count) {
  if (discrete != nullptr) {
    const auto chosen = numbers_of<std::int64_t>(array, "int64", "iu", "integers");
    check_shape(chosen, {count});
    for (std::size_t i = 0; i < count; ++i) {
      const std::int64_t number = chosen.data()[i];
      if (number < 0 || number >= sim::kDiscreteActions) {
        throw core::InputError::expected(
            "actions", "0 (stop), 1 (forward), 2 (left) or 3 (right)", std::to_string(number));
      }
      const auto action = static_cast<sim::DiscreteAction>(number);
      actions_.push_back({action == sim::DiscreteAction::kStop, discrete->commands(action)});
    }
    return;
  }
  const auto numbers = numbers_of<double>(array, "float64", "fiu", "numbers");
  check_shape(numbers, {count, 3});
  commands_.reserve(count);  // Actions refer to them.
  for (std::size_t i = 0; i < count; ++i) {
    const double* row = numbers.data() + 3 * i;
    for (int k = 0; k < 3; ++k) {
      if (std::isfinite(row[k])) continue;
      throw core::InputError::expected("actions", "finite numbers", std::to_string(row[k]));
    }
    commands_.push_back({row[0], row[1]});
    actions_.push_back({row[2] > kStopAbove, {&commands_.back(), 1}});
  }
}

}  // namespace segsim::python
