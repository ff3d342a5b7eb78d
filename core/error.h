#pragma once

#include <stdexcept>
#include <string>

namespace segsim::core {

/// The world outside is at fault: a file, a key or a flag. The message is one line that names
/// the place, what was expected and what was found. The executable exits with code 2.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;

  /// "<place>: expected <expected>, found <found>"
  [[nodiscard]] static InputError expected(const std::string& place,
                                           const std::string& expected,
                                           const std::string& found) {
    return InputError(place + ": expected " + expected + ", found " + found);
  }
};

/// A check that the user asked for did not hold. The executable exits with code 1.
class CheckFailed : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace segsim::core
