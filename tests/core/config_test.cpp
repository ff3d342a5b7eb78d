#include "core/config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"

namespace segsim::core {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

template <class Action>
std::string message_of(Action action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

TEST(ConfigNode, ReadsScalarsListsAndMaps) {
  const ConfigNode root =
      ConfigNode::parse("a: 1.5\nb: [1, 2]\nc: {d: hello, e: true}\n", "t.yaml");
  EXPECT_DOUBLE_EQ(root.number("a"), 1.5);
  EXPECT_THAT(root.numbers("b"), ElementsAre(1.0, 2.0));
  EXPECT_EQ(root.child("c").text("d"), "hello");
  EXPECT_TRUE(root.child("c").boolean_or("e", false));
  EXPECT_EQ(root.integer_or("missing", 7), 7);
  root.child("c").finish();
  root.finish();
}

TEST(ConfigNode, UnknownKeyNamesLineAndNearestKey) {
  const ConfigNode root = ConfigNode::parse("seed: 1\nepisodse: 3\n", "spec.yaml");
  (void)root.integer_or("seed", 0);
  (void)root.integer_or("episodes", 0);
  const std::string message = message_of([&] { root.finish(); });
  EXPECT_THAT(message, HasSubstr("spec.yaml:2"));
  EXPECT_THAT(message, HasSubstr("did you mean \"episodes\"?"));
  EXPECT_THAT(message, HasSubstr("found \"episodse\""));
}

TEST(ConfigNode, UnknownKeyInAMapReadByAnotherPartIsFound) {
  const ConfigNode root = ConfigNode::parse("robot:\n  radius: 1\n  hieght: 2\n", "spec.yaml");
  (void)root.child("robot").number("radius");
  (void)root.child("robot").number_or("height", 0);
  EXPECT_THAT(message_of([&] { root.child("robot").finish(); }),
              HasSubstr("spec.yaml:3: robot"));
}

TEST(ConfigNode, WrongTypeNamesTheKey) {
  const ConfigNode root = ConfigNode::parse("n: twelve\nl: 3\n", "f.yaml");
  EXPECT_EQ(message_of([&] { (void)root.integer("n"); }),
            "f.yaml:1: n: expected an integer, found \"twelve\"");
  EXPECT_THAT(message_of([&] { (void)root.numbers("l"); }), HasSubstr("expected a list"));
  EXPECT_THAT(message_of([&] { (void)root.text("x"); }), HasSubstr("expected the key \"x\""));
}

TEST(ConfigNode, BrokenYamlAndMissingFileAreInputErrors) {
  EXPECT_THAT(message_of([] { (void)ConfigNode::parse("a: [1, 2", "b.yaml"); }),
              HasSubstr("valid YAML"));
  EXPECT_THAT(message_of([] { (void)ConfigNode::load("/nonexistent/x.yaml"); }),
              HasSubstr("/nonexistent/x.yaml: expected a readable YAML file"));
}

TEST(ConfigNode, AKeyThatStandsTwiceIsRefused) {
  const auto error_of = [](const std::string& text) {
    return message_of([&] { (void)ConfigNode::parse(text, "f.yaml"); });
  };
  EXPECT_EQ(error_of("a: 1\nb: {c: 2, d: 3, c: 4}\n"),
            "f.yaml:2: expected each key once, found \"c\" again");
  EXPECT_EQ(error_of("l:\n- {a: 1}\n- {a: 2}\nk: {l: 1}\n"), "no error");
  EXPECT_EQ(error_of("a: &x 1\nb: *x\n*x : 3\n"),
            "f.yaml:3: expected a text as a key, found another node");
}

TEST(ConfigNode, AliasesOfAliasesDoNotGrowBeyondMemory) {
  std::string text = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n";
  for (int k = 1; k < 12; ++k) {
    const std::string below = "*a" + std::to_string(k - 1);
    std::string line = "a" + std::to_string(k) + ": &a" + std::to_string(k) + " [";
    for (int i = 0; i < 10; ++i) line += (i == 0 ? "" : ", ") + below;
    text += line + "]\n";
  }
  EXPECT_THAT(message_of([&] { (void)ConfigNode::parse(text, "f.yaml"); }),
              HasSubstr("expected at most 1000000 nodes"));
  EXPECT_THAT(message_of([] { (void)ConfigNode::parse("a: &a [1, *a]\n", "f.yaml"); }),
              HasSubstr("f.yaml:1"));
}

TEST(ConfigNode, NothingIsNoValue) {
  for (const char* text : {"a: ~\n", "a:\n", "a: null\n"}) {
    const ConfigNode root = ConfigNode::parse(text, "f.yaml");
    EXPECT_THAT(message_of([&] { (void)root.number_or("a", 1.0); }),
                HasSubstr("a: expected a value (leave the key out for its default)"));
  }
  for (const char* word : {".nan", ".inf", "-.inf", "1e999"}) {
    const ConfigNode root = ConfigNode::parse("a: " + std::string(word) + "\n", "f.yaml");
    EXPECT_THAT(message_of([&] { (void)root.number("a"); }), HasSubstr("number, found"));
  }
}

TEST(NearestWord, FindsTyposAndRefusesStrangers) {
  EXPECT_EQ(nearest_word("detecter", {"detector", "policy"}), "detector");
  EXPECT_EQ(nearest_word("zzzzzzzzzz", {"detector", "policy"}), "");
}

}  // namespace
}  // namespace segsim::core
