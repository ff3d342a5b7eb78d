// Tables, comparisons, plans, exports and reports as a user asks for them.
#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/file_io.h"
#include "segsim_process.h"
#include "small_results.h"
#include "tests/temporary_folder.h"

namespace segsim::tests {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;

class ReportCli : public testing::Test {
 protected:
  void SetUp() override { write_small_results(work() / "results.sqlite"); }

  [[nodiscard]] fs::path work() const { return folder_.path() / "work"; }
  [[nodiscard]] std::string quoted(const fs::path& path) const {
    return "'" + path.string() + "'";
  }

  TemporaryFolder folder_;
};

TEST_F(ReportCli, CompareNamesTheEpisodesThatChanged) {
  const ProcessOutput text = run_segsim("compare " + quoted(work()));
  EXPECT_EQ(text.exit_code, 0) << text.text;
  EXPECT_THAT(text.text, HasSubstr("+7 -1 of 10"));
  EXPECT_THAT(text.text, HasSubstr("room/couch/9  couch  lost"));
  const ProcessOutput swapped =
      run_segsim("compare --before after --after before --format json " + quoted(work()));
  EXPECT_THAT(swapped.text, HasSubstr("\"only_after\": 1"));
  EXPECT_THAT(swapped.text, HasSubstr("\"change\": \"gained\""));
  expect_input_error(run_segsim("compare --after nothing " + quoted(work())), "arm");
  expect_input_error(run_segsim("compare --after before " + quoted(work())), "--after");
  expect_input_error(run_segsim("compare " + quoted(folder_.path() / "none")), "none");
  expect_input_error(run_segsim("compare --format html " + quoted(work())), "--format");
}

TEST_F(ReportCli, PlanHasTheReferenceValues) {
  EXPECT_THAT(run_segsim("plan --psi 0.35 --delta 0.25 --format csv").text,
              HasSubstr("0.35,0.25,0.8,42,84"));
  EXPECT_THAT(run_segsim("plan --psi 0.3 --delta 0.1 --power 0.9 --format json").text,
              HasSubstr("\"pairs\": 312"));
  expect_input_error(run_segsim("plan --psi 0.1 --delta 0.2"), "--delta");
  expect_input_error(run_segsim("plan --psi 0.1 --delta 0"), "--delta");
  EXPECT_EQ(run_segsim("plan --psi 0.1").exit_code, 2);
}

TEST_F(ReportCli, Table3WritesEveryForm) {
  const fs::path out = folder_.path() / "tables";
  const ProcessOutput run = run_segsim("table 3 --room " + quoted(work()) + " --house " +
                                       quoted(work()) + " -o " + quoted(out));
  EXPECT_EQ(run.exit_code, 0) << run.text;
  EXPECT_THAT(run.text, HasSubstr("Laboratory Room  20 %"));
  for (const char* ending : {"txt", "md", "tex", "csv", "json"}) {
    EXPECT_THAT(core::read_file(out / (std::string("table3.") + ending)), HasSubstr("Room"))
        << ending;
  }
  expect_input_error(run_segsim("table 3 --room " + quoted(folder_.path() / "none")), "none");
}

TEST_F(ReportCli, ExportAndReport) {
  const fs::path lines = folder_.path() / "t.jsonl", csv = folder_.path() / "t.csv";
  EXPECT_EQ(run_segsim("export " + quoted(work()) + " -o " + quoted(lines)).exit_code, 0);
  EXPECT_EQ(run_segsim("export " + quoted(work()) + " -o " + quoted(csv)).exit_code, 0);
  EXPECT_THAT(core::read_file(lines), HasSubstr("segsim.trials/1"));
  EXPECT_THAT(core::read_file(csv), HasSubstr("room/couch/9"));
  expect_input_error(
      run_segsim("export " + quoted(work()) + " -o " + quoted(folder_.path() / "t.parquet")),
      "--output");

  const ProcessOutput report = run_segsim("report " + quoted(work()));
  EXPECT_EQ(report.exit_code, 0) << report.text;
  EXPECT_THAT(report.text, HasSubstr("12 pages"));
  EXPECT_THAT(core::read_file(work() / "report" / "index.html"),
              HasSubstr("Cannot tell: the difference may be chance."));
  expect_input_error(run_segsim("report " + quoted(work()) + " -o " + quoted(work())), "work");
}

// segsim-light has the names of all subcommands, segsim-main the subcommands: no list may run
// ahead.
TEST(TwoPrograms, HaveTheSameHelp) {
  for (const char* words : {"--help", "table --help", "trial --help", "compare --help",
                            "plan --help", "export --help", "trial check --help"}) {
    const ProcessOutput light = run_shell(std::string(SEGSIM_BINARY) + "-light " + words);
    const ProcessOutput whole = run_shell(std::string(SEGSIM_BINARY) + "-main " + words);
    EXPECT_EQ(light.exit_code, 0) << words;
    EXPECT_EQ(light.text, whole.text) << words;
    EXPECT_EQ(run_segsim(words).text, whole.text) << words;
  }
}

// The launcher hands on what segsim-light cannot do, mistakes included.
TEST(TwoPrograms, EachGetsItsWords) {
  EXPECT_THAT(run_segsim("run --help").text, HasSubstr("--prepare-only"));
  EXPECT_THAT(run_segsim("table 1 --help").text, HasSubstr("--label-iterations"));
  EXPECT_THAT(run_segsim("table --format text 2 --help").text, HasSubstr("--surfels"));
  EXPECT_THAT(run_segsim("trial run --help").text, HasSubstr("--output"));
  EXPECT_THAT(run_segsim("--help run").text, HasSubstr("--prepare-only"));
  for (const char* words : {"", "fly", "table", "trial", "plan"}) {
    const ProcessOutput found = run_segsim(words);
    EXPECT_EQ(found.exit_code, 2) << words;
    EXPECT_EQ(found.text, run_shell(std::string(SEGSIM_BINARY) + "-main " + words).text);
  }
  // Who starts segsim-light by hand is told so.
  EXPECT_EQ(run_shell(std::string(SEGSIM_BINARY) + "-light run x").exit_code, 3);
}

}  // namespace
}  // namespace segsim::tests
