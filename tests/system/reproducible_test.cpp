// Equal bits whatever the number of cores, the shell's settings and the processor.
#include "segsim_process.h"
#include "tests/temporary_folder.h"

namespace segsim::tests {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

const std::string kSpec = std::string(SEGSIM_DIGESTS) + "/small.yaml";
const std::string kRecord = std::string(SEGSIM_DIGESTS) + "/small.json";

ProcessOutput run_small(const TemporaryFolder& folder, const std::string& before = {},
                        const std::string& flags = {}) {
  return run_shell(before + " " + SEGSIM_BINARY + " run '" + kSpec + "' --work '" +
                   (folder.path() / "work").string() + "' " + flags);
}

ProcessOutput doctor(const TemporaryFolder& folder, const std::string& against) {
  return run_segsim("doctor --digests '" + (folder.path() / "work").string() +
                    "' --against '" + against + "'");
}

/// The record was made with two cores; here all libraries believe in 16.
TEST(Reproducible, EveryStageIsAsRecordedWhateverTheNumberOfCores) {
  const TemporaryFolder folder;
  const ProcessOutput run = run_small(
      folder, "ASAN_OPTIONS=\"$ASAN_OPTIONS:verify_asan_link_order=0\" LD_PRELOAD='" +
                  std::string(SEGSIM_MANY_CORES) + "'");
  ASSERT_EQ(run.exit_code, 0) << run.text;
  EXPECT_THAT(run.text, HasSubstr("Digests of the stages (reproducible kernels"));
  const ProcessOutput comparison = doctor(folder, kRecord);
  EXPECT_EQ(comparison.exit_code, 0) << comparison.text;
  EXPECT_THAT(comparison.text, HasSubstr("All stages are equal"));
}

TEST(Reproducible, OneCoreAndAShellWithOtherSettingsMakeTheSame) {
  const TemporaryFolder folder;
  const ProcessOutput run = run_small(folder,
                                      "OPENBLAS_CORETYPE=SkylakeX ATEN_CPU_CAPABILITY=default "
                                      "OMP_NUM_THREADS=7 MKL_NUM_THREADS=7 "
                                      "taskset -c 0",
                                      "--workers 1");
  ASSERT_EQ(run.exit_code, 0) << run.text;
  const ProcessOutput comparison = doctor(folder, kRecord);
  EXPECT_EQ(comparison.exit_code, 0) << comparison.text;
}

TEST(Reproducible, FastKernelsSayWhatTheyAre) {
  const TemporaryFolder folder;
  const ProcessOutput run = run_small(folder, "", "--fast --prepare-only");
  ASSERT_EQ(run.exit_code, 0) << run.text;
  EXPECT_THAT(run.text, HasSubstr("(fast kernels"));
  const ProcessOutput comparison = doctor(folder, kRecord);
  EXPECT_EQ(comparison.exit_code, 1);
  EXPECT_THAT(comparison.text, HasSubstr("trials: missing"));
  EXPECT_THAT(comparison.text, HasSubstr("kernels is: recorded reproducible, here fast"));
}

TEST(Doctor, TellsWhatThisMachineComputesWith) {
  const ProcessOutput held = run_segsim("doctor"), fast = run_segsim("doctor --fast");
  EXPECT_EQ(held.exit_code, 0);
  EXPECT_THAT(held.text, HasSubstr("reproducible kernels"));
  EXPECT_THAT(held.text, HasSubstr("gradients of convolutions (oneDNN)"));
  EXPECT_THAT(fast.text, HasSubstr("fast kernels"));
  EXPECT_THAT(fast.text, Not(HasSubstr("reproducible")));
}

}  // namespace
}  // namespace segsim::tests
