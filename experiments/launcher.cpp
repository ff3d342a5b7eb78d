// `segsim`: sets what libraries read from the environment while they are loaded, then becomes
// `segsim-light` or `segsim-main`, which lie beside it. core/process/kernel_choice.h says why
// it does the former, experiments/commands/light/command_list.h why there are two.
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <cstdio>
#include <cstring>
#include <string>
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
  constexpr int kInternalErrorExit = 3;
  std::vector<char*> arguments(argv, argv + argc);
  KernelChoice choice = take_choice(arguments);
  if (choice == KernelChoice::kReproducible && !segsim::core::can_be_reproducible()) {
    choice = KernelChoice::kFast;  // `segsim doctor` and every run's record say so.
  }
  segsim::core::set_environment(choice);
  const std::vector<const char*> words(arguments.begin() + (argc > 0 ? 1 : 0),
                                       arguments.end());
  const bool light = segsim::experiments::commands::is_light(words);
  arguments.push_back(nullptr);
  const std::string program = program_file(light ? "segsim-light" : "segsim-main");
  execv(program.c_str(), arguments.data());
  std::fprintf(stderr, "segsim: internal error: %s: expected the program, found: %s\n",
               program.c_str(), std::strerror(errno));
  return kInternalErrorExit;
}
