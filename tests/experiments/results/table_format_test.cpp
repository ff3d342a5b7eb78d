/// How a table looks as text, Markdown, LaTeX, CSV and JSON.

#include <algorithm>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "tests/experiments/results/table_fixture.h"

namespace segsim::experiments {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST(Table, TextIsAsExpected) {
  const std::string text =
      results::format_table(results::summarise(a_run(30), kScenes, kArms, ten_episodes()),
                            support::TableFormat::kText);
  const std::string expected =
      R"(Object search before and after fine-tuning (one training)

Scene   SR-Before            SR-After             Difference [points]  Pairs        p      Verdict     SR-Oracle
------  -------------------  -------------------  -------------------  -----------  -----  ----------  ----------------------
Flat *  4/10  40 % [17, 69]  8/10  80 % [49, 94]  +40 [-4, +68]        +5 -1 of 10  0.219  unresolved  10/10  100 % [72, 100]

One training: interval and p know nothing of the variance of training; another seed may give another
result.
Success rule: segsim-object.

By goal class (exploratory; p corrected by Holm for the number of rows)

Goal   SR-Before           SR-After              Difference [points]  Pairs       p (Holm)  SR-Oracle
-----  ------------------  --------------------  -------------------  ----------  --------  --------------------
chair  2/5  40 % [12, 77]  3/5  60 % [23, 88]    +20 [-36, +63]       +2 -1 of 5  1.000     5/5  100 % [57, 100]
couch  2/5  40 % [12, 77]  5/5  100 % [57, 100]  +60 [+3, +88]        +3 -0 of 5  0.500     5/5  100 % [57, 100]

How the trials went (success: segsim-object)

Scene  Arm     SR    SPL    SoftSPL  Time [s]  Path [m]  Contacts  Holes [%]  Outcomes
-----  ------  ----  -----  -------  --------  --------  --------  ---------  --------------------
Flat   before  0.40  0.200  0.000    20.0      4.0       0.00      0.0        timeout 6, success 4
Flat   after   0.80  0.400  0.000    20.0      4.0       0.00      0.0        success 8, timeout 2
Flat   oracle  1.00  0.500  0.000    20.0      4.0       0.00      0.0        success 10

After - before on the same episodes (bootstrap 95 % interval, sign-flip test)

Scene  SPL                      p SPL  Time [s]           p time  Path [m]           p path  SR over scenes [points]
-----  -----------------------  -----  -----------------  ------  -----------------  ------  -----------------------
Flat   +0.200 [+0.000, +0.400]  0.219  +0.0 [+0.0, +0.0]  1.000   +0.0 [+0.0, +0.0]  1.000   -

Detectors on held-out views of the scenes

Arm    AP50  AP    Precision  Recall  Score threshold  Views  AP50 source rooms  AP50 unseen homes
-----  ----  ----  ---------  ------  ---------------  -----  -----------------  -----------------
after  56.0  36.7  0.69       0.57    0.244            80     33.1               -
)";
  EXPECT_EQ(text.substr(0, expected.size()), expected);
  for (const char* note : {"LEAKAGE", "Fewer than 5 scenes", "seed 7",
                           "Success profile: segsim-object", "cccccccccccc"}) {
    EXPECT_THAT(text, HasSubstr(note));
  }
  EXPECT_THAT(text, Not(HasSubstr("INTERIM")));
}

TEST(Table, CausesPerceptionAndOtherRulesAreTold) {
  const std::string text = results::format_table(
      results::summarise(a_run(30), kScenes, kArms, ten_attributed_episodes()),
      support::TableFormat::kText);
  // 60 of 80 images with the goal in view were in successes (4 x 10), where 6 of 10 are
  // detected: 24 of 60.
  for (const char* part :
       {R"(Why trials failed

Scene  Arm     Failed  false_negative  never_saw_target
-----  ------  ------  --------------  ----------------
Flat   before  6/10    2               4
Flat   oracle  0/10    -               -
)",
        R"(What the detector made of the goal

Scene  Arm     Recall in view  Saw it  Never detected  Delay [ticks]  False per 100 images  False objects  Misplaced objects
-----  ------  --------------  ------  --------------  -------------  --------------------  -------------  -----------------
Flat   before  0.40            6/10    2               3.0            2.0                   0.60           1.20
Flat   oracle  0.60            10/10   0               3.0            2.0                   0.00           0.00
)",
        R"(The same trials under named success rules (SR / SPL as that rule defines it)

Scene  Arm     segsim-object  habitat-hm3d  apexnav      semexp-gibson  allenact-robothor  barn
-----  ------  -------------  ------------  -----------  -------------  -----------------  -----------
Flat   before  0.40 / 0.20    0.00 / 0.00   0.40 / 0.20  0.40 / 0.20    0.40 / 0.20        0.40 / 0.05
Flat   oracle  1.00 / 0.50    0.00 / 0.00   1.00 / 0.50  1.00 / 0.50    1.00 / 0.50        1.00 / 0.12
)"}) {
    EXPECT_THAT(text, HasSubstr(part));
  }
}

