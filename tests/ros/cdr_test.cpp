#include "ros/cdr.h"

#include <tuple>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "ros/messages/all_messages.h"
#include "tests/error_message.h"
#include "tests/ros/filled_message.h"

namespace segsim::ros {
namespace {

using Bytes = std::vector<std::byte>;
using ::testing::ElementsAreArray;
using ::testing::HasSubstr;

/// "00 01 ff" as bytes; text in single quotes stands for its characters, "*7" repeats the
/// byte before.
Bytes bytes_of(const std::string& text) {
  Bytes bytes;
  for (std::size_t k = 0; k < text.size();) {
    if (text[k] == ' ' || text[k] == '|') {
      ++k;
    } else if (text[k] == '\'') {
      for (++k; text[k] != '\''; ++k) bytes.push_back(std::byte(text[k]));
      ++k;
    } else if (text[k] == '*') {
      bytes.resize(bytes.size() + static_cast<std::size_t>(text[k + 1] - '1'), bytes.back());
      k += 2;
    } else {
      bytes.push_back(std::byte(std::stoi(text.substr(k, 2), nullptr, 16)));
      k += 2;
    }
  }
  return bytes;
}

/// What alignment can do, in one message.
struct Mixed {
  static constexpr MessageType kType{"test_msgs", "Mixed"};
  std::uint8_t small = 0;
  double large = 0.0;
  std::string text;
  std::vector<std::uint16_t> shorts;
  std::vector<double> none;
  bool flag = false;
  std::vector<std::uint32_t> longs;
  std::array<std::int16_t, 3> three{};
  std::int64_t last = 0;
  bool operator==(const Mixed&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("small", self.small);
    visit("large", self.large);
    visit("text", self.text);
    visit("shorts", self.shorts);
    visit("none", self.none);
    visit("flag", self.flag);
    visit("longs", self.longs);
    visit("three", self.three);
    visit("last", self.last);
  }
};

// The expected bytes below were written by hand from the rules of DDS-XTypes 1.3, 7.4.3.

TEST(Cdr, HeaderIsTwoNumbersAndAText) {
  const std_msgs::Header header{{1, 2}, "map"};
  EXPECT_THAT(encode_cdr(header),
              ElementsAreArray(bytes_of("00 01 00 00 | 01 00 00 00 | 02 00 "
                                        "00 00 | 04 00 00 00 'map' 00")));
}

TEST(Cdr, FieldsAreAlignedFromBehindTheEncapsulation) {
  const Mixed mixed{1, 1.0, "x", {7, 8}, {}, true, {5}, {-1, 2, 3}, -2};
  const Bytes expected = bytes_of(
      "00 01 00 00 |"
      "01 00*7 | 00*6 f0 3f |"      // At 0 and 8.
      "02 00 00 00 'x' 00 00 00 |"  // At 16, with two bytes of padding.
      "02 00 00 00 07 00 08 00 |"   // At 24.
      "00 00 00 00 |"               // At 32: no double, so none is aligned.
      "01 00 00 00 |"               // At 36.
      "01 00 00 00 05 00 00 00 |"   // At 40.
      "ff ff 02 00 03 00 00 00 |"   // At 48.
      "fe ff*7");                   // At 56.
  EXPECT_THAT(encode_cdr(mixed), ElementsAreArray(expected));
  EXPECT_EQ(decode_cdr<Mixed>(expected, "here"), mixed);
}

TEST(Cdr, TransformsAreASequenceOfMessages) {
  tf2_msgs::TFMessage tf;
  tf.transforms.push_back({{{3, 4}, "odom"}, "base", {{1.0, -2.0, 0.5}, {}}});
  const Bytes expected = bytes_of(
      "00 01 00 00 | 01 00 00 00 | 03 00 00 00 04 00 00 00 |"
      "05 00 00 00 'odom' 00 00*3 | 05 00 00 00 'base' 00 00*7 |"
      "00*6 f0 3f | 00*7 c0 | 00*6 e0 3f |"
      "00*8 | 00*8 | 00*8 | 00*6 f0 3f");
  EXPECT_THAT(encode_cdr(tf), ElementsAreArray(expected));
}

TEST(Cdr, ImagesAreCopiedAsTheyLie) {
  sensor_msgs::Image image{{{0, 7}, "c"}, 1, 2, "rgb8", 0, 6, {1, 2, 3, 4, 5, 6}};
  const Bytes expected = bytes_of(
      "00 01 00 00 | 00 00 00 00 07 00 00 00 | 02 00 00 00 'c' 00 00 00 |"
      "01 00 00 00 02 00 00 00 | 05 00 00 00 'rgb8' 00 | 00 00 00 |"
      "06 00 00 00 | 06 00 00 00 01 02 03 04 05 06");
  EXPECT_THAT(encode_cdr(image), ElementsAreArray(expected));
}

TEST(Cdr, BigEndianMessagesAreRead) {
  const Bytes bytes =
      bytes_of("00 00 00 00 | 00 00 00 01 | 00 00 00 02 | 00 00 00 04 'map' 00");
  EXPECT_EQ(decode_cdr<std_msgs::Header>(bytes, "here"), (std_msgs::Header{{1, 2}, "map"}));
}

TEST(Cdr, EncodingReplacesWhatWasThere) {
  Bytes bytes = encode_cdr(std_msgs::String{"a long text"});
  encode_cdr(std_msgs::String{"b"}, bytes);
  EXPECT_EQ(bytes, encode_cdr(std_msgs::String{"b"}));
}

TEST(Cdr, ErrorsNamePlaceByteAndField) {
  Bytes bytes = encode_cdr(nav_msgs::Odometry{{{1, 2}, "odom"}, "base_link", {}, {}});
  bytes.resize(60);
  EXPECT_EQ(tests::input_error_of([&] { (void)decode_cdr<nav_msgs::Odometry>(bytes, "bag"); }),
            "bag, byte 60, pose.pose.position.z: expected 8 bytes more, found 0");

  bytes = encode_cdr(std_msgs::String{"abc"});
  bytes[4] = std::byte{200};
  EXPECT_EQ(tests::input_error_of([&] { (void)decode_cdr<std_msgs::String>(bytes, "bag"); }),
            "bag, byte 8, data: expected at most 4 characters, found 200");
}

TEST(Cdr, WhatIsNoMessageIsRefused) {
  const auto error = [](const std::string& text) {
    return tests::input_error_of(
        [&] { (void)decode_cdr<std_msgs::String>(bytes_of(text), "bag"); });
  };
  EXPECT_THAT(error("00 01 00"), HasSubstr("an encapsulation of 4 bytes, found 3 bytes"));
  EXPECT_THAT(error("00 03 00 00 01 00 00 00 00"), HasSubstr("plain CDR"));
  EXPECT_THAT(error("00 01 00 00 02 00 00 00 61 62"), HasSubstr("ends with a zero"));
  EXPECT_THAT(error("00 01 00 00 02 00 00 00 61 00 00 00 00 00"),
              HasSubstr("the end of the message, found 4 bytes more"));
  EXPECT_EQ(error("00 01 00 00 02 00 00 00 61 00 00 00"), "no error");  // A filled word.
  const Bytes flag = encode_cdr(sensor_msgs::RegionOfInterest{1, 2, 3, 4, true});
  Bytes other = flag;
  other.back() = std::byte{2};
  EXPECT_THAT(tests::input_error_of(
                  [&] { (void)decode_cdr<sensor_msgs::RegionOfInterest>(other, "bag"); }),
              HasSubstr("do_rectify: expected false or true"));
}

TEST(Cdr, ALengthCannotAskForMemory) {
  Bytes bytes = bytes_of(
      "00 01 00 00 | 00*8 | 01 00 00 00 00 00*3 | 00*8 | 01 00 00 00 00 00*3 | ff ff ff 7f");
  bytes.resize(bytes.size() + 100);
  EXPECT_EQ(
      tests::input_error_of([&] { (void)decode_cdr<sensor_msgs::CameraInfo>(bytes, "bag"); }),
      "bag, byte 40, d: expected at most 100 elements, found 2147483647");
}

template <class... M>
void check_all(std::tuple<M...>* /*all*/, auto&& check) {
  (check(M{}), ...);
}

TEST(Cdr, EveryMessageComesBack) {
  check_all(static_cast<AllMessages*>(nullptr), [](auto message) {
    using M = decltype(message);
    for (std::uint32_t seed = 0; seed < 8; ++seed) {
      message = filled_message<M>(seed);
      EXPECT_EQ(decode_cdr<M>(encode_cdr(message), "here"), message) << M::kType.name;
    }
  });
}

TEST(Cdr, NoMessageIsReadFromLessThanItsBytes) {
  check_all(static_cast<AllMessages*>(nullptr), [](auto message) {
    using M = decltype(message);
    const Bytes bytes = encode_cdr(filled_message<M>(3));
    for (std::size_t size = 0; size < bytes.size(); ++size) {
      const auto part = std::span(bytes).first(size);
      EXPECT_THROW((void)decode_cdr<M>(part, "here"), core::InputError)
          << M::kType.name << " " << size;
    }
  });
}

TEST(Cdr, FlippedBitsAreReadOrRefused) {
  check_all(static_cast<AllMessages*>(nullptr), [](auto message) {
    using M = decltype(message);
    Bytes bytes = encode_cdr(filled_message<M>(5));
    for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
      const std::byte mask{static_cast<unsigned char>(1U << bit % 8)};
      bytes[bit / 8] ^= mask;
      try {
        (void)decode_cdr<M>(bytes, "here");
      } catch (const core::InputError&) {
        // Bad input is one of the two allowed ends.
      }
      bytes[bit / 8] ^= mask;
    }
  });
}

}  // namespace
}  // namespace segsim::ros
