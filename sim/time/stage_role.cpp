#include "sim/time/stage_role.h"

#include "core/name_table.h"

namespace segsim::sim {
namespace {

constexpr core::NameTable<StageRole, StageRole::kOther> kNames("a stage's role",
                                                               {"capture", "render", "detect",
                                                                "policy", "actuate", "other"});

}  // namespace

StageRole stage_role(std::string_view name) {
  return kNames.find(name).value_or(StageRole::kOther);
}

const char* to_string(StageRole role) { return kNames.name(role); }

}  // namespace segsim::sim
