#pragma once

#include <map>
#include <string>

namespace segsim::perception {

/// SHA-256 of what the libraries behind the detectors make of fixed inputs, by the name of the
/// operation: elementary functions and sums of libtorch, products of the BLAS, convolutions of
/// oneDNN (inference, and both gradients), resizing and warping of OpenCV. Equal on two
/// machines if that library computes the same bits there. On one thread.
[[nodiscard]] std::map<std::string, std::string> numeric_fingerprints();

}  // namespace segsim::perception
