// PanopticSplatting (arXiv 2503.18073) on surfels: queries with attention inside the view,
// label blending, and label warping between neighbouring frames. The first two are the query
// head as it is (a batch only holds surfels that are seen); of the third only the idea is
// published, the loss is L_warp of docs/training.md.

#include "reconstruction/labels/internal/head_list.h"

namespace segsim::reconstruction::internal {

constinit const HeadMaker kMakePanopticSplatting =
    [](PanopticHeadInputs inputs, const PanopticTrainingConfig& config, std::uint64_t seed) {
      return make_query_head("panoptic-splatting", std::move(inputs), config, seed,
                             config.loss.warp_of_ps);
    };

}  // namespace segsim::reconstruction::internal
