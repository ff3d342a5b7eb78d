#pragma once

#include <filesystem>

namespace segsim::renderer::internal {

/// OpenEXR takes the memory that a header asks for before it reads: gigabytes for an attribute
/// or a table of chunks that the file cannot hold. This looks at the sizes first; everything
/// else is left to the library.
/// @throws core::InputError for what is no regular file, and for such a header.
void check_exr_header(const std::filesystem::path& file);

}  // namespace segsim::renderer::internal
