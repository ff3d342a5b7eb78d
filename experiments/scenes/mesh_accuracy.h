#pragma once

/// @file
/// A collision mesh against the world that was captured: is it where the surfaces are, and can
/// the robot go where it could?

#include <cstddef>
#include <string>

#include "core/process/measurement_record.h"
#include "sim/ground/robot.h"
#include "sim/ground/triangle_mesh.h"

namespace segsim::experiments::scenes {

struct MeshAccuracyOptions {
  double spacing_m = 0.02;  ///< Of the points on the found mesh.
  double z_lo_m = 0.1;      ///< Heights that are measured: above the floor, below what no
  double z_hi_m = 1.85;     ///< robot reaches.
  double cell_m = 0.05;     ///< Of the free floor.
};

struct MeshAccuracy {
  std::size_t samples = 0;
  double mean_m = 0.0, percentile95_m = 0.0;  ///< Found surface to the nearest true one.
  std::size_t triangles = 0;                  ///< Of the found mesh.
  /// Cells of the largest island of each navigation mesh.
  std::size_t free_truth = 0, free_found = 0, free_both = 0;

  /// Of the cells that are free in either mesh, the share that are free in both.
  [[nodiscard]] double free_agreement() const;
  [[nodiscard]] double free_missed() const;    ///< Share of the truly free cells.
  [[nodiscard]] double free_invented() const;  ///< Share of the cells found free.
  [[nodiscard]] std::string text() const;
  /// @param case_name  The row, for example the bundle's name.
  [[nodiscard]] core::MeasurementRecord record(const std::string& case_name) const;
};

/// @param found, truth  In the same frame.
/// @throws core::InputError if one of them is empty or leaves no room for the robot.
[[nodiscard]] MeshAccuracy mesh_accuracy(const sim::TriangleMesh& found,
                                         const sim::TriangleMesh& truth,
                                         const sim::RobotModel& robot,
                                         const MeshAccuracyOptions& options = {});

}  // namespace segsim::experiments::scenes
