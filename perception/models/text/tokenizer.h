#pragma once

/// @file
/// Text -> the numbers that a text model reads. Vocabulary files come with the model:
///
///     WordPiece      vocab.txt of BERT (Grounding DINO, BLIP-2): one token a line
///     CLIP's BPE     merges.txt, or bpe_simple_vocab_16e6.txt unpacked: one merge a line. The
///                    vocabulary follows from the merges (Radford et al. 2021, Hugging Face's
///                    vocab.json agrees with it)
///     SentencePiece  *.model of the unigram kind (SigLIP)
///
/// Lower case and accents: ASCII and Latin-1. Other letters pass as they are.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace segsim::perception {

class Tokenizer {
 public:
  Tokenizer() = default;
  virtual ~Tokenizer() = default;
  Tokenizer(const Tokenizer&) = delete;
  Tokenizer& operator=(const Tokenizer&) = delete;

  /// Without the tokens around it.
  [[nodiscard]] virtual std::vector<std::int64_t> pieces(const std::string& text) const = 0;
  /// First and last token of every text; -1: the model has none. BERT: [CLS], [SEP].
  [[nodiscard]] virtual std::int64_t start_id() const = 0;
  [[nodiscard]] virtual std::int64_t end_id() const = 0;
  /// Fills the rest of a row.
  [[nodiscard]] virtual std::int64_t padding_id() const = 0;

  /// start, pieces, end; cut to `longest` tokens with the end kept.
  [[nodiscard]] std::vector<std::int64_t> encode(const std::string& text,
                                                 std::size_t longest) const;
};

/// Tells the kind by the content.
/// @throws core::InputError for another file, a token twice, or special tokens missing.
[[nodiscard]] std::unique_ptr<Tokenizer> load_tokenizer(const std::filesystem::path& file);

}  // namespace segsim::perception
