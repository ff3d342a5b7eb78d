#include "core/name_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace segsim::core {
namespace {

enum class Fruit { kApple, kPear, kPlum };
constexpr NameTable<Fruit, Fruit::kPlum> kFruits("a fruit", {"apple", "pear", "plum"});

TEST(NameTable, EveryNameIsReadAsItsValue) {
  for (const Fruit fruit : {Fruit::kApple, Fruit::kPear, Fruit::kPlum}) {
    EXPECT_EQ(kFruits.find(kFruits.name(fruit)), fruit);
    EXPECT_EQ(kFruits.read(kFruits.name(fruit), "here"), fruit);
  }
  EXPECT_STREQ(kFruits.name(Fruit::kPear), "pear");
}

TEST(NameTable, AnUnknownNameIsRefusedWithItsPlace) {
  for (const char* wrong : {"", "Pear", "pears", "pea"}) EXPECT_FALSE(kFruits.find(wrong));
  try {
    (void)kFruits.read("paer", "basket.csv:7");
    FAIL() << "taken for a fruit";
  } catch (const InputError& error) {
    EXPECT_STREQ(error.what(),
                 "basket.csv:7: expected a fruit (apple, pear, plum), found \"paer\"");
  }
}

}  // namespace
}  // namespace segsim::core
