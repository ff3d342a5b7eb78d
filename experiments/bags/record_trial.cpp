#include "experiments/bags/record_trial.h"

#include <utility>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/bags/trial_bag.h"
#include "experiments/records/replay_log.h"
#include "experiments/runs/trial_replay.h"

namespace segsim::experiments::bags {

namespace fs = std::filesystem;

BagSummary record_trial(const fs::path& log_file, specs::SpecFolders folders,
                        const fs::path& output, ros::mcap::Compression compression) {
  const records::ReplayLog log = records::read_replay_log(log_file);
  if (folders.work.empty()) folders.work = runs::work_of_replay(log_file);
  const specs::ExperimentSpec spec = specs::parse_spec(log.spec_text, log.spec_file, folders);
  runs::TrialReplay replay(log, folders, true);
  BagSummary summary;
  core::write_file_atomically(output, [&](std::ostream& out) {
    ros::mcap::Writer writer(out, {.compression = compression});
    TrialBag bag(writer, spec.sensors);
    const records::ReplayLog again = replay.play(log, log_file, &bag);
    const records::Divergence found = records::first_divergence(log.ticks, again.ticks);
    if (found.tick >= 0) {
      throw core::InputError::expected(
          log_file.string(), "the same trial when it is played again",
          "another from tick " + std::to_string(found.tick) + " on (" + found.field + ")");
    }
    writer.add_metadata({"segsim",
                         {{"scene", log.scene},
                          {"episode", log.episode},
                          {"arm", log.arm},
                          {"repetition", std::to_string(log.repetition)},
                          {"outcome", sim::to_string(log.outcome)},
                          {"recorded_by", log.code_version}}});
    writer.close();
    summary.messages = bag.messages();
    summary.images = bag.images();
    summary.duration_s = log.ticks.empty() ? 0.0 : core::seconds(log.ticks.back().time_ns);
  });
  return summary;
}

}  // namespace segsim::experiments::bags
