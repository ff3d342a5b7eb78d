#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "perception/models/text/tokenizer.h"

namespace segsim::perception {

/// A caption "chair . office table ." as Grounding DINO reads it: tokens of a phrase and the
/// dot behind it see one another and count their positions from 0; so do [CLS] and [SEP]
/// alone.
struct PromptTokens {
  std::vector<std::int64_t> ids;
  std::vector<std::int64_t> positions;                     ///< Within the phrase.
  std::vector<std::int64_t> attention;                     ///< [ids, ids], 1 where seen.
  std::vector<std::pair<std::size_t, std::size_t>> spans;  ///< Per phrase: first, end.
};

[[nodiscard]] PromptTokens tokenize_phrases(const std::vector<std::string>& phrases,
                                            const Tokenizer& tokenizer);

}  // namespace segsim::perception
