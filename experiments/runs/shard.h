#pragma once

/// @file
/// Which part of a run a worker does, when many processes or machines share one
/// (docs/scale_out.md). The parts are fixed by their number alone: no worker needs to know of
/// another, and no clock decides anything.

#include <cstddef>
#include <functional>
#include <string>

namespace segsim::experiments::runs {

/// Part `index` of `count`, 0 <= index < count. Units of a run (an episode in one repetition,
/// with all arms, so that parts have whole pairs) are dealt out like cards: unit u belongs to
/// part u mod count.
struct Shard {
  int index = 0, count = 1;

  [[nodiscard]] bool has(std::size_t unit) const {
    return unit % static_cast<std::size_t>(count) == static_cast<std::size_t>(index);
  }
  /// "3/8"; "3-of-8".
  [[nodiscard]] std::string text() const;
  [[nodiscard]] std::string folder_name() const;
};

/// Value of an environment variable; nullptr if it is not set.
using Environment = std::function<const char*(const char* name)>;
[[nodiscard]] Environment process_environment();

/// From "I/N", or "auto": the first engine of this list whose variables are there with more
/// than one part, else with one.
///
///     engine                     index                      number of parts
///     Slurm, array               SLURM_ARRAY_TASK_ID        SLURM_ARRAY_TASK_COUNT, from _MIN
///     Kubernetes, indexed job    JOB_COMPLETION_INDEX       SHARD_COUNT
///     Open MPI                   OMPI_COMM_WORLD_RANK       OMPI_COMM_WORLD_SIZE
///     MPICH and others           PMI_RANK                   PMI_SIZE
///     Slurm, srun                SLURM_PROCID               SLURM_NTASKS
///     AWS Batch, array           AWS_BATCH_JOB_ARRAY_INDEX  AWS_BATCH_JOB_ARRAY_SIZE
///     PBS, array                 PBS_ARRAY_INDEX            SHARD_COUNT
///     GNU parallel               PARALLEL_SEQ, from 1       SHARD_COUNT
///
/// SHARD_COUNT holds for every engine if it is set; indices then begin at SHARD_FIRST (default
/// 0, of GNU parallel 1). So one task of an array can be run again by itself.
/// @throws core::InputError naming the variable, or if no engine is there.
[[nodiscard]] Shard shard_from(const std::string& word,
                               const Environment& environment = process_environment());

}  // namespace segsim::experiments::runs
