#pragma once

#include <stdexcept>

namespace segsim::core {

/// A signal asked for the end before all was done; the same command goes on from there. The
/// executable exits with code 4.
class Interrupted : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace segsim::core
