#pragma once

/// @file
/// SHA-256 of what each stage of an experiment has made, so that two machines can be compared
/// stage by stage (docs/reproducibility.md).

#include <filesystem>
#include <string>
#include <vector>

#include "experiments/reproducibility/digest_stage.h"
#include "experiments/reproducibility/machine_record.h"

namespace segsim::experiments::reproducibility {

struct StageDigest {
  DigestStage stage = DigestStage::kCapture;
  std::string subject;  ///< Of which scene, view set or arm; empty of the trials.
  std::string sha256;
};

/// The stages of one run in their order, and where they were made.
struct DigestRecord {
  static constexpr const char* kSchema = "segsim.digests/1";

  std::string experiment;   ///< Name of the spec.
  std::string spec_sha256;  ///< Another spec may have other digests.
  std::string program;      ///< Version and commit.
  MachineRecord machine;
  /// Processors of all machines that made equal digests; that of `machine` is the first.
  std::vector<std::string> confirmed_on;
  std::vector<StageDigest> stages;
};

/// Digests of what lies in a work folder. They cover what was computed, not in which folder,
/// when, or by which commit: manifests and headers that name those are left out.
/// @param bundles  Of the scenes.  @param results_sha256  Of the trials (results_digest.h);
/// empty while some are missing.
[[nodiscard]] std::vector<StageDigest> digest_stages(
    const std::filesystem::path& work, const std::vector<std::filesystem::path>& bundles,
    const std::string& results_sha256);

void write_digests(const std::filesystem::path& file, const DigestRecord& record);
/// @throws core::InputError if the file is no such record.
[[nodiscard]] DigestRecord read_digests(const std::filesystem::path& file);

/// A line for each stage, with the first digits of its digest.
[[nodiscard]] std::string digests_in_words(const std::vector<StageDigest>& stages);

/// What `run` says for the record `file`: a new record if there is none yet; another processor
/// on its list if all stages are equal.
/// @throws core::CheckFailed if a stage differs: the file stays as it is.
void record_digests(const std::filesystem::path& file, const DigestRecord& run);

struct DigestComparison {
  bool equal = true;
  std::string text;  ///< For people: each stage, the first that differs, and what may be why.
};
/// @param recorded  What is expected.  @param found  What this or another machine made.
[[nodiscard]] DigestComparison compare_digests(const DigestRecord& recorded,
                                               const DigestRecord& found);

}  // namespace segsim::experiments::reproducibility
