#pragma once

/// @file
/// How far beside the free space a robot may stand when its way to the goal is measured.

namespace segsim::sim {

/// A base that is free may stand up to (circumscribed - inscribed radius) outside the free
/// space of a disc; plus a cell. Far less than the thickness of two radii that separates
/// rooms.
inline constexpr double kGoalSnap_m = 0.30;

}  // namespace segsim::sim
