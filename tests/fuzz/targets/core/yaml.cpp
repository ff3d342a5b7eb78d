// Any YAML, read as by somebody who asks for everything in every way (core/config.h).
#include "core/config.h"
#include "core/error.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {
namespace {

template <class Ask>
void ask(const Ask& question) {
  try {
    question();
  } catch (const core::InputError&) {  // Another question may be answered.
  }
}

void visit(const core::ConfigNode& node) {
  (void)node.where();
  if (node.is_map()) {
    for (const std::string& key : node.keys()) {
      ask([&] { (void)node.numbers(key); });
      ask([&] { (void)node.texts(key); });
      ask([&] { (void)node.integer(key); });
      ask([&] { (void)node.number(key); });
      ask([&] { (void)node.boolean_or(key, false); });
      ask([&] { (void)core::choice(node, key, {"first", "second"}); });
      ask([&] { visit(node.child(key)); });
    }
    node.finish();
  } else if (node.is_list()) {
    for (const core::ConfigNode& element : node.as_list()) visit(element);
  } else {
    ask([&] { (void)node.as_number(); });
    ask([&] { (void)node.as_integer(); });
    ask([&] { (void)node.as_text(); });
  }
}

}  // namespace

void parse(const std::string& bytes) { visit(core::ConfigNode::parse(bytes, "input")); }

std::vector<std::string> seeds() {
  return {"a: 1\nb: [1, 2.5, x]\nc: {d: true, e: \"text\"}\nf:\n  - g: first\n  - h: -1e9\n",
          "base: &b {x: 1}\nother: *b\ntext: |\n  lines\n  of text\n", "[1, 2]\n"};
}

}  // namespace segsim::fuzz
