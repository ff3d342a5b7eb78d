#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "perception/models/text/tokenizer.h"

namespace segsim::perception {

/// @param text  Contents of vocab.txt. @param place  For messages.
[[nodiscard]] std::unique_ptr<Tokenizer> make_word_piece_tokenizer(const std::string& text,
                                                                   const std::string& place);
/// @param text  Contents of merges.txt; its first line is a heading.
[[nodiscard]] std::unique_ptr<Tokenizer> make_clip_tokenizer(const std::string& text,
                                                             const std::string& place);
/// @param bytes  Contents of a SentencePiece .model of the unigram kind.
[[nodiscard]] std::unique_ptr<Tokenizer> make_unigram_tokenizer(const std::string& bytes,
                                                                const std::string& place);

/// Code points of UTF-8; broken bytes become U+FFFD.
[[nodiscard]] std::vector<char32_t> code_points(std::string_view text);
void append_utf8(std::string& text, char32_t point);
/// Lower case within ASCII and Latin-1.
[[nodiscard]] char32_t lower_case(char32_t point);
[[nodiscard]] bool is_space(char32_t point);
/// Punctuation and symbols: those of ASCII, Latin-1, and U+2000 to U+303F.
[[nodiscard]] bool is_punctuation(char32_t point);
[[nodiscard]] std::vector<std::string> lines_of(const std::string& text);

}  // namespace segsim::perception
