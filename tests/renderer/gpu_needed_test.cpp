#include "tests/renderer/cuda_minimal/gpu_needed.h"

#include <cstdlib>

#include <gtest/gtest.h>

namespace segsim::renderer {
namespace {

class GpuNeeded : public testing::Test {
 protected:
  ~GpuNeeded() override { ::unsetenv(kVariable); }

  static int exit_code(const char* value) {
    if (value == nullptr) {
      ::unsetenv(kVariable);
    } else {
      ::setenv(kVariable, value, 1);
    }
    return exit_code_without_gpu("check", "no device");
  }

  static constexpr const char* kVariable = "SEGSIM_REQUIRE_GPU";
};

TEST_F(GpuNeeded, WithoutTheVariableNothingWasChecked) {
  EXPECT_EQ(exit_code(nullptr), 2);
  EXPECT_EQ(exit_code(""), 2);
  EXPECT_EQ(exit_code("0"), 2);
}

TEST_F(GpuNeeded, WithItAMissingGpuIsAFailure) {
  EXPECT_EQ(exit_code("1"), 1);
  EXPECT_EQ(exit_code("yes"), 1);
}

}  // namespace
}  // namespace segsim::renderer
