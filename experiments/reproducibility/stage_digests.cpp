#include "experiments/reproducibility/stage_digests.h"

#include <algorithm>
#include <cstdio>
#include <functional>
#include <ostream>
#include <span>
#include <sstream>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/data/dataset.h"

namespace segsim::experiments::reproducibility {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr std::size_t kShownDigits = 12;

/// Files below a folder that `wanted` takes, by name, so that the order is the same
/// everywhere.
std::vector<fs::path> files_below(const fs::path& folder,
                                  const std::function<bool(const fs::path&)>& wanted) {
  std::vector<fs::path> files;
  if (!fs::is_directory(folder)) return files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file() && wanted(entry.path())) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::string digest_of_files(const fs::path& folder, const std::vector<fs::path>& files) {
  std::string listing;
  for (const fs::path& file : files) {
    listing += fs::relative(file, folder).string() + " " + core::sha256_of_file(file) + "\n";
  }
  return core::sha256_hex(listing);
}

std::vector<fs::path> folders_in(const fs::path& folder) {
  std::vector<fs::path> folders;
  if (!fs::is_directory(folder)) return folders;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.is_directory()) folders.push_back(entry.path());
  }
  std::sort(folders.begin(), folders.end());
  return folders;
}

/// The frames of a capture; its notes name the program.
std::string digest_of_capture(const fs::path& folder) {
  return digest_of_files(folder, files_below(folder, [](const fs::path& file) {
                           return file.extension() == ".png" || file.extension() == ".txt";
                         }));
}

/// All parts of a bundle; its manifest names program and source.
std::string digest_of_bundle(const fs::path& folder) {
  return digest_of_files(folder, files_below(folder, [](const fs::path& file) {
                           return file.filename() != "scene.yaml";
                         }));
}

/// The episodes; the line before them names program and bundle.
std::string digest_of_episodes(const fs::path& file) {
  const std::string text = core::read_file(file);
  return core::sha256_hex(text.substr(std::min(text.size(), text.find('\n') + 1)));
}

/// Pictures and boxes; the JSON around them names scenes by hashes that hold the program.
std::string digest_of_views(const fs::path& json) {
  const perception::CocoDataset views = perception::read_coco(json);
  std::ostringstream listing;
  for (const perception::LabeledImage& image : views.images) {
    listing << image.file << " " << core::sha256_of_file(views.image_file(image));
    for (const auto& box : image.boxes) {
      listing << " " << box.class_index << ":" << box.box.x0 << "," << box.box.y0 << ","
              << box.box.x1 << "," << box.box.y1;
    }
    listing << "\n";
  }
  return core::sha256_hex(listing.str());
}

std::string digest_of_weights(const fs::path& file) {
  const perception::DetectorWeights weights = perception::read_weights(file);
  std::string text = weights.architecture + " " + std::to_string(weights.score_threshold);
  for (const perception::NamedTensor& tensor : weights.tensors) {
    text +=
        "\n" + tensor.name + " " + core::sha256_hex(std::as_bytes(std::span(tensor.values)));
  }
  return core::sha256_hex(text);
}

Json json_of(const MachineRecord& machine) {
  return {{"kernels", core::to_string(machine.kernels)},
          {"processor", machine.processor},
          {"features", machine.features},
          {"libraries", machine.libraries},
          {"fingerprints", machine.fingerprints}};
}

using Texts = std::map<std::string, std::string>;

MachineRecord machine_from(const nlohmann::json& json) {
  MachineRecord machine;
  if (json.at("kernels") == core::to_string(core::KernelChoice::kReproducible)) {
    machine.kernels = core::KernelChoice::kReproducible;
  }
  machine.processor = json.at("processor").get<std::string>();
  machine.features = json.at("features").get<Texts>();
  machine.libraries = json.at("libraries").get<Texts>();
  machine.fingerprints = json.at("fingerprints").get<Texts>();
  return machine;
}

std::string name_of(const StageDigest& digest) {
  return std::string(to_string(digest.stage)) +
         (digest.subject.empty() ? "" : " " + digest.subject);
}

/// A line for each entry that the two do not share.
void list_differences(const char* what, const Texts& recorded, const Texts& found,
                      std::string& text) {
  for (const auto& [name, value] : recorded) {
    const auto other = found.find(name);
    const std::string here = other == found.end() ? "none" : other->second;
    if (here == value) continue;
    text += std::string("  ") + what + " " + name + ": recorded " + value.substr(0, 40) +
            ", here " + here.substr(0, 40) + "\n";
  }
}

}  // namespace

std::vector<StageDigest> digest_stages(const fs::path& work,
                                       const std::vector<fs::path>& bundles,
                                       const std::string& results_sha256) {
  std::vector<StageDigest> stages;
  for (const fs::path& folder : folders_in(work / "captures")) {
    stages.push_back({DigestStage::kCapture, folder.filename(), digest_of_capture(folder)});
  }
  for (const fs::path& folder : bundles) {
    stages.push_back(
        {DigestStage::kReconstruction, folder.filename(), digest_of_bundle(folder)});
  }
  const auto add_files = [&](DigestStage stage, const fs::path& folder, const char* ending,
                             std::string (*digest)(const fs::path&)) {
    if (!fs::is_directory(folder)) return;
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(folder)) {
      if (entry.path().extension() == ending) files.push_back(entry.path());
    }
    std::sort(files.begin(), files.end());
    for (const fs::path& file : files) {
      const fs::path subject = fs::relative(file, work);
      stages.push_back({stage, subject.parent_path() / subject.stem(), digest(file)});
    }
  };
  add_files(DigestStage::kPhrases, work / "phrases", ".json", core::sha256_of_file);
  add_files(DigestStage::kEpisodes, work / "episodes", ".jsonl", digest_of_episodes);
  for (const fs::path& folder : folders_in(work)) {  // "views", and one for each further seed.
    if (folder.filename().string().starts_with("views")) {
      add_files(DigestStage::kLabels, folder, ".json", digest_of_views);
    }
  }
  add_files(DigestStage::kWeights, work, ".weights", digest_of_weights);
  if (!results_sha256.empty()) stages.push_back({DigestStage::kTrials, "", results_sha256});
  return stages;
}

