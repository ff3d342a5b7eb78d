#include "experiments/reproducibility/digest_stage.h"

#include "core/name_table.h"

namespace segsim::experiments::reproducibility {
namespace {

constexpr core::NameTable<DigestStage, DigestStage::kTrials> kNames(
    "a stage",
    {"capture", "reconstruction", "phrases", "episodes", "labels", "weights", "trials"});

}  // namespace

const char* to_string(DigestStage stage) { return kNames.name(stage); }

DigestStage digest_stage_from(std::string_view name, const std::string& place) {
  return kNames.read(name, place);
}

}  // namespace segsim::experiments::reproducibility
