/// Benchmarks run with the memory settings of the program. --record=FILE saves a record for
/// results/ (results/README.md).

#include <cstdio>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include <benchmark/benchmark.h>

#include "core/error.h"
#include "core/file_io.h"
#include "core/process/measurement_record.h"
#include "core/process/process_memory.h"

namespace {

/// "p99_ms" is p99 [ms].
segsim::core::MeasuredValue counter_value(const std::string& case_name,
                                          const std::string& counter, double value) {
  for (const std::string unit : {"ms", "us", "s"}) {
    const std::string ending = "_" + unit;
    if (counter.size() > ending.size() && counter.ends_with(ending)) {
      return {case_name, counter.substr(0, counter.size() - ending.size()), unit, value};
    }
  }
  return {case_name, counter, "", value};
}

/// Prints as always, and keeps what is printed.
class RecordingReporter : public benchmark::ConsoleReporter {
 public:
  void ReportRuns(const std::vector<Run>& runs) override {
    ConsoleReporter::ReportRuns(runs);
    for (const Run& run : runs) {
      if (!run.error_occurred) add(run);
    }
  }

  [[nodiscard]] const segsim::core::MeasurementRecord& record() const { return record_; }

 private:
  void add(const Run& run) {
    const std::string name =
        run.benchmark_name() + (run.report_label.empty() ? "" : ", " + run.report_label);
    const char* unit = benchmark::GetTimeUnitString(run.time_unit);
    record_.values.push_back({name, "CPU time", unit, run.GetAdjustedCPUTime()});
    record_.values.push_back({name, "real time", unit, run.GetAdjustedRealTime()});
    for (const auto& [counter, value] : run.counters) {
      record_.values.push_back(counter_value(name, counter, value.value));
    }
  }

  segsim::core::MeasurementRecord record_{"Benchmarks", false, {}};
};

/// Takes --record=FILE out of the arguments.
std::string take_record_file(int& argc, char** argv) {
  constexpr std::string_view kFlag = "--record=";
  std::string file;
  int kept = 0;
  for (int i = 0; i < argc; ++i) {
    const std::string_view argument = argv[i];
    if (argument.substr(0, kFlag.size()) == kFlag) {
      file = argument.substr(kFlag.size());
    } else {
      argv[kept++] = argv[i];
    }
  }
  argc = kept;
  argv[argc] = nullptr;
  return file;
}

void save(const std::string& file, const segsim::core::MeasurementRecord& record) {
  if (record.values.empty()) {
    throw segsim::core::InputError::expected("--record", "a benchmark that ran", "none");
  }
  segsim::core::write_file_atomically(
      file, [&](std::ostream& out) { out << segsim::core::record_text(record); });
}

}  // namespace

int main(int argc, char** argv) {
  segsim::core::keep_freed_memory();
  const std::string file = take_record_file(argc, argv);
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  if (file.empty()) {
    benchmark::RunSpecifiedBenchmarks();
  } else {
    RecordingReporter reporter;
    benchmark::RunSpecifiedBenchmarks(&reporter);
    try {
      save(file, reporter.record());
    } catch (const segsim::core::InputError& error) {
      std::fprintf(stderr, "%s\n", error.what());
      return 2;
    }
  }
  benchmark::Shutdown();
}
