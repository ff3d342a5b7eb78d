// From one vocabulary to another (perception/data/class_map.h).
#include "perception/data/class_map.h"

#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  const perception::ClassMap map = perception::read_class_map(in_file(bytes));
  (void)map.find("Two red_arm chairs");
}

std::vector<std::string> seeds() {
  return {
      "schema: segsim.class_map\nversion: 1\ntitle: test\nfree_text: true\nclasses:\n"
      "  couch: [sofa, sofa chair]\n  tv: [tv_monitor]\nleave_out: [unknown]\n"};
}

}  // namespace segsim::fuzz
