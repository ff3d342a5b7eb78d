#include "experiments/suites/episode_rows.h"

#include <functional>
#include <string>

#include <nlohmann/json.hpp>

#include "core/formatted.h"
#include "experiments/results/leakage.h"
#include "experiments/results/table_notes.h"
#include "experiments/results/training_grids.h"
#include "experiments/support/text_grid.h"
#include "sim/trial/success_profile.h"

namespace segsim::experiments::suites {
namespace {

using Json = nlohmann::ordered_json;

std::string provenance_of(const results::StoredRun& stored, const std::string& name) {
  const auto found = stored.run.provenance.find(name);
  return found == stored.run.provenance.end() ? std::string() : found->second;
}

const std::string& family_of_scene(const results::StoredRun& stored,
                                   const std::string& scene) {
  for (const records::SceneRow& row : stored.scenes) {
    if (row.name == scene) return records::family_of(row);
  }
  return scene;
}

/// Of the weights that decided the trial; empty for the oracle.
std::string weights_of(const results::StoredRun& stored, const records::ArmRow& arm,
                       const std::string& scene) {
  const std::string own = provenance_of(stored, "weights/" + arm.name + "/" + scene);
  return own.empty() ? arm.weights_sha256 : own;
}

/// By the strictest named rule; null if the trial is not attributed.
Json strict_success(const records::TrialRow& trial) {
  const sim::SuccessProfile* rule =
      sim::find_success_profile(results::internal::kStrictestRule);
  if (rule == nullptr || !trial.counts() || !trial.why.known()) return nullptr;
  return sim::succeeded(*rule, records::trial_end(trial));
}

void for_each_row(const results::StoredRun& stored,
                  const std::function<void(const Json& row)>& use) {
  const results::ResultTable table = results::summarise(stored);
  for (const records::TrialRow& trial : stored.trials) {
    const records::ArmRow* arm = results::internal::find_arm(stored.arms, trial.arm);
    if (arm == nullptr) continue;
    const std::string& family = family_of_scene(stored, trial.scene);
    use({{"suite", stored.run.name},
         {"scene", trial.scene},
         {"pool", provenance_of(stored, "pool/" + family)},
         {"episode", trial.episode},
         {"goal", trial.goal_class},
         {"arm", records::family_of(*arm)},
         {"training", arm->name},
         {"repetition", trial.repetition},
         {"counts", trial.counts()},
         {"outcome", to_string(trial.outcome)},
         {"success", trial.success},
         {"strict_success", strict_success(trial)},
         {"spl", trial.spl},
         {"soft_spl", trial.soft_spl},
         {"path_m", trial.path_m},
         {"shortest_path_m", trial.shortest_path_m},
         {"sim_s", trial.sim_s},
         // Of this training, in this scene.
         {"leakage", results::internal::leakage_word(table, *arm, family)},
         {"weights_sha256", weights_of(stored, *arm, trial.scene)},
         {"state_hash", core::hex(trial.state_hash)}});
  }
}

std::string cell_of(const Json& value) {
  if (value.is_null()) return {};
  if (value.is_string()) return support::csv_cell(value.get<std::string>());
  if (value.is_boolean()) return value.get<bool>() ? "1" : "0";
  return value.dump();
}

}  // namespace

void write_episodes_csv(std::ostream& out, const results::StoredRun& stored) {
  bool first = true;
  for_each_row(stored, [&](const Json& row) {
    std::string header, line;
    for (const auto& [key, value] : row.items()) {
      header += (header.empty() ? "" : ",") + key;
      line += (&value == &row.front() ? "" : ",") + cell_of(value);
    }
    if (first) out << header << '\n';
    first = false;
    out << line << '\n';
  });
}

void write_episodes_jsonl(std::ostream& out, const results::StoredRun& stored) {
  // Bytes of foreign names that are no UTF-8 become U+FFFD instead of an exception.
  for_each_row(stored, [&](const Json& row) {
    out << row.dump(-1, ' ', false, Json::error_handler_t::replace) << '\n';
  });
}

}  // namespace segsim::experiments::suites
