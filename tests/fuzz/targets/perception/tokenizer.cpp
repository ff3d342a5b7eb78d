// Vocabularies of texts: word pieces, byte pairs and, of inputs that begin with a line feed as
// its messages do, unigrams of SentencePiece (perception/models/text).
#include "perception/models/text/tokenizer.h"

#include "tests/fuzz/fuzz_target.h"
#include "tests/perception/checkpoint_writer.h"

namespace segsim::fuzz {
namespace {

/// A message of SentencePiece's model: text, score, type.
std::string piece(const std::string& text, float score, int type) {
  std::string inner = "\x0a" + std::string(1, static_cast<char>(text.size())) + text + "\x15";
  perception::append(inner, score);
  inner += std::string("\x18") + static_cast<char>(type);
  return "\x0a" + std::string(1, static_cast<char>(inner.size())) + inner;
}

}  // namespace

void parse(const std::string& bytes) {
  const char* name = bytes.starts_with('\n') ? "vocabulary.model" : "vocabulary.txt";
  const auto tokenizer = perception::load_tokenizer(in_file(bytes, name));
  (void)tokenizer->encode("A red ch\u00e1ir, 2 tables!", 16);
}

std::vector<std::string> seeds() {
  return {"[PAD]\n[UNK]\n[CLS]\n[SEP]\n.\nchair\noffice\ntable\n##s\n",
          "#version: 0.2\nc h\nch a\na i\nai r</w>\n",
          piece("<unk>", 0, 2) + piece("</s>", 0, 3) + piece("\u2581", -2, 1) +
              piece("c", -4, 1) + piece("hair", -3, 1)};
}

}  // namespace segsim::fuzz
