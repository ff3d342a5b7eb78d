// CLIP's byte-pair encoding: bytes are joined in the order of the merges.
#include <algorithm>
#include <array>
#include <map>
#include <unordered_map>

#include "core/error.h"
#include "perception/models/text/internal/tokenizers.h"

namespace segsim::perception {
namespace {

/// CLIP's vocabulary uses the first so many merges of its file.
constexpr std::size_t kMerges = 49152 - 256 - 2;
constexpr const char* kWordEnd = "</w>";

/// A printable character for each byte, and the order in which they come in the vocabulary.
struct ByteAlphabet {
  std::array<std::string, 256> character;
  std::vector<int> order;

  ByteAlphabet() {
    const auto printable = [](int b) {
      return (b >= 0x21 && b <= 0x7E) || (b >= 0xA1 && b <= 0xAC) || (b >= 0xAE && b <= 0xFF);
    };
    for (int b = 0; b < 256; ++b) {
      if (printable(b)) order.push_back(b);
    }
    char32_t extra = 256;
    for (int b = 0; b < 256; ++b) {
      const bool as_is = printable(b);
      append_utf8(character[static_cast<std::size_t>(b)],
                  as_is ? static_cast<char32_t>(b) : extra++);
      if (!as_is) order.push_back(b);
    }
  }
};

class Clip final : public Tokenizer {
 public:
  Clip(const std::string& text, const std::string& place) {
    std::int64_t id = 0;
    for (const char* end : {"", kWordEnd}) {
      for (const int byte : alphabet_.order) {
        ids_[alphabet_.character[static_cast<std::size_t>(byte)] + end] = id++;
      }
    }
    const std::vector<std::string> lines = lines_of(text);
    for (std::size_t i = 1; i < lines.size() && ranks_.size() < kMerges; ++i) {
      if (lines[i].empty()) continue;
      const std::size_t space = lines[i].find(' ');
      if (space == std::string::npos || space == 0 || space + 1 == lines[i].size() ||
          lines[i].find(' ', space + 1) != std::string::npos) {
        throw core::InputError::expected(place + ":" + std::to_string(i + 1),
                                         "two pieces to merge", "'" + lines[i] + "'");
      }
      const std::pair pair{lines[i].substr(0, space), lines[i].substr(space + 1)};
      if (!ranks_.emplace(pair, ranks_.size()).second) {
        throw core::InputError::expected(place + ":" + std::to_string(i + 1),
                                         "each merge once", "'" + lines[i] + "' again");
      }
      ids_[pair.first + pair.second] = id++;
    }
    start_ = id++;
    end_ = id++;
  }

  [[nodiscard]] std::int64_t start_id() const override { return start_; }
  [[nodiscard]] std::int64_t end_id() const override { return end_; }
  /// Hugging Face's CLIP pads with the end; the original with 0. Both come after the end,
  /// where the model does not look.
  [[nodiscard]] std::int64_t padding_id() const override { return end_; }

  [[nodiscard]] std::vector<std::int64_t> pieces(const std::string& text) const override {
    std::vector<std::int64_t> ids;
    for (const std::string& word : words(text)) append_word(word, ids);
    return ids;
  }

 private:
  enum class Kind : std::uint8_t { kSpace, kLetter, kDigit, kOther };

  static Kind kind_of(char32_t point) {
    if (is_space(point)) return Kind::kSpace;
    if (point >= U'0' && point <= U'9') return Kind::kDigit;
    return is_punctuation(point) || point < 0x20 ? Kind::kOther : Kind::kLetter;
  }

  /// Length of 's, 't, 're, 've, 'm, 'll or 'd at a place; 0 if there is none.
  static std::size_t contraction(const std::vector<char32_t>& points, std::size_t at) {
    for (const std::u32string_view ending :
         {U"'s", U"'t", U"'re", U"'ve", U"'m", U"'ll", U"'d"}) {
      if (at + ending.size() <= points.size() &&
          std::equal(ending.begin(), ending.end(),
                     points.begin() + static_cast<std::ptrdiff_t>(at))) {
        return ending.size();
      }
    }
    return 0;
  }

  /// Contractions, runs of letters, single digits, runs of the rest; in lower case.
  static std::vector<std::string> words(const std::string& text) {
    std::vector<char32_t> points = code_points(text);
    for (char32_t& point : points) point = lower_case(point);
    std::vector<std::string> found;
    for (std::size_t i = 0; i < points.size();) {
      const Kind kind = kind_of(points[i]);
      std::size_t length = contraction(points, i);
      if (length == 0) {
        length = 1;
        while (kind != Kind::kDigit && i + length < points.size() &&
               kind_of(points[i + length]) == kind) {
          ++length;
        }
      }
      std::string word;
      for (std::size_t k = i; k < i + length; ++k) append_utf8(word, points[k]);
      if (kind != Kind::kSpace) found.push_back(std::move(word));
      i += length;
    }
    return found;
  }

  void append_word(const std::string& word, std::vector<std::int64_t>& ids) const {
    std::vector<std::string> parts;
    for (const char byte : word) {
      parts.push_back(alphabet_.character[static_cast<unsigned char>(byte)]);
    }
    parts.back() += kWordEnd;
    while (parts.size() > 1) {
      std::size_t best = parts.size(), best_rank = ranks_.size();
      for (std::size_t i = 0; i + 1 < parts.size(); ++i) {
        const auto rank = ranks_.find({parts[i], parts[i + 1]});
        if (rank == ranks_.end() || rank->second >= best_rank) continue;
        best = i;
        best_rank = rank->second;
      }
      if (best == parts.size()) break;
      const std::pair pair{parts[best], parts[best + 1]};
      std::vector<std::string> merged;
      for (std::size_t i = 0; i < parts.size(); ++i) {
        if (i + 1 < parts.size() && parts[i] == pair.first && parts[i + 1] == pair.second) {
          merged.push_back(pair.first + pair.second);
          ++i;
        } else {
          merged.push_back(parts[i]);
        }
      }
      parts = std::move(merged);
    }
    for (const std::string& part : parts) ids.push_back(ids_.at(part));
  }

  ByteAlphabet alphabet_;
  std::unordered_map<std::string, std::int64_t> ids_;
  std::map<std::pair<std::string, std::string>, std::size_t> ranks_;
  std::int64_t start_ = 0, end_ = 0;
};

}  // namespace

std::unique_ptr<Tokenizer> make_clip_tokenizer(const std::string& text,
                                               const std::string& place) {
  return std::make_unique<Clip>(text, place);
}

}  // namespace segsim::perception
