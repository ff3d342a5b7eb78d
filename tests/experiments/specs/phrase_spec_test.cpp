#include <fstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "experiments/specs/spec.h"
#include "tests/error_message.h"
#include "tests/experiments/tiny_spec.h"
#include "tests/temporary_folder.h"

namespace segsim::experiments {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

class PhraseSpecTest : public testing::Test {
 protected:
  PhraseSpecTest() { std::ofstream(folder_ / "clip.yaml") << "schema: segsim.model/1\n"; }

  specs::ExperimentSpec parse(const std::string& text) const {
    specs::SpecFolders folders{folder_.path(), ""};
    return specs::parse_spec(text, "phrases.yaml", folders);
  }
  /// The message with which a spec of these goals is refused; "no error" if it is not.
  std::string error(const std::string& goals, const std::string& more) const {
    const std::string text = TinySpec{.goals = goals, .more = more}.text();
    return tests::input_error_of([&] { (void)parse(text); });
  }

  const tests::TemporaryFolder folder_{"phrases"};
  const std::string model_ = "phrases: {model: \"${data}/clip.yaml\"}\n";
};

TEST_F(PhraseSpecTest, AGoalMayBeAPhrase) {
  const specs::ExperimentSpec spec = parse(
      TinySpec{.goals = R"({phrase: "a red chair"}, couch, {phrase: seats, instances: 2})",
               .more = "phrases: {model: \"${data}/clip.yaml\", views: 6}\n"}
          .text());
  const specs::SceneSpec& scene = spec.scenes[0];
  EXPECT_THAT(scene.goals, ElementsAre("couch"));
  ASSERT_EQ(scene.phrases.size(), 2U);
  EXPECT_EQ(scene.phrases[0].text, "a red chair");
  EXPECT_EQ(scene.phrases[0].instances, 1);
  EXPECT_EQ(scene.phrases[1].text, "seats");
  EXPECT_EQ(scene.phrases[1].instances, 2);
  EXPECT_EQ(spec.phrases.model, folder_ / "clip.yaml");
  EXPECT_EQ(spec.phrases.views, 6);
}

TEST_F(PhraseSpecTest, APhraseNeedsAModel) {
  const std::string red = R"({phrase: "a red chair"})";
  EXPECT_EQ(error(red, model_), "no error");
  EXPECT_THAT(error(red, ""), AllOf(HasSubstr("phrases: {model: FILE}"), HasSubstr("tiny"),
                                    HasSubstr("a red chair")));
  EXPECT_THAT(error(red, "phrases: {views: 3}\n"), HasSubstr("model"));
  EXPECT_THAT(error(red, "phrases: {model: none.yaml}\n"),
              AllOf(HasSubstr("docs/models.md"), HasSubstr("no file none.yaml")));
  EXPECT_THAT(error(red, "phrases: {model: \"${data}/clip.yaml\", view: 3}\n"),
              HasSubstr("views"));
  EXPECT_THAT(error("chair", model_), HasSubstr("a goal {phrase: ...}"));
}

TEST_F(PhraseSpecTest, APhraseHasWordsOfItsOwn) {
  EXPECT_THAT(error("", model_), HasSubstr("at least one class name or phrase"));
  EXPECT_THAT(error(R"({phrase: "?"})", model_), HasSubstr("words on one line"));
  EXPECT_THAT(error(R"({phrase: "a\nchair"})", model_), HasSubstr("words on one line"));
  EXPECT_THAT(error("{instances: 2}", model_), HasSubstr("phrase"));
  EXPECT_THAT(error("{phrase: seats, instances: 0}", model_), HasSubstr("[1, 1000]"));
  EXPECT_THAT(error("{phrase: seats, instance: 2}", model_), HasSubstr("instances"));
  EXPECT_THAT(error(R"({phrase: "red chair"}, {phrase: "Red chair!"})", model_),
              HasSubstr("differs from others"));
  EXPECT_THAT(error("{phrase: Couch}, couch", model_), HasSubstr("the name of a class"));
}

TEST_F(PhraseSpecTest, ThingsOfAnotherReconstructionHaveOtherIds) {
  std::string text = TinySpec{.goals = R"({phrase: "a red chair"})",
                              .more = model_ + "repetitions: {reconstruct_seeds: 2}\n"}
                         .text();
  const std::string bundle = "bundle: ${data}/tiny";
  text.replace(text.find(bundle), bundle.size(),
               "source: {type: flat, seed: 1, reconstruct: {iterations: 1}}");
  EXPECT_THAT(tests::input_error_of([&] { (void)parse(text); }),
              HasSubstr("phrases: expected one reconstruction of each scene"));
}

}  // namespace
}  // namespace segsim::experiments
