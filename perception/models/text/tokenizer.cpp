#include "perception/models/text/tokenizer.h"

#include "core/error.h"
#include "core/file_io.h"
#include "perception/models/text/internal/tokenizers.h"

namespace segsim::perception {

std::vector<std::int64_t> Tokenizer::encode(const std::string& text,
                                            std::size_t longest) const {
  std::vector<std::int64_t> ids;
  if (start_id() >= 0) ids.push_back(start_id());
  const std::vector<std::int64_t> found = pieces(text);
  ids.insert(ids.end(), found.begin(), found.end());
  const std::size_t end = end_id() >= 0 ? 1 : 0;
  if (ids.size() + end > longest) ids.resize(longest > end ? longest - end : 0);
  if (end == 1) ids.push_back(end_id());
  return ids;
}

std::unique_ptr<Tokenizer> load_tokenizer(const std::filesystem::path& file) {
  const std::string text = core::read_file(file);
  if (file.extension() == ".model") return make_unigram_tokenizer(text, file.string());
  if (text.find('\0') != std::string::npos || text.empty()) {
    throw core::InputError::expected(
        file.string(), "vocab.txt of BERT, merges.txt of CLIP, or a SentencePiece .model",
        "another file");
  }
  if (text.starts_with("#version") || text.starts_with("\"bpe_simple_vocab")) {
    return make_clip_tokenizer(text, file.string());
  }
  return make_word_piece_tokenizer(text, file.string());
}

}  // namespace segsim::perception
