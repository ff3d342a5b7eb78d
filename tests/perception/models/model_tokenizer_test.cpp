#include "perception/models/text/tokenizer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "perception/models/text/internal/tokenizers.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using testing::ElementsAre;

TEST(WordPiece, TakesTheLongestPieceFromTheLeft) {
  const auto tokenizer = make_word_piece_tokenizer(
      "[PAD]\n[UNK]\n[CLS]\n[SEP]\nchair\n##s\n##man\nun\n##aff\n##able\n,\ncafe\n", "vocab");
  EXPECT_THAT(tokenizer->pieces("Chairs, chairman"), ElementsAre(4, 5, 10, 4, 6));
  EXPECT_THAT(tokenizer->pieces("unaffable"), ElementsAre(7, 8, 9));
  EXPECT_THAT(tokenizer->pieces("chairx CAF\xC3\x89"),
              ElementsAre(1, 11));  // Whole word unknown.
  EXPECT_THAT(tokenizer->pieces(std::string(101, 'a') + " \xFF chair"), ElementsAre(1, 4));
  EXPECT_THAT(tokenizer->encode("chairs chairs", 4), ElementsAre(2, 4, 5, 3));
}

TEST(WordPiece, RefusesOtherVocabularies) {
  EXPECT_THROW((void)make_word_piece_tokenizer("a\nb\n", "vocab"), core::InputError);
  EXPECT_THROW((void)make_word_piece_tokenizer("[PAD]\n[UNK]\n[CLS]\n[SEP]\na\na\n", "vocab"),
               core::InputError);
}

/// Ids by construction: 256 bytes, 256 bytes at the end of a word, merges, start, end. '!' is
/// the first byte of the alphabet; 'a' is the 64th after it.
TEST(ClipTokens, MergesInTheirOrder) {
  const auto tokenizer =
      make_clip_tokenizer("#version: 0.2\nc a\nca t</w>\na t</w>\n", "merges");
  const std::int64_t a = 'a' - '!', merge = 512;
  EXPECT_THAT(tokenizer->pieces("Cat"), ElementsAre(merge + 1));
  EXPECT_THAT(tokenizer->pieces("at  a"), ElementsAre(merge + 2, 256 + a));
  EXPECT_THAT(tokenizer->pieces("cab"), ElementsAre(merge, 256 + 'b' - '!'));
  // Single digits, contractions and runs of signs are words of their own.
  EXPECT_THAT(tokenizer->pieces("12's!!"), ElementsAre(256 + '1' - '!', 256 + '2' - '!',
                                                       '\'' - '!', 256 + 's' - '!', 0, 256));
  EXPECT_EQ(tokenizer->start_id(), merge + 3);
  EXPECT_THAT(tokenizer->encode("cat", 77), ElementsAre(merge + 3, merge + 1, merge + 4));
}

TEST(ClipTokens, BytesOfOtherScriptsHavePlacesBehindTheLatinOnes) {
  const auto tokenizer = make_clip_tokenizer("#version: 0.2\n", "merges");
  // U+4E2D is E4 B8 AD: 0xAD is the only byte of the upper half that is not printable.
  EXPECT_THAT(tokenizer->pieces("\xE4\xB8\xAD"),
              ElementsAre(94 + (0xE4 - 0xA1) - 1, 94 + (0xB8 - 0xA1) - 1, 256 + 255));
}

TEST(ClipTokens, RefusesOtherFiles) {
  EXPECT_THROW((void)make_clip_tokenizer("#version\nabc\n", "merges"), core::InputError);
  EXPECT_THROW((void)make_clip_tokenizer("#version\na b\na b\n", "merges"), core::InputError);
}

