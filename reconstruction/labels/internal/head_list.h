#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "reconstruction/labels/panoptic_head.h"

namespace segsim::reconstruction::internal {

using HeadMaker = std::unique_ptr<PanopticHead> (*)(PanopticHeadInputs inputs,
                                                    const PanopticTrainingConfig& config,
                                                    std::uint64_t seed);

template <class Head>
[[nodiscard]] std::unique_ptr<PanopticHead> make_head(PanopticHeadInputs inputs,
                                                      const PanopticTrainingConfig& config,
                                                      std::uint64_t seed) {
  return std::make_unique<Head>(std::move(inputs), config, seed);
}

/// The paper's head, and with another name and factor the heads derived from it.
/// @param warp_factor  Of the agreement with a neighbouring frame; 0 = off.
[[nodiscard]] std::unique_ptr<PanopticHead> make_query_head(
    std::string name, PanopticHeadInputs inputs, const PanopticTrainingConfig& config,
    std::uint64_t seed, double warp_factor);

/// One for each file of heads/; the query head has the first two.
extern const HeadMaker kMakeQuery, kMakePanopticSplatting, kMakePanopticLifting,
    kMakeContrastiveLift, kMakeGaussianGrouping, kMakeOpenGaussian, kMakePanopticRecon,
    kMakePanopticReconPlus, kMakePvlff;

}  // namespace segsim::reconstruction::internal
