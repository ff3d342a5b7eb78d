#include "sim/trial/outcome.h"

#include <gtest/gtest.h>

#include "core/error.h"

namespace segsim::sim {
namespace {

/// Files of earlier versions have these words.
TEST(Outcome, NamesInFilesStayAndAreReadBack) {
  const std::pair<Outcome, const char*> names[] = {
      {Outcome::kSuccess, "success"},        {Outcome::kStoppedFar, "stopped_far"},
      {Outcome::kNotVisible, "not_visible"}, {Outcome::kTimeout, "timeout"},
      {Outcome::kGaveUp, "gave_up"},         {Outcome::kCollision, "collision"},
      {Outcome::kAborted, "aborted"}};
  for (const auto& [outcome, name] : names) {
    EXPECT_STREQ(to_string(outcome), name);
    EXPECT_EQ(outcome_from(name, "here"), outcome);
  }
}

TEST(Outcome, AnUnknownNameIsRefused) {
  EXPECT_THROW((void)outcome_from("succes", "here"), core::InputError);
  EXPECT_THROW((void)outcome_from("", "here"), core::InputError);
}

}  // namespace
}  // namespace segsim::sim
