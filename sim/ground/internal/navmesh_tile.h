#pragma once

/// @file
/// What must hold of Detour's data block before Detour sees it.

#include <span>
#include <string>

namespace segsim::sim::internal {

/// Detour follows every index and count of a tile without a look at it: what is wrong there is
/// read, and written, beyond the block. This checks all of them. The hash that a bundle has of
/// its navigation mesh is no defence, as it stands beside it.
///
/// The other way was to build the mesh anew from the collision mesh at every start. It would
/// take seconds for a large scene, and paths and start positions would hang on the version of
/// Recast that the reader happens to have.
/// @param place  The file, for messages.
/// @throws core::InputError for a block that dtCreateNavMeshData would not have made.
void check_navmesh_tile(std::span<const unsigned char> block, const std::string& place);

}  // namespace segsim::sim::internal
