#pragma once

/// @file
/// Recorded frames (docs/exr.md) for Python.

#include <nanobind/nanobind.h>

namespace segsim::python {

/// read_frame.
void bind_frame_files(nanobind::module_& module);

}  // namespace segsim::python
