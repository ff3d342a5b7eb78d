#pragma once

/// @file
/// A recorded trial (experiments/records/replay_log.h), played again into an MCAP file.

#include <cstdint>
#include <filesystem>

#include "experiments/specs/spec.h"
#include "ros/mcap/mcap_format.h"

namespace segsim::experiments::bags {

struct BagSummary {
  int messages = 0, images = 0;
  double duration_s = 0.0;  ///< Simulated.
};

/// The file appears when it is whole.
/// @param log_file  Of the trial. @param folders  Without a work folder: the one that the log
/// lies in.
/// @throws core::InputError if the trial does not happen again as it did: the file would show
/// something else than what was counted.
BagSummary record_trial(const std::filesystem::path& log_file, specs::SpecFolders folders,
                        const std::filesystem::path& output,
                        ros::mcap::Compression compression);

}  // namespace segsim::experiments::bags
