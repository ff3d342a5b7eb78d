// BERT's WordPiece: words are cut into the longest known pieces from the left.
#include <array>
#include <unordered_map>

#include "core/error.h"
#include "perception/models/text/internal/tokenizers.h"

namespace segsim::perception {
namespace {

constexpr std::size_t kLongestWord = 100;  ///< Longer ones are unknown, as in BERT.

/// Latin-1 letters without their accents, from U+00E0.
char32_t without_accent(char32_t point) {
  static constexpr std::array<char, 32> kBase = {
      'a', 'a', 'a', 'a', 'a', 'a', 0,   'c', 'e', 'e', 'e', 'e', 'i', 'i', 'i', 'i',
      0,   'n', 'o', 'o', 'o', 'o', 'o', 0,   0,   'u', 'u', 'u', 'u', 'y', 0,   'y'};
  if (point < 0xE0 || point > 0xFF) return point;
  const char base = kBase[point - 0xE0];
  return base == 0 ? point : static_cast<char32_t>(base);
}

class WordPiece final : public Tokenizer {
 public:
  WordPiece(const std::string& text, const std::string& place) {
    std::int64_t id = 0;
    for (const std::string& line : lines_of(text)) {
      if (!ids_.emplace(line, id).second) {
        throw core::InputError::expected(place + ":" + std::to_string(id + 1),
                                         "each token once", "'" + line + "' again");
      }
      ++id;
    }
    for (const auto& [name, value] : {std::pair{"[CLS]", &start_},
                                      {"[SEP]", &end_},
                                      {"[PAD]", &padding_},
                                      {"[UNK]", &unknown_}}) {
      const auto found = ids_.find(name);
      if (found == ids_.end()) {
        throw core::InputError::expected(
            place, "vocab.txt of BERT, with [CLS], [SEP], [PAD] and [UNK]",
            std::string("no ") + name);
      }
      *value = found->second;
    }
  }

  [[nodiscard]] std::int64_t start_id() const override { return start_; }
  [[nodiscard]] std::int64_t end_id() const override { return end_; }
  [[nodiscard]] std::int64_t padding_id() const override { return padding_; }

  [[nodiscard]] std::vector<std::int64_t> pieces(const std::string& text) const override {
    std::vector<std::int64_t> ids;
    std::vector<char32_t> word;
    const auto flush = [&] {
      append_word(word, ids);
      word.clear();
    };
    for (char32_t point : code_points(text)) {
      point = without_accent(lower_case(point));
      const bool combining = point >= 0x300 && point <= 0x36F;
      const bool ideograph = point >= 0x4E00 && point <= 0x9FFF;
      if (point == 0 || point == 0xFFFD || combining) continue;
      if (is_space(point)) {
        flush();
      } else if (is_punctuation(point) || ideograph) {
        flush();
        word.push_back(point);
        flush();
      } else if (point >= 0x20) {
        word.push_back(point);
      }
    }
    flush();
    return ids;
  }

 private:
  void append_word(const std::vector<char32_t>& word, std::vector<std::int64_t>& ids) const {
    if (word.empty()) return;
    std::vector<std::int64_t> found;
    std::size_t start = 0;
    while (start < word.size() && word.size() <= kLongestWord) {
      std::size_t end = word.size();
      auto known = ids_.end();
      for (; end > start; --end) {
        std::string piece = start > 0 ? "##" : "";
        for (std::size_t i = start; i < end; ++i) append_utf8(piece, word[i]);
        known = ids_.find(piece);
        if (known != ids_.end()) break;
      }
      if (known == ids_.end()) break;
      found.push_back(known->second);
      start = end;
    }
    if (start < word.size()) found = {unknown_};
    ids.insert(ids.end(), found.begin(), found.end());
  }

  std::unordered_map<std::string, std::int64_t> ids_;
  std::int64_t start_ = 0, end_ = 0, padding_ = 0, unknown_ = 0;
};

}  // namespace

std::unique_ptr<Tokenizer> make_word_piece_tokenizer(const std::string& text,
                                                     const std::string& place) {
  return std::make_unique<WordPiece>(text, place);
}

}  // namespace segsim::perception
