#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "reconstruction/labels/panoptic_head.h"

namespace segsim::reconstruction::internal {

/// The paper's head, and with another name and factor the heads derived from it.
/// @param warp_factor  Of the agreement with a neighbouring frame; 0 = off.
[[nodiscard]] std::unique_ptr<PanopticHead> make_query_head(
    std::string name, PanopticHeadInputs inputs, const PanopticTrainingConfig& config,
    std::uint64_t seed, double warp_factor);

/// The other heads.
[[nodiscard]] std::unique_ptr<PanopticHead> make_panoptic_splatting_head(
    PanopticHeadInputs inputs, const PanopticTrainingConfig& config, std::uint64_t seed);
[[nodiscard]] std::unique_ptr<PanopticHead> make_panoptic_lifting_head(
    PanopticHeadInputs inputs, const PanopticTrainingConfig& config, std::uint64_t seed);

[[nodiscard]] std::unique_ptr<PanopticHead> make_contrastive_lift_head(
    PanopticHeadInputs inputs, const PanopticTrainingConfig& config, std::uint64_t seed);
[[nodiscard]] std::unique_ptr<PanopticHead> make_gaussian_grouping_head(
    PanopticHeadInputs inputs, const PanopticTrainingConfig& config, std::uint64_t seed);

[[nodiscard]] std::unique_ptr<PanopticHead> make_open_gaussian_head(
    PanopticHeadInputs inputs, const PanopticTrainingConfig& config, std::uint64_t seed);

[[nodiscard]] std::unique_ptr<PanopticHead> make_panoptic_recon_head(
    PanopticHeadInputs inputs, const PanopticTrainingConfig& config, std::uint64_t seed);

[[nodiscard]] std::unique_ptr<PanopticHead> make_pvlff_head(
    PanopticHeadInputs inputs, const PanopticTrainingConfig& config, std::uint64_t seed);

}  // namespace segsim::reconstruction::internal
