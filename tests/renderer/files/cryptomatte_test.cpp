#include "renderer/files/cryptomatte.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>

#include "core/check.h"
#include "core/error.h"
#include "core/random.h"

namespace segsim::renderer {
namespace {

using ::testing::HasSubstr;
using namespace std::string_literals;

float as_float(std::uint32_t bits) {
  float value = 0.0F;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

/// Vectors that implementations of MurmurHash3_x86_32 publish (Appleby's SMHasher, the
/// encyclopedia's table, SDL, Guava).
TEST(Murmur3, PublishedVectors) {
  const struct {
    std::string text;
    std::uint32_t seed, hash;
  } kVectors[] = {
      {"", 0, 0},
      {"", 1, 0x514e28b7U},
      {"", 0xffffffffU, 0x81f16f39U},
      {"\0\0\0\0"s, 0, 0x2362f9deU},
      {"\xff\xff\xff\xff", 0, 0x76293b50U},
      {"\x21\x43\x65\x87", 0, 0xf55b516bU},
      {"\x21\x43\x65", 0, 0x7e4a8634U},
      {"\x21\x43", 0, 0xa0f7b07aU},
      {"\x21", 0, 0x72661cf4U},
      {"a", 0x9747b28cU, 0x7fa09ea6U},
      {"abcd", 0x9747b28cU, 0xf0478627U},
      {"hello", 0, 0x248bfa47U},
      {"Hello, world!", 0x9747b28cU, 0x24884cbaU},
      {"The quick brown fox jumps over the lazy dog", 0x9747b28cU, 0x2fa826cdU},
      {"The quick brown fox jumps over the lazy dog", 0, 0x2e4ff723U},
  };
  for (const auto& [text, seed, hash] : kVectors) {
    EXPECT_EQ(murmur3_32(text, seed), hash) << '"' << text << "\" " << seed;
  }
}

/// Values of the Cryptomatte project's own tests and of its specification.
TEST(Cryptomatte, PublishedIds) {
  const auto single = [](double value) { return static_cast<float>(value); };
  EXPECT_EQ(as_float(cryptomatte_id("hello")), single(6.0705627102400005616e-17));
  EXPECT_NEAR(as_float(cryptomatte_id("cube")) / -4.08461912519e+15, 1.0, 1e-6);
  EXPECT_NEAR(as_float(cryptomatte_id("sphere")) / 2.79018604383e+15, 1.0, 1e-6);
  EXPECT_NEAR(as_float(cryptomatte_id("plane")) / 3.66557617593e-11, 1.0, 1e-6);
  EXPECT_EQ(
      as_float(cryptomatte_id("\xd1\x80\xd0\xb0\xd0\xb2\xd0\xbd\xd0\xb8\xd0\xbd\xd0\xb0")),
      single(-1.3192631212399999468e-25));
  EXPECT_EQ(as_float(cryptomatte_id("m\xc3\xa4"
                                    "dchen")),
            single(6.2361298211599995797e+25));
  EXPECT_EQ(cryptomatte_id("bunny"), 0x13851a76U);
  EXPECT_EQ(cryptomatte_id("default"), 0x42c9679fU);
  EXPECT_EQ(cryptomatte_id("bunny_porcelain_mat"), 0xb24b26d4U);
}

TEST(Cryptomatte, IdsAreOrdinaryFloatsAndDifferFromTheHashInTheExponentOnly) {
  core::RandomStream random(1, "cryptomatte");
  int changed = 0;
  for (int i = 0; i < 200000; ++i) {
    const std::string name = "object " + std::to_string(random.index(1U << 31U));
    const std::uint32_t id = cryptomatte_id(name);
    ASSERT_TRUE(std::isnormal(as_float(id))) << name;
    const std::uint32_t hash = murmur3_32(name);
    ASSERT_EQ(id & 0x807fffffU, hash & 0x807fffffU) << name;
    if (id != hash) {
      ++changed;
      ASSERT_FALSE(std::isnormal(as_float(hash))) << name;
    }
  }
  EXPECT_GT(changed, 1000);  // 2 of 256 exponents are changed.
  EXPECT_TRUE(std::isnormal(as_float(cryptomatte_id(""))));
}

TEST(IdNames, NamesAndCryptomatteIdsAreUnique) {
  IdNames names("instance");
  names.add(7, "chair");
  names.add(3, "chair");
  names.add(9, "");
  names.add_if_missing(9);
  names.add_if_missing(12);
  names.add_if_missing(0);
  EXPECT_EQ(names.name(7), "chair");
  EXPECT_EQ(names.name(3), "chair#3");
  EXPECT_EQ(names.name(9), "instance 9");
  EXPECT_EQ(names.name(12), "instance 12");
  EXPECT_EQ(names.name(0), "");
  EXPECT_EQ(names.name(500), "");
  EXPECT_EQ(names.cryptomatte(7), cryptomatte_id("chair"));
  EXPECT_EQ(names.cryptomatte(3), cryptomatte_id("chair#3"));
  EXPECT_EQ(names.cryptomatte(0), 0U);
  EXPECT_EQ(names.cryptomatte(500), 0U);
  EXPECT_THROW(names.add(0, "void"), core::ContractViolation);
  EXPECT_THROW(names.add(7, "table"), core::ContractViolation);
}

/// nlohmann::json is the oracle of what we write.
TEST(IdNames, ManifestAndLegendAreJson) {
  const std::string odd =
      "quote \" back\\slash\ttab \x01 m\xc3\xa4"
      "dchen {}[]:,#'";
  IdNames names("class");
  names.add(2, odd);
  names.add(1, "couch");
  names.add(65535, "null");
  const nlohmann::json manifest = nlohmann::json::parse(names.manifest_json());
  ASSERT_EQ(manifest.size(), 3U);
  char hex[9];
  for (const char* name : {"couch", "null", odd.c_str()}) {
    std::snprintf(hex, sizeof hex, "%08x", cryptomatte_id(name));
    EXPECT_EQ(manifest.at(name), hex) << name;
  }
  const nlohmann::json legend = nlohmann::json::parse(names.legend_json());
  EXPECT_EQ(legend, (nlohmann::json{{"1", "couch"}, {"2", odd}, {"65535", "null"}}));

  const IdNames back = IdNames::from_legend("class", names.legend_json(), "x.exr");
  EXPECT_EQ(back.names(), names.names());
  const auto parsed = parse_cryptomatte_manifest(names.manifest_json(), "x.exr");
  ASSERT_EQ(parsed.size(), 3U);
  EXPECT_EQ(parsed.at(cryptomatte_id(odd)), odd);
  EXPECT_EQ(parsed.at(cryptomatte_id("couch")), "couch");
}

TEST(IdNames, BadJsonIsRefusedWithItsPlace) {
  const auto legend_error = [](const std::string& json) -> std::string {
    try {
      (void)IdNames::from_legend("class", json, "x.exr");
    } catch (const core::InputError& error) {
      return error.what();
    }
    return "no error";
  };
  for (const char* json : {"", "[1]", "{", "{\"0\":\"void\"}", "{\"65536\":\"a\"}",
                           "{\"a\":\"b\"}", "{\"1\":\"a\",\"01\":\"b\"}", "{\"1\":[2]}"}) {
    EXPECT_THAT(legend_error(json), HasSubstr("x.exr")) << json;
  }
  for (const char* json : {"", "3", "{\"a\":\"123\"}", "{\"a\":\"0123456g\"}", "{\"a\":{}}"}) {
    EXPECT_THROW((void)parse_cryptomatte_manifest(json, "x.exr"), core::InputError) << json;
  }
}

TEST(SceneNames, ComeFromTheManifest) {
  core::SceneManifest manifest;
  manifest.classes = {{1, "wall", false}, {3, "couch", true}};
  manifest.instances = {{4, 3, "couch_a", {}, {}}, {5, 3, "couch_a", {}, {}}};
  const SceneNames names = SceneNames::of(manifest);
  EXPECT_EQ(names.classes.name(3), "couch");
  EXPECT_EQ(names.instances.name(4), "couch_a");
  EXPECT_EQ(names.instances.name(5), "couch_a#5");
}

}  // namespace
}  // namespace segsim::renderer
