#include "nav/value/semantic_prior.h"

#include <gtest/gtest.h>

#include "core/error.h"
#include "nav/policies/built_in_policies.h"
#include "tests/nav/test_view.h"

namespace segsim::nav {
namespace {

const char* const kSmall = R"(
schema: segsim.semantic_prior/1
sources: [made up for this test]
levels: [0.1, 0.5]
rooms: [a, b]
objects:
  x: [1, 0]
  y: [0, 1]
)";

TEST(SemanticPrior, WorkedExample) {
  const SemanticPrior prior = SemanticPrior::parse(kSmall, "small.yaml");
  EXPECT_NEAR(prior.score({}, "x"), 0.3, 1e-12);  // Mean of 0.5 and 0.1.
  // x seen for certain: P(x | a) = 0.5 / 0.6, P(x | b) = 0.1 / 0.6: a with 5/6.
  EXPECT_NEAR(prior.room_posterior({{"x", 1.0}})[0], 5.0 / 6.0, 1e-12);
  EXPECT_NEAR(prior.score({{"x", 1.0}}, "x"), 5.0 / 6.0 * 0.5 + 1.0 / 6.0 * 0.1, 1e-12);
  // With a score of 1/2: a: 5/12 + 1/4 = 2/3, b: 1/12 + 1/4 = 1/3.
  EXPECT_NEAR(prior.room_posterior({{"x", 0.5}})[0], 2.0 / 3.0, 1e-12);
  EXPECT_NEAR(prior.room_posterior({{"x", 0.0}})[0], 0.5, 1e-12);
  // Objects nobody rated say nothing; as targets they have the lowest level everywhere.
  EXPECT_NEAR(prior.room_posterior({{"unknown", 1.0}})[0], 0.5, 1e-12);
  EXPECT_NEAR(prior.score({{"x", 1.0}}, "unknown"), 0.1, 1e-12);
}

TEST(SemanticPrior, TheBuiltInOneMakesSense) {
  const SemanticPrior& prior = default_semantic_prior();
  EXPECT_EQ(prior.rooms().size(), 4U);
  for (const char* target : {"chair", "couch", "bed", "dining table", "potted plant", "tv",
                             "toilet", "refrigerator"}) {
    EXPECT_TRUE(prior.knows(target)) << target;
  }
  // What stands in the same room raises the promise, what stands elsewhere lowers it.
  const double nothing = prior.score({}, "toilet");
  EXPECT_GT(prior.score({{"bathtub", 0.9}}, "toilet"), 2.0 * nothing);
  EXPECT_LT(prior.score({{"bed", 0.9}}, "toilet"), nothing);
  EXPECT_GT(prior.score({{"couch", 0.9}}, "tv"), prior.score({{"sink", 0.9}}, "tv"));
  EXPECT_GT(prior.score({{"oven", 0.9}}, "refrigerator"), 0.5);
}

TEST(SemanticPrior, MistakesInTheFileAreNamed) {
  const auto message = [](const std::string& from, const std::string& to) {
    std::string text = kSmall;
    text.replace(text.find(from), from.size(), to);
    try {
      (void)SemanticPrior::parse(text, "small.yaml");
    } catch (const core::InputError& error) {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  EXPECT_NE(message("x: [1, 0]", "x: [1]").find("small.yaml:7"), std::string::npos);
  EXPECT_NE(message("x: [1, 0]", "x: [1, 2]").find("ratings 0 .. 1"), std::string::npos);
  EXPECT_NE(message("[0.1, 0.5]", "[0.5, 0.1]").find("ascending"), std::string::npos);
  EXPECT_NE(message("_prior/1", "_prior/2").find("schema"), std::string::npos);
  EXPECT_NE(message("rooms:", "romos:").find("small.yaml"), std::string::npos);
  EXPECT_THROW((void)SemanticPrior::load("no/such/file.yaml"), core::InputError);
}

TEST(SemanticPrior, ScorerTakesTheBestBoxOfAClass) {
  const SemanticPrior prior = SemanticPrior::parse(kSmall, "small.yaml");
  const auto scorer = make_semantic_scorer(prior, {"y", "x"});
  const test::TestView view;
  const std::vector<core::Detection> detections{
      {1, 0.2F, {}}, {1, 0.5F, {}}, {7, 0.9F, {}}, {-1, 0.9F, {}}};
  EXPECT_NEAR(scorer->score(view.observation, detections, {"x"}),
              prior.score({{"x", 0.5}}, "x"), 1e-9);
}

TEST(SemanticPrior, OtherScorers) {
  test::TestView view({}, 2.5F);
  EXPECT_EQ(make_constant_scorer(0.4)->score(view.observation, {}, {"x"}), 0.4);
  EXPECT_NEAR(make_open_space_scorer(5.0)->score(view.observation, {}, {"x"}), 0.5, 1e-6);
  test::TestView nothing({}, test::kNan);
  EXPECT_EQ(make_open_space_scorer(5.0)->score(nothing.observation, {}, {"x"}), 0.0);
}

}  // namespace
}  // namespace segsim::nav
