#include "sim/ground/internal/navmesh_tile.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>

#include <recastnavigation/DetourCommon.h>
#include <recastnavigation/DetourNavMesh.h>

#include "core/error.h"
#include "core/input/bounds.h"

namespace segsim::sim::internal {
namespace {

/// The block, whose parts lie one after another, each at a multiple of four bytes
/// (dtNavMesh::addTile).
class Tile {
 public:
  Tile(std::span<const unsigned char> block, std::string place)
      : block_(block), place_(std::move(place)) {
    require(block.size() >= sizeof header_, "a header", "a shorter block");
    std::memcpy(&header_, block.data(), sizeof header_);
  }

  void check() {
    check_header();
    lay_out();
    check_vertices();
    for (std::int64_t i = 0; i < header_.polyCount; ++i) check_polygon(i);
    for (std::int64_t i = 0; i < header_.bvNodeCount; ++i) check_node(i);
  }

 private:
  void require(bool holds, const std::string& expected, const std::string& found) const {
    if (!holds) {
      throw core::InputError::expected(place_, "a navigation mesh with " + expected, found);
    }
  }
  void require(bool holds, const std::string& expected, std::int64_t found) const {
    require(holds, expected, std::to_string(found));
  }

  void check_header() const {
    require(header_.magic == DT_NAVMESH_MAGIC, "the mark of Detour", "another");
    require(header_.version == DT_NAVMESH_VERSION,
            "version " + std::to_string(DT_NAVMESH_VERSION), header_.version);
    require(header_.polyCount >= 1, "polygons", header_.polyCount);
    require(header_.vertCount >= 3, "vertices", header_.vertCount);
    require(header_.maxLinkCount >= 1, "links", header_.maxLinkCount);
    require(header_.detailMeshCount == header_.polyCount, "heights of every polygon",
            header_.detailMeshCount);
    require(header_.detailVertCount >= 0 && header_.detailTriCount >= 0 &&
                header_.bvNodeCount >= 0,
            "counts from 0", "a negative one");
    require(header_.offMeshConCount == 0, "no jumps", header_.offMeshConCount);
    require(std::isfinite(header_.bvQuantFactor) && header_.bvQuantFactor > 0.0F,
            "a step of its boxes above 0", "another");
    // Detour looks into every tile of this size that a query touches: it must not be tiny.
    constexpr float kLeastSide_m = 0.01F;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float low = header_.bmin[axis], high = header_.bmax[axis];
      require(core::within_world(low) && core::within_world(high) && low <= high &&
                  (axis == 1 || high - low >= kLeastSide_m),
              "bounds that hold something",
              std::to_string(low) + " ... " + std::to_string(high));
    }
  }

  template <class Part>
  std::size_t part_of(std::int64_t count, std::size_t& at) const {
    const std::size_t begin = at;
    // Counts are below 2^31 and parts below 2^7 bytes, so nothing overflows.
    at += (static_cast<std::size_t>(count) * sizeof(Part) + 3U) / 4U * 4U;
    return begin;
  }

  void lay_out() {
    std::size_t at = (sizeof(dtMeshHeader) + 3U) / 4U * 4U;
    vertices_ = part_of<std::array<float, 3>>(header_.vertCount, at);
    polygons_ = part_of<dtPoly>(header_.polyCount, at);
    static_cast<void>(part_of<dtLink>(header_.maxLinkCount, at));  // Detour fills them in.
    details_ = part_of<dtPolyDetail>(header_.detailMeshCount, at);
    detail_vertices_ = part_of<std::array<float, 3>>(header_.detailVertCount, at);
    detail_triangles_ = part_of<std::array<unsigned char, 4>>(header_.detailTriCount, at);
    nodes_ = part_of<dtBVNode>(header_.bvNodeCount, at);
    require(at == block_.size(), std::to_string(at) + " bytes, as its counts say",
            static_cast<std::int64_t>(block_.size()));
  }