TEST(Table, JsonAndCsvAreComplete) {
  const results::ResultTable table =
      results::summarise(a_run(30), kScenes, kArms, ten_episodes());
  const nlohmann::json json =
      nlohmann::json::parse(results::format_table(table, support::TableFormat::kJson));
  EXPECT_EQ(json.at("scenes")[0].at("arms").at("after").at("successes"), 8);
  EXPECT_EQ(json.at("scenes")[0].at("leakage"), "scene");
  EXPECT_NEAR(json.at("scenes")[0].at("comparison").at("p_mcnemar_exact").get<double>(),
              0.21875, 1e-12);
  EXPECT_EQ(json.at("provenance").at("seed"), 7);

  const std::string csv = results::format_table(table, support::TableFormat::kCsv);
  std::size_t start = 0, fields = 0, lines = 0;
  while (start < csv.size()) {
    const std::size_t end = csv.find('\n', start);
    const auto commas = static_cast<std::size_t>(
        std::count(csv.begin() + static_cast<std::ptrdiff_t>(start),
                   csv.begin() + static_cast<std::ptrdiff_t>(end), ','));
    if (lines++ == 0) fields = commas;
    EXPECT_EQ(commas, fields) << csv.substr(start, end - start);
    start = end + 1;
  }
  EXPECT_EQ(lines, 1U + 3U * 3U);  // Header; scene and two classes, three arms each.
}

/// Numbers of fast kernels may be another processor's others: every format says so.
TEST(Table, FastKernelsAreTold) {
  for (const char* kernels : {"fast", "reproducible"}) {
    records::RunRow run = a_run(30);
    run.provenance["kernels"] = kernels;
    const results::ResultTable table = results::summarise(run, kScenes, kArms, ten_episodes());
    const bool fast = std::string(kernels) == "fast";
    for (const auto format : {support::TableFormat::kText, support::TableFormat::kMarkdown,
                              support::TableFormat::kLatex, support::TableFormat::kJson}) {
      const std::string text = results::format_table(table, format);
      EXPECT_THAT(text, HasSubstr(std::string(kernels) + " kernels"));
      EXPECT_EQ(text.find("Made with fast kernels") != std::string::npos, fast) << text;
    }
    const auto json =
        nlohmann::json::parse(results::format_table(table, support::TableFormat::kJson));
    EXPECT_EQ(json.at("provenance").at("kernels"), kernels);
  }
}

TEST(Table, MarkdownKeepsItsColumns) {
  const std::string text =
      results::format_table(results::summarise(a_run(30), kScenes, kArms, ten_episodes()),
                            support::TableFormat::kMarkdown);
  EXPECT_THAT(text, HasSubstr("| Scene | SR-Before | SR-After |"));
  EXPECT_THAT(text, HasSubstr("Flat \\*"));
}

TEST(Table, LatexEscapesAndAligns) {
  std::vector<records::SceneRow> scenes = kScenes;
  scenes[0].title = "Flat_1 & 50 % {x}";
  const std::string latex =
      results::format_table(results::summarise(a_run(30), scenes, kArms, ten_episodes()),
                            support::TableFormat::kLatex);
  EXPECT_THAT(latex, HasSubstr(R"(Flat\_1 \& 50 \% \{x\} *)"));
  EXPECT_THAT(latex, HasSubstr("\\toprule"));
  EXPECT_EQ(results::table_format_from("tex"), support::TableFormat::kLatex);
  EXPECT_THROW((void)results::table_format_from("latec"), core::InputError);
}

TEST(Table, FormatWords) {
  EXPECT_EQ(results::table_format_from("md"), support::TableFormat::kMarkdown);
  EXPECT_THROW((void)results::table_format_from("markdwn"), core::InputError);
}

}  // namespace
}  // namespace segsim::experiments
