#include "experiments/suites/manifest.h"

#include <algorithm>
#include <map>
#include <ostream>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/records/results_digest.h"
#include "perception/data/checked_json.h"

namespace segsim::experiments::suites {
namespace {

using Json = perception::OrderedCheckedJson;

constexpr const char* kWeights = "weights/";

/// Weights of the arm in every scene, if it has others in each; in the order of the scenes.
void add_weights(const results::StoredRun& stored, const records::ArmRow& arm,
                 Manifest& manifest) {
  const std::map<std::string, std::string>& provenance = stored.run.provenance;
  bool by_scene = false;
  for (const records::SceneRow& scene : stored.scenes) {
    const auto found = provenance.find(kWeights + arm.name + "/" + scene.name);
    if (found == provenance.end()) continue;
    by_scene = true;
    manifest.hashes.emplace_back("weights of " + arm.name + " in " + scene.name,
                                 found->second);
  }
  if (!by_scene && !arm.weights_sha256.empty()) {
    manifest.hashes.emplace_back("weights of " + arm.name, arm.weights_sha256);
  }
}

std::string short_hash(const std::string& sha256) {
  return sha256.empty() ? "none" : sha256.substr(0, 12);
}

}  // namespace

std::string Manifest::hash_of(const std::string& what) const {
  for (const auto& [name, sha256] : hashes) {
    if (name == what) return sha256;
  }
  return {};
}

Manifest manifest_of(const results::StoredRun& stored) {
  const records::RunRow& run = stored.run;
  Manifest manifest;
  manifest.suite = run.name;
  manifest.planned_trials = run.planned_trials;
  for (const records::TrialRow& trial : stored.trials) {
    manifest.finished_trials += trial.failed() ? 0 : 1;
  }
  manifest.hashes = {{"suite", core::sha256_hex(run.spec_text)}, {"spec", run.spec_sha256}};
  for (const records::SceneRow& scene : stored.scenes) {
    manifest.hashes.emplace_back("scene " + scene.name, scene.scene_sha256);
    manifest.hashes.emplace_back("episodes of " + scene.name, scene.episodes_sha256);
  }
  for (const records::ArmRow& arm : stored.arms) add_weights(stored, arm, manifest);
  if (manifest.finished_trials == manifest.planned_trials) {
    manifest.hashes.emplace_back("results", records::results_sha256(stored.trials));
  }
  const auto kernels = run.provenance.find("kernels");
  manifest.made_by = {
      {"segsim", run.code_version},
      {"kernels", kernels == run.provenance.end() ? "unknown" : kernels->second},
      {"machine", run.host}};
  return manifest;
}

void write_manifest(const std::filesystem::path& file, const Manifest& manifest) {
  Json json{{"schema", Manifest::kSchema},
            {"suite", manifest.suite},
            {"planned_trials", manifest.planned_trials},
            {"finished_trials", manifest.finished_trials}};
  for (const auto& [what, sha256] : manifest.hashes) json["hashes"][what] = sha256;
  for (const auto& [what, text] : manifest.made_by) json["made_by"][what] = text;
  core::write_file_atomically(file, [&](std::ostream& out) { out << json.dump(2) << '\n'; });
}

Manifest read_manifest(const std::filesystem::path& file) {
  const Json json = Json::parse(core::read_file(file), nullptr, false);
  const auto fail = [&](const std::string& expected, const std::string& found) {
    throw core::InputError::expected(file.string(), expected, found);
  };
  if (!json.is_object() || !json.contains("schema") || json["schema"] != Manifest::kSchema) {
    fail(std::string("a manifest, schema ") + Manifest::kSchema, "another file");
  }
  Manifest manifest;
  try {
    manifest.suite = json.at("suite").get<std::string>();
    manifest.planned_trials = json.at("planned_trials").get<int>();
    manifest.finished_trials = json.at("finished_trials").get<int>();
    for (const auto& [what, sha256] : json.at("hashes").items()) {
      manifest.hashes.emplace_back(what, sha256.get<std::string>());
    }
    for (const auto& [what, text] : json.at("made_by").items()) {
      manifest.made_by.emplace_back(what, text.get<std::string>());
    }
  } catch (const Json::exception& error) {
    fail("a whole manifest", error.what());
  }
  return manifest;
}

std::vector<std::string> differences(const Manifest& a, const Manifest& b) {
  std::vector<std::string> names;
  if (a.suite != b.suite) names.emplace_back("name of the suite");
  for (const auto& [what, sha256] : a.hashes) {
    if (b.hash_of(what) != sha256) names.push_back(what);
  }
  for (const auto& [what, sha256] : b.hashes) {
    if (a.hash_of(what).empty()) names.push_back(what);
  }
  return names;
}

void expect_same(const Manifest& expected, const std::string& a, const Manifest& found,
                 const std::string& b) {
  const std::vector<std::string> names = differences(expected, found);
  if (names.empty()) return;
  const std::string& first = names.front();
  const bool of_name = expected.suite != found.suite;
  const std::string more =
      names.size() == 1 ? "" : "; " + std::to_string(names.size()) + " hashes differ in all";
  throw core::InputError::expected(
      b + ": " + first,
      (of_name ? expected.suite : short_hash(expected.hash_of(first))) + " as in " + a,
      (of_name ? found.suite : short_hash(found.hash_of(first))) + more);
}

}  // namespace segsim::experiments::suites
