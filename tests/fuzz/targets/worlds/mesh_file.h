#pragma once

#include <string>

#include "tests/fuzz/fuzz_target.h"
#include "worlds/mesh/mesh_import.h"

namespace segsim::fuzz {

/// The bytes as a mesh file of that name. Textures are blank: pictures have targets of their
/// own.
inline void parse_mesh(const std::string& bytes, const char* name) {
  worlds::MeshFileOptions options;
  options.add_lights = false;
  (void)worlds::load_mesh_file(in_file(bytes, name), options, worlds::blank_textures());
}

}  // namespace segsim::fuzz
