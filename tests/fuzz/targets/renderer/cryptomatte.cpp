// Names in the header of an EXR file (renderer/files/cryptomatte.h).
#include "renderer/files/cryptomatte.h"

#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  const std::vector<std::string> parts = split_parts(bytes, 2);
  (void)renderer::parse_cryptomatte_manifest(parts[0], "input");
  (void)renderer::IdNames::from_legend("class", parts[1], "input");
}

std::vector<std::string> seeds() {
  return {join_parts({R"({"wall":"1a2b3c4d","a \"couch\"":"00000001"})",
                      R"({"1":"wall","257":"couch \u00e9"})"})};
}

}  // namespace segsim::fuzz
