// `segsim trial` as a user runs it: the shipped examples, exit codes, files.
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "segsim_process.h"
#include "tests/temporary_folder.h"

namespace {

namespace fs = std::filesystem;
using segsim::tests::expect_input_error;
using segsim::tests::ProcessOutput;
using segsim::tests::run_segsim;
using ::testing::HasSubstr;

std::string read(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

class TrialCli : public ::testing::Test {
 protected:
  /// An example with one text replaced, among copies of the files that it names.
  [[nodiscard]] fs::path changed(const std::string& example, const std::string& from,
                                 const std::string& to) const {
    std::string text = read(fs::path(SEGSIM_TRIALS) / example);
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    text.replace(at, from.size(), to);
    for (const char* part : {"trials", "budgets"}) {
      if (fs::exists(folder_ / part)) continue;
      fs::copy(fs::path(SEGSIM_TRIALS).parent_path() / part, folder_ / part,
               fs::copy_options::recursive);
    }
    const fs::path file = folder_ / "trials" / example;
    std::ofstream(file) << text;
    return file;
  }

  segsim::tests::TemporaryFolder temporary_;
  fs::path folder_ = temporary_.path();
};

TEST_F(TrialCli, TheShippedExamplesPass) {
  int examples = 0;
  for (const auto& entry : fs::directory_iterator(SEGSIM_TRIALS)) {
    if (entry.path().extension() != ".yaml") continue;
    const fs::path out = folder_ / entry.path().stem();
    const ProcessOutput run =
        run_segsim("trial run " + entry.path().string() + " -o " + out.string());
    EXPECT_EQ(run.exit_code, 0) << entry.path() << "\n" << run.text;
    EXPECT_THAT(read(out / "trial.json"), HasSubstr("\"passed\": true"));
    EXPECT_GT(fs::file_size(out / "trial.png"), 10000U);
    ++examples;
  }
  EXPECT_GE(examples, 3);
}

TEST_F(TrialCli, ExitCodes) {
  const fs::path good = fs::path(SEGSIM_TRIALS) / "drive.yaml";
  const ProcessOutput checked = run_segsim("trial check " + good.string());
  EXPECT_EQ(checked.exit_code, 0) << checked.text;
  EXPECT_THAT(checked.text, HasSubstr("expectations"));

  const fs::path strict =
      changed("drive.yaml", "metric: path_m, max: ", "metric: path_m, max: 0.");
  const fs::path out = folder_ / "strict";
  const ProcessOutput failed =
      run_segsim("trial run " + strict.string() + " -o " + out.string());
  EXPECT_EQ(failed.exit_code, 1) << failed.text;
  EXPECT_THAT(failed.text, HasSubstr("FAILS  path_m"));
  EXPECT_THAT(read(out / "trial.json"), HasSubstr("\"passed\": false"));

  const fs::path typo = changed("drive.yaml", "steps:", "stpes:");
  expect_input_error(run_segsim("trial check " + typo.string()), "drive.yaml:");
  expect_input_error(run_segsim("trial run " + (folder_ / "nothing.yaml").string()),
                     "nothing.yaml");
}

}  // namespace
