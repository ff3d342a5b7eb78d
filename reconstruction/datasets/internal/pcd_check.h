#pragma once

/// @file
/// Whether a PCD file is whole. PCL takes the lines of a header in any number and order, and
/// crashes at some.

#include <string>
#include <string_view>

namespace segsim::reconstruction::internal {

/// @throws InputError unless the header has FIELDS, SIZE, TYPE, COUNT (may be missing), WIDTH,
/// HEIGHT, VIEWPOINT (may be missing), POINTS and DATA in this order, of equal numbers of
/// fields, and the body has as much as they promise.
void check_pcd(std::string_view bytes, const std::string& place);

}  // namespace segsim::reconstruction::internal
