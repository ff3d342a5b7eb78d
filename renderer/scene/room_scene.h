#pragma once

/// @file
/// The standard benchmark scene `room`: surfels on the surfaces of a furnished room of 8 x 6 x
/// 2.8 m, like a scene trained from pictures: uneven sizes, tilted discs, one in five off its
/// surface, two populations of opacity. Deterministic for (surfel_count, seed, spread).
///
///     distribution              value                                          unit
///
///     boxes                     40, size U(0.3..1.4, 0.3..0.9, 0.3..1.6)       m
///     place on the surfaces     uniform by area (inner shell and all boxes)
///     offset along the normal   N(0, 0.004) and, for one in five, + N(0, 0.03) m
///     scale, each axis          spacing * spread * exp(N(0, 0.6))              m
///     tilt of the normal        N(0, 0.15) along each tangent
///     opacity                   60 %: Beta(8, 1.5), 40 %: Beta(1.2, 3),
///                               limited to [0.006, 0.995]
///     colour                    0.5 + 0.35 sin(A p + instance) + N(0, 0.05), A_ij ~ N(0, 3)
///
/// with spacing = sqrt(area / surfel_count). The construction and its constants are those of
/// the project's Python generator; the random bits are not (numpy's generator is not
/// reproduced): boxes and surfels come from our own Philox streams, so the two scenes agree in
/// distribution, not surfel by surfel; docs/rendering.md compares them over seeds. Beta
/// variates are ratios of gamma variates, X / (X + Y) (Marsaglia & Tsang 2000, "A simple
/// method for generating gamma variables").

#include <cstdint>
#include <vector>

#include "core/camera.h"
#include "core/frames.h"
#include "renderer/scene/surfels.h"

namespace segsim::renderer {

inline constexpr int kRoomBoxes = 40;
/// Inner size of the room; its corner is the world origin, the floor is z = 0.
inline constexpr glm::dvec3 kRoomSize_m{8.0, 6.0, 2.8};
/// Clear space between neighbouring rooms.
inline constexpr double kRoomWall_m = 0.2;

/// Classes of the scene: the shell, then kRoomBoxClasses classes that boxes take in turn.
inline constexpr std::uint16_t kRoomWallClass = 1, kRoomFloorClass = 2, kRoomCeilingClass = 3;
inline constexpr std::uint16_t kRoomFirstBoxClass = 4, kRoomBoxClasses = 8;

struct RoomSceneOptions {
  int surfel_count = 1'000'000;  ///< Of one room, > 0.
  std::uint64_t seed = 7;
  double spread = 1.0;  ///< Surfel scale over surfel spacing, > 0; 1.6 is a dense scene.
  /// Rooms in all, 1 ... 1000. Every further room is another furnished room of as many
  /// surfels, laid around the first in square rings: its surfels are hidden by walls.
  int rooms = 1;
  bool features = false;  ///< Fill in the 16-D and 32-D features, one mean per instance.
};

/// A labelled scene of surfel_count * rooms surfels, of SH degree 0; the first room's surfels
/// come first and do not depend on `rooms`. Instance = 1 + box + kRoomBoxes * room for boxes,
/// 0 for the shell.
/// @throws core::ContractViolation for an option out of its range.
[[nodiscard]] SurfelCloud make_room_scene(const RoomSceneOptions& options = {});

/// Focal length 1165.7 px for a width of 1296 px (ScanNet's colour camera), principal point in
/// the middle.
[[nodiscard]] core::CameraIntrinsics room_camera(int width_px, int height_px);

/// `count` cameras on an ellipse in the first room at 1.3 m, looking across its middle.
[[nodiscard]] std::vector<core::CameraPose> room_camera_ring(int count);

}  // namespace segsim::renderer
