#pragma once

/// @file
/// Pictures whose rows were taken one after the other, as if all had been taken at once: then
/// lifting, training and rendering need to know nothing of it.

#include <vector>

#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::reconstruction::internal {

/// For each row, from the camera when the middle row was taken to the camera then.
/// @param time_s  Of the middle row, by the track's clock.
/// @param read_out_s  From the first row to the last; negative: rows are read from below.
/// @return Empty if the track does not reach that far.
[[nodiscard]] std::vector<CameraToCamera> row_motion(const PoseTrack& track, double time_s,
                                                     double read_out_s, int rows);

/// Moves every pixel of colour and labels to where it would be if all rows had been taken with
/// the middle one. How far it moves depends on its depth; without depth, it is taken to be as
/// far away as its neighbour to the left. Depth stays: it must already be that of the middle
/// row's time. Pixels that the picture does not show become black, void and not valid.
void straighten_rows(const std::vector<CameraToCamera>& motion,
                     const core::CameraIntrinsics& camera, RgbdFrame& frame);

}  // namespace segsim::reconstruction::internal
