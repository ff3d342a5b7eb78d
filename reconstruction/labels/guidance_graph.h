#pragma once

/// @file
/// Which masks of different views show one object, by a graph of patches of surface
/// (PanopticRecon, Yu et al., IROS 2024): the cloud is cut into small smooth patches, views
/// vote for every two patches that touch whether one mask holds both, and patches that most
/// votes join are an object. Of its paper only the idea is published; numbers are this
/// project's (PanopticReconConfig).

#include <cstdint>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include <glm/vec3.hpp>

#include "core/frame_masks.h"
#include "reconstruction/labels/panoptic_config.h"

namespace segsim::reconstruction {

/// Objects have ids from 1, largest first.
struct GuidedObjects {
  /// [views], by mask id: the object that most of the mask's pixels lie on.
  std::vector<std::map<std::uint16_t, std::uint16_t>> object_of_mask;
  std::vector<std::uint16_t> class_id;  ///< [objects], of most pixels of its masks.
};

class GuidanceGraph {
 public:
  /// @param position_m, normal  [surfels]; normals are unit and may point to either side.
  GuidanceGraph(const std::vector<glm::vec3>& position_m, const std::vector<glm::vec3>& normal,
                const PanopticReconConfig& config);

  /// [surfels], -1 = of no patch.
  [[nodiscard]] const std::vector<std::int32_t>& patch_of() const { return patch_of_; }
  [[nodiscard]] std::int32_t patches() const { return patches_; }

  /// @param pixels  y * width + x.  @param surfel  [pixels], what each shows; -1 = nothing.
  void add_view(const core::FrameMasks& masks, std::span<const std::int32_t> pixels,
                std::span<const std::int64_t> surfel);

  /// Depends on nothing but the views, in their order.
  [[nodiscard]] GuidedObjects objects() const;

 private:
  using Pair = std::pair<std::int32_t, std::int32_t>;

  /// What one mask of one view shows.
  struct Mask {
    std::map<std::int32_t, std::int64_t> patches;   ///< Pixels on each; -1 = on none.
    std::map<std::uint16_t, std::int64_t> classes;  ///< Pixels of each.
    std::int64_t pixels = 0;
  };

  void grow_patches(const std::vector<glm::vec3>& position_m,
                    const std::vector<glm::vec3>& normal,
                    const std::vector<std::vector<std::int64_t>>& near);
  void find_edges(const std::vector<std::vector<std::int64_t>>& near);
  /// Object of each patch before small and rarely seen ones are left out.
  [[nodiscard]] std::vector<std::int32_t> joined_patches() const;

  PanopticReconConfig config_;
  std::vector<std::int32_t> patch_of_;
  std::int32_t patches_ = 0;
  std::map<Pair, std::int64_t> edges_;                ///< Patches that touch -> votes.
  std::vector<std::map<std::uint16_t, Mask>> views_;  ///< By mask id.
};

}  // namespace segsim::reconstruction
