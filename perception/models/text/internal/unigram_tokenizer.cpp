// SentencePiece's unigram models (Kudo 2018): the pieces whose scores sum to most. Debian's
// library is not used: it brings another version of protobuf, and both in one process abort.
//
// File: a protobuf message; field 1, repeated: {1: piece, 2: score (float), 3: type}; field 2:
// {3: kind of model, 1 = unigram}. Types: 1 normal, 2 unknown, 3 control, 4 user-defined.
#include <google/protobuf/unknown_field_set.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <unordered_map>

#include "core/error.h"
#include "core/file_io.h"
#include "perception/models/text/internal/tokenizers.h"

namespace segsim::perception {
namespace {

using core::InputError;
using google::protobuf::UnknownField;
using google::protobuf::UnknownFieldSet;

constexpr const char* kSpace = "\xE2\x96\x81";  ///< U+2581, written for blanks.
constexpr float kUnknownPenalty = 10.0F;  ///< Below the lowest score, as in the original.

struct Piece {
  std::string text;
  float score = 0.0F;
  std::uint64_t type = 1;
};

Piece read_piece(const std::string& bytes, const std::string& place) {
  UnknownFieldSet fields;
  if (!fields.ParseFromString(bytes)) {
    throw InputError::expected(place, "a SentencePiece model", "a damaged piece");
  }
  Piece piece;
  for (int i = 0; i < fields.field_count(); ++i) {
    const UnknownField& field = fields.field(i);
    if (field.number() == 1 && field.type() == UnknownField::TYPE_LENGTH_DELIMITED) {
      piece.text = field.length_delimited();
    } else if (field.number() == 2 && field.type() == UnknownField::TYPE_FIXED32) {
      piece.score = std::bit_cast<float>(field.fixed32());
    } else if (field.number() == 3 && field.type() == UnknownField::TYPE_VARINT) {
      piece.type = field.varint();
    }
  }
  return piece;
}

/// Kind of model in the trainer's settings; 1 if they do not say.
std::uint64_t model_kind(const std::string& bytes) {
  UnknownFieldSet fields;
  if (!fields.ParseFromString(bytes)) return 0;
  for (int i = 0; i < fields.field_count(); ++i) {
    const UnknownField& field = fields.field(i);
    if (field.number() == 3 && field.type() == UnknownField::TYPE_VARINT)
      return field.varint();
  }
  return 1;
}

class Unigram final : public Tokenizer {
 public:
  Unigram(const std::string& bytes, const std::string& place) {
    UnknownFieldSet fields;
    if (bytes.empty() || !fields.ParseFromString(bytes)) {
      throw InputError::expected(place, "a SentencePiece model", "another file");
    }
    for (int i = 0; i < fields.field_count(); ++i) {
      const UnknownField& field = fields.field(i);
      if (field.type() != UnknownField::TYPE_LENGTH_DELIMITED) continue;
      if (field.number() == 1) add(read_piece(field.length_delimited(), place), place);
      if (field.number() == 2 && model_kind(field.length_delimited()) != 1) {
        throw InputError::expected(place, "a unigram model", "another kind");
      }
    }
    if (!unknown_ || !end_ || ids_.empty()) {
      throw InputError::expected(place, "a SentencePiece model with <unk> and </s>", "none");
    }
  }

  [[nodiscard]] std::int64_t start_id() const override { return -1; }  // As SigLIP has it.
  [[nodiscard]] std::int64_t end_id() const override { return *end_; }
  [[nodiscard]] std::int64_t padding_id() const override { return *end_; }

  /// SigLIP: lower case, no punctuation, single blanks.
  [[nodiscard]] std::vector<std::int64_t> pieces(const std::string& text) const override {
    std::string plain;
    bool blank = true;
    for (const char32_t point : code_points(text)) {
      if (point < 0x80 && is_punctuation(point)) continue;
      if (is_space(point)) {
        blank = true;
        continue;
      }
      if (blank) plain += kSpace;
      blank = false;
      append_utf8(plain, lower_case(point));
    }
    return best_path(plain);
  }

 private:
  void add(const Piece& piece, const std::string& place) {
    const std::int64_t id = count_++;
    if (!std::isfinite(piece.score)) {
      throw InputError::expected(place, "finite scores", "piece '" + piece.text + "' without");
    }
    if (piece.type == 2) unknown_ = id;
    if (piece.type == 3 && piece.text == "</s>") end_ = id;
    if ((piece.type != 1 && piece.type != 4) || piece.text.empty()) return;
    if (!ids_.emplace(piece.text, std::pair{id, piece.score}).second) {
      throw InputError::expected(place, "each piece once", "'" + piece.text + "' again");
    }
    longest_ = std::max(longest_, piece.text.size());
    lowest_ = std::min(lowest_, piece.score);
  }

  /// Viterbi over bytes at which characters begin; a character that no piece covers is
  /// unknown, and runs of unknown ones count once.
  [[nodiscard]] std::vector<std::int64_t> best_path(const std::string& text) const {
    struct Step {
      float score = -std::numeric_limits<float>::infinity();
      std::size_t from = 0;
      std::int64_t id = 0;
    };
    std::vector<Step> steps(text.size() + 1);
    steps[0].score = 0.0F;
    const auto starts = [&](std::size_t at) {
      return at == text.size() || (static_cast<unsigned char>(text[at]) & 0xC0U) != 0x80U;
    };
    for (std::size_t start = 0; start < text.size(); ++start) {
      if (!starts(start)) continue;
      bool single = false;
      std::size_t next = start + 1;
      while (!starts(next)) ++next;
      const auto take = [&](std::size_t end, float score, std::int64_t id) {
        if (steps[start].score + score > steps[end].score) {
          steps[end] = {steps[start].score + score, start, id};
        }
      };
      for (std::size_t end = next; end <= std::min(text.size(), start + longest_); ++end) {
        if (!starts(end)) continue;
        const auto known = ids_.find(text.substr(start, end - start));
        if (known == ids_.end()) continue;
        take(end, known->second.second, known->second.first);
        single = single || end == next;
      }
      if (!single) take(next, lowest_ - kUnknownPenalty, *unknown_);
    }
    std::vector<std::int64_t> ids;
    for (std::size_t at = text.size(); at > 0; at = steps[at].from) {
      const std::int64_t id = steps[at].id;
      if (id != *unknown_ || ids.empty() || ids.back() != id) ids.push_back(id);
    }
    return {ids.rbegin(), ids.rend()};
  }

  std::unordered_map<std::string, std::pair<std::int64_t, float>> ids_;
  std::optional<std::int64_t> unknown_, end_;
  std::int64_t count_ = 0;
  std::size_t longest_ = 0;
  float lowest_ = 0.0F;
};

}  // namespace

std::unique_ptr<Tokenizer> make_unigram_tokenizer(const std::string& bytes,
                                                  const std::string& place) {
  return std::make_unique<Unigram>(bytes, place);
}

}  // namespace segsim::perception
