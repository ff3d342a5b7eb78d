#include "core/process/kernel_choice.h"

#include <cstdlib>
#include <cstring>

#include <gtest/gtest.h>

namespace segsim::core {
namespace {

TEST(KernelChoice, HoldsOnlyWhileEverySettingHasItsValue) {
  set_environment(KernelChoice::kReproducible);
  EXPECT_EQ(kernel_choice(), KernelChoice::kReproducible);
  for (const LibrarySetting& setting : reproducible_settings()) {
    EXPECT_STREQ(std::getenv(setting.variable), setting.value);
    setenv(setting.variable, "something else", 1);
    EXPECT_EQ(kernel_choice(), KernelChoice::kFast) << setting.variable;
    set_environment(KernelChoice::kReproducible);  // Overrules what the shell says.
    EXPECT_EQ(kernel_choice(), KernelChoice::kReproducible);
  }
  set_environment(KernelChoice::kFast);
  EXPECT_EQ(kernel_choice(), KernelChoice::kFast);
}

TEST(KernelChoice, FastLeavesTheUsersSettingsAlone) {
  setenv("OPENBLAS_CORETYPE", "Zen", 1);
  set_environment(KernelChoice::kFast);
  EXPECT_STREQ(std::getenv("OPENBLAS_CORETYPE"), "Zen");
}

}  // namespace
}  // namespace segsim::core
