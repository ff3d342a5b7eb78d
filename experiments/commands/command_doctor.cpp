// `segsim doctor`: what this machine computes with, and whether its results are those
// recorded.
#include <cstdio>
#include <memory>

#include <CLI/CLI.hpp>

#include "core/check.h"
#include "core/error.h"
#include "core/process/kernel_choice.h"
#include "core/version.h"
#include "experiments/commands/commands.h"
#include "experiments/reproducibility/machine_record.h"
#include "experiments/reproducibility/stage_digests.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

struct DoctorFlags {
  fs::path digests, against, record;
};

void print_machine() {
  const reproducibility::MachineRecord machine = reproducibility::describe_machine();
  std::printf("segsim %s, %s kernels%s\n", core::version(), core::to_string(machine.kernels),
              core::can_be_reproducible() ? "" : " (this processor lacks AVX2 or FMA)");
  std::printf("processor %s\n", machine.processor.c_str());
  for (const auto& [name, has] : machine.features) {
    std::printf("  %-36s%s\n", name.c_str(), has.c_str());
  }
  std::printf("libraries\n");
  for (const auto& [name, version] : machine.libraries) {
    std::printf("  %-36s%s\n", name.c_str(), version.c_str());
  }
  std::printf("fingerprints (equal on two machines: that library computes the same bits)\n");
  for (const auto& [name, sha256] : machine.fingerprints) {
    std::printf("  %-36s%s\n", name.c_str(), sha256.substr(0, 12).c_str());
  }
}

fs::path digests_of(const fs::path& given) {
  return fs::is_directory(given) ? given / "digests.json" : given;
}

void examine(const DoctorFlags& flags) {
  if (flags.digests.empty()) {
    print_machine();
    return;
  }
  const reproducibility::DigestRecord found =
      reproducibility::read_digests(digests_of(flags.digests));
  if (!flags.record.empty()) {
    reproducibility::record_digests(flags.record, found);
    std::printf("%s\n", flags.record.c_str());
    return;
  }
  if (flags.against.empty()) {
    std::printf("%s by segsim %s on %s, %s kernels\n%s", found.experiment.c_str(),
                found.program.c_str(), found.machine.processor.c_str(),
                core::to_string(found.machine.kernels),
                reproducibility::digests_in_words(found.stages).c_str());
    return;
  }
  const reproducibility::DigestComparison comparison = reproducibility::compare_digests(
      reproducibility::read_digests(digests_of(flags.against)), found);
  std::fputs(comparison.text.c_str(), stdout);
  if (!comparison.equal) {
    throw core::CheckFailed("the digests are not those of " + flags.against.string());
  }
}

}  // namespace

void add_doctor_command(CLI::App& app) {
  auto flags = std::make_shared<DoctorFlags>();
  CLI::App* command = light::add_listed(app, light::kCommands, "doctor");
  CLI::Option* digests = command->add_option(
      "--digests", flags->digests, "Work folder of `segsim run`, or its digests.json");
  command
      ->add_option("--against", flags->against,
                   "Another run's, or a record as tests/system/digests/small.json; "
                   "exit code 1 if a stage differs")
      ->needs(digests);
  command
      ->add_option("--record", flags->record,
                   "Make this record of the run, or add this processor to it")
      ->needs(digests);
  command->callback([flags] { examine(*flags); });
}

}  // namespace segsim::experiments::commands
