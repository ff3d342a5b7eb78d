// Suites, their manifests and digests of stages (experiments/suites). The first byte says
// which: 'm' for a manifest.
#include "experiments/suites/suite.h"

#include "experiments/suites/manifest.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

using namespace experiments;

void parse(const std::string& bytes) {
  if (bytes.starts_with("m{")) {
    const suites::Manifest manifest =
        suites::read_manifest(in_file(bytes.substr(1), "manifest.json"));
    (void)suites::differences(manifest, {});
  } else {
    (void)suites::parse_suite(bytes, work_folder() / "homes-v1.yaml");
  }
}

std::vector<std::string> seeds() {
  suites::Manifest manifest;
  manifest.suite = "homes-v1";
  manifest.hashes = {{"suite", std::string(64, 'a')}, {"results", std::string(64, 'b')}};
  manifest.planned_trials = manifest.finished_trials = 4;
  manifest.made_by = {{"segsim", "0.2"}};
  return {project_file("experiments/suites/homes-v1.yaml"),
          "m" + written([&](const auto& file) { suites::write_manifest(file, manifest); })};
}

}  // namespace segsim::fuzz