void write_digests(const fs::path& file, const DigestRecord& record) {
  Json stages = Json::array();
  for (const StageDigest& digest : record.stages) {
    stages.push_back({{"stage", to_string(digest.stage)},
                      {"subject", digest.subject},
                      {"sha256", digest.sha256}});
  }
  const Json json{{"schema", DigestRecord::kSchema},
                  {"experiment", record.experiment},
                  {"spec_sha256", record.spec_sha256},
                  {"program", record.program},
                  {"machine", json_of(record.machine)},
                  {"confirmed_on", record.confirmed_on},
                  {"stages", stages}};
  core::write_file_atomically(file, [&](std::ostream& out) { out << json.dump(2) << '\n'; });
}

DigestRecord read_digests(const fs::path& file) {
  const std::string text = core::read_file(file);
  try {
    const auto json = nlohmann::json::parse(text);
    if (json.at("schema") != DigestRecord::kSchema) throw std::invalid_argument("schema");
    DigestRecord record;
    record.experiment = json.at("experiment").get<std::string>();
    record.spec_sha256 = json.at("spec_sha256").get<std::string>();
    record.program = json.at("program").get<std::string>();
    record.machine = machine_from(json.at("machine"));
    record.confirmed_on = json.at("confirmed_on").get<std::vector<std::string>>();
    for (const auto& stage : json.at("stages")) {
      record.stages.push_back(
          {digest_stage_from(stage.at("stage").get<std::string>(), file.string() + ": stages"),
           stage.at("subject").get<std::string>(), stage.at("sha256").get<std::string>()});
    }
    return record;
  } catch (const core::InputError&) {
    throw;
  } catch (const std::exception& error) {
    throw core::InputError::expected(
        file.string(), std::string("digests of a run (") + DigestRecord::kSchema + ")",
        error.what());
  }
}

void record_digests(const fs::path& file, const DigestRecord& run) {
  if (!fs::exists(file)) {
    write_digests(file, run);
    return;
  }
  DigestRecord record = read_digests(file);
  const DigestComparison comparison = compare_digests(record, run);
  if (!comparison.equal) {
    throw core::CheckFailed(file.string() + " stays as it is:\n" + comparison.text);
  }
  for (const std::string& processor : run.confirmed_on) {
    const auto known =
        std::find(record.confirmed_on.begin(), record.confirmed_on.end(), processor);
    if (known == record.confirmed_on.end()) record.confirmed_on.push_back(processor);
  }
  write_digests(file, record);
}

std::string digests_in_words(const std::vector<StageDigest>& stages) {
  std::string text;
  for (const StageDigest& digest : stages) {
    char line[160];
    std::snprintf(line, sizeof line, "  %-16s%-24s%s\n", to_string(digest.stage),
                  digest.subject.c_str(), digest.sha256.substr(0, kShownDigits).c_str());
    text += line;
  }
  return text;
}

DigestComparison compare_digests(const DigestRecord& recorded, const DigestRecord& found) {
  DigestComparison result;
  if (recorded.spec_sha256 != found.spec_sha256) {
    result.text = "The text of the spec is another one than that of the record.\n";
  }
  bool told = false;
  for (const StageDigest& expected : recorded.stages) {
    const auto same_stage = [&](const StageDigest& d) {
      return name_of(d) == name_of(expected);
    };
    const auto here = std::find_if(found.stages.begin(), found.stages.end(), same_stage);
    const bool equal = here != found.stages.end() && here->sha256 == expected.sha256;
    result.text += "  " + name_of(expected) + ": ";
    if (equal) {
      result.text += "as recorded\n";
      continue;
    }
    result.equal = false;
    result.text += here == found.stages.end()
                       ? "missing"
                       : "recorded " + expected.sha256.substr(0, kShownDigits) + ", here " +
                             here->sha256.substr(0, kShownDigits);
    if (!told) result.text += "   <- the first that departs";
    told = true;
    result.text += "\n";
  }
  if (result.equal) {
    result.text += "All stages are equal to the record to the last bit.\n";
    return result;
  }
  std::string why;
  const auto one = [](const std::string& value) { return Texts{{"is", value}}; };
  list_differences("program", one(recorded.program), one(found.program), why);
  list_differences("kernels", one(core::to_string(recorded.machine.kernels)),
                   one(core::to_string(found.machine.kernels)), why);
  list_differences("library", recorded.machine.libraries, found.machine.libraries, why);
  list_differences("computes other bits:", recorded.machine.fingerprints,
                   found.machine.fingerprints, why);
  list_differences("processor", one(recorded.machine.processor), one(found.machine.processor),
                   why);
  list_differences("processor feature", recorded.machine.features, found.machine.features,
                   why);
  result.text += why.empty() ? "The two machines do not differ in anything that is recorded.\n"
                             : "What differs between the two machines:\n" + why;
  return result;
}

}  // namespace segsim::experiments::reproducibility
