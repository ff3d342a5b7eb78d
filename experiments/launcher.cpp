// `segsim`: sets what libraries read from the environment while they are loaded, then becomes
// `segsim-light` or `segsim-main`, which lie beside it. core/process/kernel_choice.h says why
// it does the former, experiments/commands/light/command_list.h why there are two.
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <cstdio>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include "core/process/kernel_choice.h"
#include "experiments/commands/light/command_list.h"

namespace {

using segsim::core::KernelChoice;

/// Removes every `--fast`. Benchmarks ask what the machine can do: they are always fast.
KernelChoice take_choice(std::vector<char*>& arguments) {
  const auto is_fast = [](const char* word) { return std::strcmp(word, "--fast") == 0; };
  bool fast = arguments.size() > 1 && std::strcmp(arguments[1], "bench") == 0;
  std::erase_if(arguments, [&](const char* word) {
    if (!is_fast(word)) return false;
    fast = true;
    return true;
  });
  return fast ? KernelChoice::kFast : KernelChoice::kReproducible;
}

/// A limit of this process, and what the libraries of a program need of it while they are
/// loaded. Where OpenBLAS cannot have its buffers it asks again and again, before main().
struct MemoryLimit {
  decltype(RLIMIT_AS) resource;
  const char* name;
  rlim_t main_mb, light_mb;  ///< A quarter more than what was enough (docs/run_it.md).
};
constexpr MemoryLimit kMemoryLimits[] = {
    {RLIMIT_AS, "address space (ulimit -v)", 1500, 640},
    {RLIMIT_DATA, "data (ulimit -d)", 500, 400},
};
/// OpenBLAS has a buffer, and the system a stack, for each of its threads; one if results are
/// to be reproducible.
constexpr rlim_t kMore_mb_of_thread = 48;

/// @return  False if a limit leaves too little memory for the program to start; says so.
bool can_start(bool light, KernelChoice choice) {
  constexpr rlim_t kMb = 1000 * 1000;
  const rlim_t threads =
      choice == KernelChoice::kFast ? std::thread::hardware_concurrency() : 1;
  for (const MemoryLimit& limit : kMemoryLimits) {
    rlimit found{};
    if (getrlimit(limit.resource, &found) != 0 || found.rlim_cur == RLIM_INFINITY) continue;
    const rlim_t least_mb =
        (light ? limit.light_mb : limit.main_mb) + (threads - 1) * kMore_mb_of_thread;
    if (found.rlim_cur >= least_mb * kMb) continue;
    std::fprintf(stderr, "segsim: expected at least %llu MB of %s, found %llu MB\n",
                 static_cast<unsigned long long>(least_mb), limit.name,
                 static_cast<unsigned long long>(found.rlim_cur / kMb));
    return false;
  }
  return true;
}

/// A program beside this one, whatever name this one was called by; "" if the system does not
/// tell.
std::string program_file(const char* name) {
  char path[PATH_MAX];
  const ssize_t length = readlink("/proc/self/exe", path, sizeof path);
  if (length <= 0 || length == static_cast<ssize_t>(sizeof path)) return {};
  const std::string self(path, static_cast<std::size_t>(length));
  return self.substr(0, self.rfind('/') + 1) + name;
}

}  // namespace

int main(int argc, char** argv) {
  constexpr int kInputErrorExit = 2, kInternalErrorExit = 3;
  std::vector<char*> arguments(argv, argv + argc);
  KernelChoice choice = take_choice(arguments);
  if (choice == KernelChoice::kReproducible && !segsim::core::can_be_reproducible()) {
    choice = KernelChoice::kFast;  // `segsim doctor` and every run's record say so.
  }
  segsim::core::set_environment(choice);
  const std::vector<const char*> words(arguments.begin() + (argc > 0 ? 1 : 0),
                                       arguments.end());
  const bool light = segsim::experiments::commands::light::is_light(words);
  if (!can_start(light, choice)) return kInputErrorExit;
  arguments.push_back(nullptr);
  const std::string program = program_file(light ? "segsim-light" : "segsim-main");
  execv(program.c_str(), arguments.data());
  std::fprintf(stderr, "segsim: internal error: %s: expected the program, found: %s\n",
               program.c_str(), std::strerror(errno));
  return kInternalErrorExit;
}
