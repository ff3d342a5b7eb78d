#pragma once

/// @file
/// What the numbers of flags may be, where several commands ask for the same kind of number:
/// checked at the door, so that no command meets an image without pixels. What is no finite
/// number is refused for all flags alike (experiments/program.cpp).

namespace CLI {  // NOLINT(readability-identifier-naming): theirs
class Validator;
}

namespace segsim::experiments::commands::light {

/// Width or height of an image [px].
CLI::Validator image_side();
/// Horizontal field of view of a pinhole camera [degrees].
CLI::Validator field_of_view_deg();
/// Of a camera above the floor [m]: from a hand's breadth to a lamp post.
CLI::Validator camera_height_m();
/// A coordinate [m], or an angle beside coordinates.
CLI::Validator coordinate();
/// A length or distance [m].
CLI::Validator length_m();

}  // namespace segsim::experiments::commands::light