/// One field of a protobuf message: length-delimited, or a float.
std::string field(int number, const std::string& bytes) {
  return std::string{static_cast<char>(number * 8 + 2), static_cast<char>(bytes.size())} +
         bytes;
}
std::string unigram_piece(const std::string& text, float score, int type = 1) {
  const std::string number(reinterpret_cast<const char*>(&score), sizeof score);
  return field(1, field(1, text) + "\x15" + number + "\x18" + static_cast<char>(type));
}
const std::string kBlank = "\xE2\x96\x81";

TEST(Unigram, TakesThePathOfTheBestSum) {
  const std::string model = unigram_piece("<unk>", 0, 2) + unigram_piece("</s>", 0, 3) +
                            unigram_piece(kBlank, -2) + unigram_piece("c", -4) +
                            unigram_piece("hair", -3) + unigram_piece(kBlank + "chair", -6) +
                            unigram_piece(kBlank + "c", -2.5F) + unigram_piece("s", -1);
  const auto tokenizer = make_unigram_tokenizer(model, "model");
  // " c" + "hair" = -5.5 beats " chair" = -6.
  EXPECT_THAT(tokenizer->encode(" Chairs!  ", 64), ElementsAre(6, 4, 7, 1));
  // What no piece covers is one unknown.
  EXPECT_THAT(tokenizer->pieces("xyz s"), ElementsAre(2, 0, 2, 7));
}

TEST(Unigram, RefusesOtherFiles) {
  const std::string whole =
      unigram_piece("<unk>", 0, 2) + unigram_piece("</s>", 0, 3) + unigram_piece("a", -1);
  EXPECT_NO_THROW((void)make_unigram_tokenizer(whole, "model"));
  for (std::size_t cut = 0; cut < whole.size(); ++cut) {
    EXPECT_THROW((void)make_unigram_tokenizer(whole.substr(0, cut), "model"), core::InputError)
        << cut;
  }
  EXPECT_THROW((void)make_unigram_tokenizer(whole + unigram_piece("a", -1), "model"),
               core::InputError);
  EXPECT_THROW((void)make_unigram_tokenizer(whole + field(2, "\x18\x02"), "model"),
               core::InputError);  // Byte-pair encoding.
}

TEST(Tokenizer, KindIsToldByTheContent) {
  const tests::TemporaryFolder folder;
  const auto write = [&](const std::string& name, const std::string& text) {
    core::write_file_atomically(folder / name, [&](std::ostream& out) { out << text; });
    return folder / name;
  };
  EXPECT_EQ(load_tokenizer(write("a.txt", "#version: 0.2\nc a\n"))->start_id(), 513);
  EXPECT_EQ(load_tokenizer(write("b.txt", "[PAD]\n[UNK]\n[CLS]\n[SEP]\n"))->start_id(), 2);
  EXPECT_THROW((void)load_tokenizer(write("c.txt", std::string("a\0b", 3))), core::InputError);
  EXPECT_THROW((void)load_tokenizer(write("d.txt", "")), core::InputError);
  EXPECT_THROW((void)load_tokenizer(write("e.model", "not a model")), core::InputError);
  EXPECT_THROW((void)load_tokenizer(folder / "none.txt"), core::InputError);
}

TEST(Unicode, BrokenBytesAreReplaced) {
  EXPECT_THAT(code_points("a\xC3\xA9\xE4\xB8\xAD\xF0\x9F\x98\x80"),
              ElementsAre(U'a', 0xE9, 0x4E2D, 0x1F600));
  EXPECT_THAT(code_points("\xC3"), ElementsAre(0xFFFD));
  EXPECT_THAT(code_points("\xE4\xB8"
                          "a"),
              ElementsAre(0xFFFD, 0xFFFD, U'a'));
  std::string text;
  for (const char32_t point : {U'a', char32_t{0xE9}, char32_t{0x4E2D}, char32_t{0x1F600}}) {
    append_utf8(text, point);
  }
  EXPECT_EQ(text, "a\xC3\xA9\xE4\xB8\xAD\xF0\x9F\x98\x80");
}

}  // namespace
}  // namespace segsim::perception
