// Fine-tuning that is stopped and killed: the same command goes on, and the weights are those
// of an undisturbed one.
#include <chrono>
#include <csignal>
#include <filesystem>
#include <string>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/file_io.h"
#include "segsim_process.h"
#include "tests/experiments/start_weights.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/experiments/tiny_spec.h"
#include "tests/system/gazebo_processes.h"
#include "tests/temporary_folder.h"

namespace segsim::tests {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;
using Clock = std::chrono::steady_clock;

constexpr double kPatience_s = 300.0;

class StopCli : public testing::Test {
 protected:
  StopCli() { experiments::write_start_weights(folder_.path()); }

  [[nodiscard]] std::string at(const std::string& name) const {
    return "'" + (folder_.path() / name).string() + "'";
  }
  /// Begins `segsim`, and once `state` has been written anew, sends a signal.
  /// @return  Exit code; 128 + signal.
  int signalled(const std::string& arguments, const fs::path& state, int signal) {
    const fs::file_time_type old = time_of(state);
    Process process({"/bin/sh", "-c", "exec " + std::string(SEGSIM_BINARY) + arguments}, "",
                    folder_.path() / "log");
    const auto end = Clock::now() + std::chrono::duration<double>(kPatience_s);
    while (time_of(state) == old && process.running() && Clock::now() < end) {
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    process.send(signal);
    const int code = process.wait(kPatience_s);
    said_ = process.output();
    return code;
  }
  static fs::file_time_type time_of(const fs::path& file) {
    std::error_code error;
    const auto time = fs::last_write_time(file, error);
    return error ? fs::file_time_type{} : time;
  }

  TemporaryFolder folder_{"stop_cli"};
  std::string said_;
};

TEST_F(StopCli, DetectorFinetuneGoesOn) {
  const auto finetune = [&](const std::string& out) {
    return " detector finetune --from " + at("start.weights") + " --train " + at("far.json") +
           " --out " + at(out) + " --steps 500 --batch 2 --threads 1";
  };
  const fs::path state = folder_.path() / "disturbed.weights.state";
  ASSERT_EQ(signalled(finetune("disturbed.weights"), state, SIGKILL), 128 + SIGKILL) << said_;
  ASSERT_EQ(signalled(finetune("disturbed.weights"), state, SIGTERM), 4) << said_;
  EXPECT_THAT(said_, HasSubstr("stopped by a signal; step "));
  ASSERT_EQ(signalled(finetune("disturbed.weights"), state, SIGINT), 4) << said_;
  EXPECT_FALSE(fs::exists(folder_.path() / "disturbed.weights"));
  for (const char* out : {"disturbed.weights", "whole.weights"}) {
    const ProcessOutput run = run_segsim(finetune(out));
    EXPECT_EQ(run.exit_code, 0) << run.text;
  }
  EXPECT_EQ(core::sha256_of_file(folder_.path() / "disturbed.weights"),
            core::sha256_of_file(folder_.path() / "whole.weights"));
  EXPECT_FALSE(fs::exists(state));
}

TEST_F(StopCli, FineTuningOfARunGoesOn) {
  (void)experiments::TinyScene().write(folder_.path() / "tiny");
  const experiments::TinySpec spec{.arms = R"(  - {name: before, detector: before}
  - {name: after, detector: after}
)",
                                   .more = R"(detectors:
  before: ${data}/start.weights
  after: ${work}/after.weights
  finetune: {views_per_scene: 6, validation_views_per_scene: 4, steps: 400, measure_elsewhere: false}
)"};
  folder_.write("tiny.yaml", spec.text());
  const auto run = [&](const std::string& work) {
    return " run " + at("tiny.yaml") + " --data '" + folder_.path().string() + "' --work " +
           at(work) + " --prepare-only";
  };
  const fs::path state = folder_.path() / "disturbed/after.weights.state";
  ASSERT_EQ(signalled(run("disturbed"), state, SIGTERM), 4) << said_;
  EXPECT_THAT(said_, HasSubstr("the same command goes on"));
  ASSERT_EQ(signalled(run("disturbed"), state, SIGKILL), 128 + SIGKILL) << said_;
  for (const char* work : {"disturbed", "whole"}) {
    const ProcessOutput ended = run_segsim(run(work));
    EXPECT_EQ(ended.exit_code, 0) << ended.text;
  }
  EXPECT_EQ(core::sha256_of_file(folder_.path() / "disturbed/after.weights"),
            core::sha256_of_file(folder_.path() / "whole/after.weights"));
  EXPECT_FALSE(fs::exists(state));
}

/// Libraries that cannot have their buffers ask for ever, before main().
TEST(LittleMemory, IsOneLine) {
  const std::string heavy = " render nosuch --view 0 --out nosuch.png";
  for (const char* limit : {"ulimit -v 950000", "ulimit -v 1000000", "ulimit -d 200000"}) {
    const ProcessOutput run =
        run_shell(std::string(limit) + "; timeout 20 " + SEGSIM_BINARY + heavy);
    EXPECT_EQ(run.exit_code, 2) << run.text;
    EXPECT_THAT(run.text, HasSubstr("segsim: expected at least ")) << limit;
    EXPECT_THAT(run.text, HasSubstr(" MB of ")) << limit;
  }
  const ProcessOutput light =
      run_shell("ulimit -v 300000; timeout 20 " + std::string(SEGSIM_BINARY) + " suite list");
  EXPECT_EQ(light.exit_code, 2) << light.text;
  const ProcessOutput enough =
      run_shell("ulimit -v 1600000; timeout 60 " + std::string(SEGSIM_BINARY) + heavy);
  expect_input_error(enough, "nosuch");  // It starts, and looks for the scene.
  EXPECT_THAT(enough.text, Not(HasSubstr(" MB of ")));
}

/// What is redirected ends in files that others read.
TEST(Token, IsNotInRedirectedOutput) {
  const TemporaryFolder folder("token");
  const std::string serve = "timeout -s INT 10 " + std::string(SEGSIM_BINARY) + " serve '" +
                            folder.path().string() + "' --port 0 ";
  const std::string token = "correct-horse-battery-staple";
  const ProcessOutput own = run_shell("SEGSIM_TOKEN=" + token + " " + serve);
  EXPECT_THAT(own.text, HasSubstr("http://127.0.0.1:"));
  EXPECT_THAT(own.text, Not(HasSubstr(token)));
  const ProcessOutput made_up = run_shell(serve + "--host 0.0.0.0");
  expect_input_error(made_up, "--token");
  EXPECT_THAT(made_up.text, Not(HasSubstr("?token=")));
}

}  // namespace
}  // namespace segsim::tests
