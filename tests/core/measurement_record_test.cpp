#include "core/process/measurement_record.h"

#include <cmath>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/check.h"
#include "core/version.h"

namespace segsim::core {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST(MeasurementRecord, SaysWhatWasMeasuredWhereAndWithWhat) {
  const MeasurementRecord record{
      "Frames \"of\" a room",
      false,
      {{"small", "median", "ms", 3.5,
        MeasurementGoal{MeasurementGoal::Kind::kAtMost, 4.0, {}}},
       {"", "images/s", "", 8162.25,
        MeasurementGoal{MeasurementGoal::Kind::kAtLeast, 8000.0, 16000.0}},
       {"", "found", "%", 50.0, {}, std::pair{37.5, 62.5}}}};
  const std::string text = record_text(record);
  EXPECT_THAT(text, HasSubstr(R"("schema": "segsim.record/1")"));
  EXPECT_THAT(text, HasSubstr(R"("title": "Frames \"of\" a room")"));
  EXPECT_THAT(text, HasSubstr(R"("command": "core_measurement_record_test)"));
  EXPECT_THAT(text, HasSubstr("\"processor\": \"" + processor_name() + "\", \"cores\": "));
  EXPECT_THAT(text, HasSubstr("\"gpu\": null}"));
  EXPECT_THAT(text,
              HasSubstr(R"({"case": "small", "name": "median", "unit": "ms", "value": 3.5, )"
                        R"("goal": {"at_most": 4}},)"));
  EXPECT_THAT(text, HasSubstr(R"({"name": "images/s", "unit": "", "value": 8162.25, )"
                              R"("goal": {"at_least": 8000, "aim": 16000}})"));
  EXPECT_THAT(text, HasSubstr(R"({"name": "found", "unit": "%", "value": 50, )"
                              R"("interval95": [37.5, 62.5]})"));
  const auto commit = commit_of(version());
  EXPECT_THAT(text, HasSubstr(commit ? "\"commit\": \"" + *commit + "\""
                                     : std::string("\"commit\": null")));
  EXPECT_THAT(text,
              testing::ContainsRegex("\"date\": \"20[0-9][0-9]-[0-9][0-9]-[0-9][0-9]\""));
}

TEST(MeasurementRecord, RefusesWhatNobodyMeasured) {
  EXPECT_THROW(static_cast<void>(record_text({"empty", false, {}})), ContractViolation);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(static_cast<void>(record_text({"", false, {{"", "time", "ms", nan}}})),
               ContractViolation);
}

TEST(MeasurementRecord, CommandIsWhatOneWouldTypeAgain) {
  EXPECT_EQ(command_line({"/build/experiments/segsim", "bench", "render", "--record",
                          "new.json", "--views", "3"}),
            "segsim bench render --views 3");
  EXPECT_EQ(command_line({"nav_bench", "--record=a.json", "--benchmark_filter=A|B"}),
            "nav_bench '--benchmark_filter=A|B'");
  EXPECT_EQ(command_line({"p", "it's", ""}), R"(p 'it'\''s' '')");
  EXPECT_THAT(command_line(), Not(HasSubstr("/core_measurement_record_test")));
}

TEST(MeasurementRecord, CommitIsThatOfTheBuild) {
  EXPECT_EQ(commit_of("0.1.0 (3f2c1ab)"), "3f2c1ab");
  EXPECT_EQ(commit_of("0.1.0 (3f2c1ab-dirty)"), "3f2c1ab-dirty");
  EXPECT_EQ(commit_of("0.1.0 (no git)"), std::nullopt);
  EXPECT_EQ(commit_of("0.1.0"), std::nullopt);
}

}  // namespace
}  // namespace segsim::core
