#include "core/stages.h"

#include "core/name_table.h"

namespace segsim::core {
namespace {

constexpr NameTable<PolicyMode, PolicyMode::kStop> kModes("a mode of the policy",
                                                          {"initialize", "explore", "navigate",
                                                           "recover", "stop"});

}  // namespace

const char* to_string(PolicyMode mode) { return kModes.name(mode); }

}  // namespace segsim::core