  template <class Item>
  [[nodiscard]] Item item(std::size_t begin, std::int64_t index) const {
    Item item;
    std::memcpy(&item, block_.data() + begin + static_cast<std::size_t>(index) * sizeof item,
                sizeof item);
    return item;
  }

  /// A damaged number may be finite and still send a path out of the house.
  [[nodiscard]] bool is_inside(const std::array<float, 3>& p_m) const {
    constexpr float kSlack_m = 1.0F;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (!(p_m[axis] >= header_.bmin[axis] - kSlack_m &&
            p_m[axis] <= header_.bmax[axis] + kSlack_m)) {
        return false;
      }
    }
    return true;
  }

  void check_vertices() const {
    for (std::int64_t i = 0; i < header_.vertCount; ++i) {
      require(is_inside(item<std::array<float, 3>>(vertices_, i)),
              "vertices inside its bounds", "vertex " + std::to_string(i));
    }
    for (std::int64_t i = 0; i < header_.detailVertCount; ++i) {
      require(is_inside(item<std::array<float, 3>>(detail_vertices_, i)),
              "heights inside its bounds", "height " + std::to_string(i));
    }
  }

  void check_polygon(std::int64_t index) const {
    const auto polygon = item<dtPoly>(polygons_, index);
    const std::string found = "polygon " + std::to_string(index);
    require(polygon.getType() == DT_POLYTYPE_GROUND, "ground only", found);
    require(polygon.vertCount >= 3 && polygon.vertCount <= DT_VERTS_PER_POLYGON,
            "polygons of 3 to 6 corners", found);
    for (std::size_t k = 0; k < polygon.vertCount; ++k) {
      require(polygon.verts[k] < header_.vertCount, "corners that are vertices", found);
      // Detour itself leaves out edges to other tiles, of which there are none.
      const unsigned short other = polygon.neis[k];
      require((other & DT_EXT_LINK) != 0 || other <= header_.polyCount,
              "neighbours that are polygons", found);
    }
    check_heights(item<dtPolyDetail>(details_, index), polygon.vertCount, found);
  }

  void check_heights(const dtPolyDetail& detail, int corners, const std::string& found) const {
    require(std::int64_t{detail.vertBase} + detail.vertCount <= header_.detailVertCount &&
                std::int64_t{detail.triBase} + detail.triCount <= header_.detailTriCount,
            "heights that lie in the file", found);
    bool has_edge = false;
    for (std::int64_t k = 0; k < detail.triCount; ++k) {
      const auto triangle = item<std::array<unsigned char, 4>>(
          detail_triangles_, std::int64_t{detail.triBase} + k);
      for (std::size_t corner = 0; corner < 3; ++corner) {
        require(triangle[corner] < corners + detail.vertCount,
                "triangles of a polygon's own corners", found);
      }
      for (int edge = 0; edge < 3; ++edge) {
        has_edge = has_edge ||
                   (dtGetDetailTriEdgeFlags(triangle[3], edge) & DT_DETAIL_EDGE_BOUNDARY) != 0;
      }
    }
    // Detour takes the nearest point of the boundary without asking whether there is one.
    require(has_edge, "a boundary of every polygon", found);
  }

  void check_node(std::int64_t index) const {
    const std::int64_t i = item<dtBVNode>(nodes_, index).i;
    const bool fits = i >= 0 ? i < header_.polyCount : -i <= header_.bvNodeCount - index;
    require(fits, "boxes of polygons", "box " + std::to_string(index));
  }

  std::span<const unsigned char> block_;
  std::string place_;
  dtMeshHeader header_{};
  std::size_t vertices_ = 0, polygons_ = 0, details_ = 0, detail_vertices_ = 0,
              detail_triangles_ = 0, nodes_ = 0;
};

}  // namespace

void check_navmesh_tile(std::span<const unsigned char> block, const std::string& place) {
  Tile(block, place).check();
}

}  // namespace segsim::sim::internal
