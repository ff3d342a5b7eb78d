#pragma once

/// @file
/// Where the robot's centre may be: obstacles inflated by its circumscribed circle, with a
/// soft cost beyond. Distances come from an exact Euclidean transform between cell centres.
///
/// build() computes everything; update() only what a change of the map can have changed (the
/// changed cells, the reach of an obstacle around them, and the small unknown pockets that
/// touch those), with equal results. Nothing is known beyond the active part of the frame, in
/// which all observed cells lie: cells outside are neither traversable nor clear.

#include <span>

#include "nav/grid/grid_layer.h"
#include "nav/mapping/occupancy_map.h"
#include "nav/planning/clearance_field.h"

namespace segsim::nav {

struct CostMapOptions {
  double robot_radius_m = 0.33;  ///< Circumscribed circle of the Jackal (0.508 x 0.430 m).
  double margin_m = 0.02;        ///< Added to the radius.
  double mast_radius_m = 0.10;   ///< The mast keeps this distance from table tops.
  /// Unknown pockets below this area, counted where the robot's centre fits, are taken as
  /// free: the camera cannot see the floor near the robot. VLFM fills 1.5 m2 with an inflation
  /// of 0.15 m; with 0.35 m a small bathroom has less than that.
  double fill_pocket_m2 = 0.5;
  double soft_distance_m = 0.65;  ///< Obstacles nearer than this cost extra ...
  double soft_weight = 4.0;  ///< ... up to this multiple of the length, at the inflated edge.
  /// Take everything unknown as free (the "free-space assumption" of Koenig and Likhachev), at
  /// `unknown_cost` times the length: where to go when the known way does not lead there.
  bool cross_unknown = false;
  double unknown_cost = 2.0;

  bool operator==(const CostMapOptions&) const = default;
};

/// The same for places where the robot fits only just: inflated by at most `radius_m`, without
/// a margin.
[[nodiscard]] CostMapOptions tightened(CostMapOptions options, double radius_m);

class CostMap {
 public:
  /// Farther obstacles are reported as being at 1e6 m.
  static constexpr double kReach_m = 1.0;

  /// Computes everything from the observed part of the map (and some cells around it, the
  /// active part). Cost linear in cells.
  void build(const OccupancyMap& map, const CostMapOptions& options);
  /// Builds from hand-made states (tests, other map sources). @param mast  Empty or equal
  /// size.
  void build(const GridFrame& frame, const GridView<CellState>& body,
             const GridView<std::uint8_t>& mast, const CostMapOptions& options);
  /// Ends like build(map, options), if what is here came from an earlier state of the same
  /// map. Changed options mean building anew. @param changed  Holds every cell of the map that
  /// changed since, in its frame of now.
  void update(const OccupancyMap& map, const CellBox& changed, const CostMapOptions& options);
  /// The same for layers of occupied cells, explored cells (free unless occupied) and cells
  /// only the mast hits (may be empty). @param active  Holds all cells that are set. The map's
  /// own frame is the part around them.
  void update(const GridFrame& frame, const GridView<std::uint8_t>& occupied,
              const GridView<std::uint8_t>& explored, const GridView<std::uint8_t>& mast,
              const CellBox& active, const CellBox& changed, const CostMapOptions& options);

  [[nodiscard]] const GridFrame& frame() const { return frame_; }
  /// Where anything may be known; inside of the frame.
  [[nodiscard]] const CellBox& active() const { return active_; }
  [[nodiscard]] const CostMapOptions& options() const { return options_; }
  [[nodiscard]] CellState state(const Cell& cell) const;
  /// Free (or in a small unknown pocket) and far enough from obstacles; false outside of the
  /// active part.
  [[nodiscard]] bool traversable(const Cell& cell) const;
  /// Not occupied, far enough from obstacles, seen or not; false outside of the active part.
  [[nodiscard]] bool clear(const Cell& cell) const;
  /// To the nearest occupied cell (body layer) [m]; large if there is none within kReach_m.
  [[nodiscard]] float clearance_m(const Cell& cell) const;
  /// To the nearest thing that only the mast can hit [m]; large if there is none within reach.
  [[nodiscard]] float mast_clearance_m(const Cell& cell) const;
  /// Multiple of the length that a traversable cell costs, >= 1.
  [[nodiscard]] float length_cost(const Cell& cell) const;

  [[nodiscard]] const GridLayer<CellState>& states() const { return states_; }
  /// 1 where traversable() holds.
  [[nodiscard]] const GridLayer<std::uint8_t>& traversable_cells() const {
    return traversable_;
  }
  /// 1 where clear() holds.
  [[nodiscard]] const GridLayer<std::uint8_t>& clear_cells() const { return clear_; }
  /// length_cost() of every cell.
  [[nodiscard]] const GridLayer<float>& length_costs() const { return cost_; }

 private:
  /// Empties the map.
  void start(const GridFrame& frame, const CostMapOptions& options);
  /// Grows to a frame that is the old one with whole cells added, or starts anew.
  /// @return  What has to be read: `changed`, or everything.
  CellBox follow(const GridFrame& frame, const CellBox& changed,
                 const CostMapOptions& options);
  void make_tables();
  /// Takes a row of cells, from (i0, j) on; notes what differs from the old ones.
  void take_row(int j, int i0, std::span<const CellState> states,
                std::span<const std::uint8_t> mast);
  void set_active(const CellBox& active);
  /// Computes anew what depends on the noted changes.
  void finish();
  void combine_row(int j, int i0, int i1);
  void fill_pockets(const CellBox& around);
  void visit_pocket(std::ptrdiff_t seed);
  void empty_pockets_in_queue();
  [[nodiscard]] bool may_be_pocket(std::ptrdiff_t index) const {
    return states_.plane()[index] == CellState::kUnknown && clear_.plane()[index] != 0;
  }

  GridFrame frame_;
  CostMapOptions options_;
  CellBox active_;
  CellBox changed_;                      ///< Cells whose state changed.
  CellBox body_changed_, mast_changed_;  ///< Where sources of the two fields changed.
  std::vector<CellBox> added_;           ///< New parts of the frame,
  std::vector<CellBox> dirty_;           ///< of the active part.
  GridLayer<CellState> states_;
  GridLayer<std::uint8_t> occupied_, mast_;  ///< Sources of the two fields.
  ClearanceField body_field_, mast_field_;
  GridLayer<std::uint8_t> traversable_, clear_, pocket_;
  GridLayer<float> cost_;
  /// By squared distance in cells: metres; cost; 1 where the body, the mast has room.
  std::vector<float> clearance_table_m_, cost_table_;
  std::vector<std::uint8_t> room_table_, mast_room_table_;
  /// An obstacle farther away than so many cells changes neither room nor cost.
  int body_influence_cells_ = 0, mast_influence_cells_ = 0;
  GridLayer<std::uint32_t> visited_;  ///< Scratch: visit_, or visit_ + 1 in a large pocket.
  std::uint32_t visit_ = 0;
  std::vector<std::ptrdiff_t> queue_;  ///< Indices in the plane, of a pocket.
};

/// Distance from each cell centre to the nearest cell centre where `sources` is not 0 [m];
/// 1e6 everywhere if there is none.
[[nodiscard]] core::Image<float> distance_to_cells_m(const core::Image<std::uint8_t>& sources,
                                                     double resolution_m);

}  // namespace segsim::nav
