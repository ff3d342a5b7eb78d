// Results databases (experiments/records/store.h). Input is SQL that is run on a small one;
// input that begins as an SQLite file is taken as it is.
#include <sqlite3.h>

#include <sstream>

#include "experiments/records/store.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/targets/experiments/limited_sql.h"
#include "tests/system/small_results.h"

namespace segsim::fuzz {
namespace {

using namespace experiments;

const std::string& small_database() {
  static const std::string bytes =
      written([](const auto& file) { tests::write_small_results(file); }, "small.sqlite");
  return bytes;
}

}  // namespace

void parse(const std::string& bytes) {
  const bool whole = bytes.starts_with("SQLite format 3");
  const std::filesystem::path file =
      in_file(whole ? bytes : small_database(), "results.sqlite");
  if (!whole) run_limited_sql(file, bytes);
  for (const auto& name : {"results.sqlite-wal", "results.sqlite-shm"}) {
    std::filesystem::remove(work_folder() / name);
  }
  const records::Store store = records::Store::for_reading(file);
  for (const records::RunRow& run : store.runs()) {
    (void)store.scenes(run.run_id);
    (void)store.arms(run.run_id);
    (void)store.finish_times(run.run_id, 3);
    std::ostringstream csv;
    records::write_trials_csv(csv, store.trials(run.run_id));
  }
}

std::vector<std::string> seeds() {
  return {"UPDATE trials SET success = 0 WHERE trial_id = 1;",
          "UPDATE runs SET title = 'other', planned_trials = 3;",
          "DELETE FROM trials WHERE outcome = 'timeout';", small_database()};
}

}  // namespace segsim::fuzz
