#include "sim/time/stage_role.h"

#include <gtest/gtest.h>

#include "sim/time/latency_budget.h"

namespace segsim::sim {
namespace {

TEST(StageRole, FiveNamesMeanSomethingToTheProgram) {
  const std::pair<StageRole, const char*> names[] = {{StageRole::kCapture, "capture"},
                                                     {StageRole::kRender, "render"},
                                                     {StageRole::kDetect, "detect"},
                                                     {StageRole::kPolicy, "policy"},
                                                     {StageRole::kActuate, "actuate"}};
  for (const auto& [role, name] : names) {
    EXPECT_EQ(stage_role(name), role);
    EXPECT_STREQ(to_string(role), name);
    StageBudget stage;
    stage.name = name;
    EXPECT_EQ(stage.role(), role);
  }
}

TEST(StageRole, AnyOtherNameIsAStageThatOnlyTakesTime) {
  for (const char* name : {"", "segment", "Detect", "detect2", "other"}) {
    EXPECT_EQ(stage_role(name), StageRole::kOther) << name;
  }
}

}  // namespace
}  // namespace segsim::sim
