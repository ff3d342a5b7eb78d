#include "perception/data/checked_json.h"

#include <array>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include <gmock/gmock.h>

namespace segsim::perception {
namespace {

using ::testing::HasSubstr;

/// What the first of a list is as that integer; or the error.
template <class Integer, class Json = CheckedJson>
std::string read(const std::string& text) {
  try {
    return std::to_string(Json::parse("[" + text + "]").at(0).template get<Integer>());
  } catch (const nlohmann::json::exception& error) {
    return error.what();
  }
}

TEST(CheckedJson, TakesWhatAnIntegerHolds) {
  EXPECT_EQ(read<int>("-2147483648"), "-2147483648");
  EXPECT_EQ(read<int>("2147483647.0"), "2147483647");
  EXPECT_EQ(read<std::uint16_t>("65535"), "65535");
  EXPECT_EQ(read<std::int64_t>("-9223372036854775808"), "-9223372036854775808");
  EXPECT_EQ(read<std::uint64_t>("18446744073709551615"), "18446744073709551615");
  EXPECT_EQ(read<int>("true"), "1");
}

TEST(CheckedJson, RefusesEveryOtherNumber) {
  EXPECT_THAT(read<int>("2147483648"), HasSubstr("from -2147483648 to 2147483647"));
  EXPECT_THAT(read<int>("-2147483649"), HasSubstr("found -2147483649"));
  EXPECT_THAT(read<int>("2147483648.0"), HasSubstr("found 2147483648.0"));
  EXPECT_THAT(read<int>("3.7"), HasSubstr("found 3.7"));
  EXPECT_THAT(read<std::uint16_t>("-1"), HasSubstr("found -1"));
  EXPECT_THAT(read<std::uint16_t>("-1.0"), HasSubstr("found -1.0"));
  EXPECT_THAT(read<std::int64_t>("9223372036854775808"), HasSubstr("expected a whole number"));
  EXPECT_THAT(read<std::uint64_t>("18446744073709551616"), HasSubstr("found 1.8446744"));
  EXPECT_THAT((read<int, OrderedCheckedJson>("1e300")), HasSubstr("found 1e+300"));
  EXPECT_THAT(read<int>("\"1\""), HasSubstr("found string"));
}

TEST(CheckedJson, LooksIntoListsAndDefaults) {
  const auto json = OrderedCheckedJson::parse(R"({"list":[1,1e30],"real":1e30,"none":null})");
  EXPECT_THROW((void)json.at("list").get<std::vector<std::uint16_t>>(),
               nlohmann::json::exception);
  EXPECT_THROW((void)(json.at("list").get<std::array<int, 2>>()), nlohmann::json::exception);
  EXPECT_THROW((void)json.value("real", 0), nlohmann::json::exception);
  EXPECT_EQ(json.value("missing", 5), 5);
  EXPECT_EQ(json.at("real").get<double>(), 1e30);
  EXPECT_EQ(OrderedCheckedJson({{"b", 1}, {"a", -2}}).dump(), R"({"b":1,"a":-2})");
}

}  // namespace
}  // namespace segsim::perception
