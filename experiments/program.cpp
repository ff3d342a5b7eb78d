#include "experiments/program.h"

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <new>
#include <stdexcept>
#include <string>
#include <system_error>
#include <vector>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "core/check.h"
#include "core/config.h"
#include "core/error.h"
#include "core/interrupted.h"
#include "core/process/process_memory.h"
#include "core/version.h"

namespace segsim::experiments {
namespace {

enum ExitCode {
  kDone = 0,
  kCheckFailed = 1,
  kInputError = 2,
  kInternalError = 3,
  kStopped = 4
};

/// One line, whatever a damaged file has put into a message.
int end(ExitCode code, const std::string& message) {
  std::string line = message;
  std::replace_if(
      line.begin(), line.end(),
      [](char c) { return c == '\n' || c == '\r' || c == '\t' || c == '\0'; }, ' ');
  const bool names_program = line.starts_with("segsim");  // As a place: "segsim render".
  std::fprintf(stderr, "%s%s\n", names_program ? "" : "segsim: ", line.c_str());
  return code;
}

int end_on_input(const std::string& place, const std::string& expected,
                 const std::string& found) {
  return end(kInputError, core::InputError::expected(place, expected, found).what());
}

/// Whether an exception of a library that has no type for it says that memory is short:
/// libtorch, OpenCV.
bool is_about_memory(const std::exception& error) {
  const std::string text = error.what();
  for (const char* words : {"can't allocate memory", "out of memory", "not enough memory",
                            "Insufficient memory", "Failed to allocate"}) {
    if (text.find(words) != std::string::npos) return true;
  }
  return false;
}

int end_without_memory() {
  return end(kInputError, "expected memory for the scene and its images, found none");
}

/// What every exception means to the user: the one place that decides. Readers throw
/// core::InputError with the place; what libraries throw in their stead is the fault of the
/// input as well, and only says less about where. What is left is a bug of ours.
/// @param command  The place where nothing closer is known: "segsim render".
int end_of(const std::exception_ptr& thrown, const std::string& command) {
  try {
    std::rethrow_exception(thrown);
  } catch (const core::InputError& error) {
    return end(kInputError, error.what());
  } catch (const core::Interrupted& error) {
    return end(kStopped, error.what());
  } catch (const core::CheckFailed& error) {
    return end(kCheckFailed, error.what());
  } catch (const std::filesystem::filesystem_error& error) {  // A name beyond NAME_MAX.
    const std::string path = error.path1().string();
    return end_on_input(path.empty() ? command : path, "a file or folder that can be used",
                        error.code().message());
  } catch (const std::system_error& error) {  // No thread is left.
    return end_on_input(command, "what it needs of the system", error.code().message());
  } catch (const nlohmann::json::exception& error) {
    return end_on_input(command, "JSON of the documented form", error.what());
  } catch (const std::bad_alloc&) {
    return end_without_memory();
  } catch (const std::length_error& error) {
    return end_on_input(command, "sizes that fit into memory",
                        std::string("one that does not (") + error.what() + ")");
  } catch (const std::exception& error) {
    if (is_about_memory(error)) return end_without_memory();
    return end(kInternalError, std::string("internal error: ") + error.what());
  } catch (...) {
    return end(kInternalError, "internal error: an exception of unknown kind");
  }
}

/// A word that is a number as a whole, and not a finite one: "nan", "-inf", "1e999".
bool is_not_finite(const std::string& word) {
  char* stop = nullptr;
  const double value = std::strtod(word.c_str(), &stop);
  return stop != word.c_str() && *stop == '\0' && !std::isfinite(value);
}

/// No flag takes a NaN or an infinity, and a range lets NaN through, as it is neither below
/// nor above: so all flags that take numbers refuse them here.
void refuse_non_numbers(CLI::App& app) {
  for (CLI::Option* option : app.get_options()) {
    if (option->get_type_name().starts_with("TEXT")) continue;  // A name may be "nan".
    option->check(
        [](const std::string& word) {
          return is_not_finite(word) ? "expected a finite number, found " + word
                                     : std::string();
        },
        "");
  }
  for (CLI::App* command : app.get_subcommands([](CLI::App*) { return true; })) {
    refuse_non_numbers(*command);
  }
}

/// CLI11 answers `segsim nosuch --help` with the help of what stands before the unknown word,
/// as if all were well.
/// @throws core::InputError for a word in the place of a subcommand that is none.
void require_known_command(CLI::App& app, int argc, char** argv) {
  std::string place = "segsim";
  CLI::App* at = &app;
  for (int i = 1; i < argc && at->get_require_subcommand_min() > 0; ++i) {
    const std::string word = argv[i];
    // `segsim` itself has flags alone; behind a subcommand a flag may take the next word.
    if (word.starts_with('-')) {
      if (at == &app) continue;
      return;
    }
    CLI::App* next = nullptr;
    std::vector<std::string> names;
    for (CLI::App* known : at->get_subcommands([](CLI::App*) { return true; })) {
      names.push_back(known->get_name());
      if (names.back() == word) next = known;
    }
    if (next == nullptr) {
      const std::string near = core::nearest_word(word, names);
      throw core::InputError::expected(
          place,
          "a subcommand of `" + place + " --help`" +
              (near.empty() ? "" : " (did you mean \"" + near + "\"?)"),
          "\"" + word + "\"");
    }
    place += " " + word;
    at = next;
  }
}

/// "segsim render" of a command line: a place for errors that know none.
std::string command_of(int argc, char** argv) {
  std::string command = "segsim";
  if (argc > 1 && argv[1][0] != '-') command += std::string(" ") + argv[1];
  return command;
}

}  // namespace

int run_program(int argc, char** argv, void (*add_commands)(CLI::App& app)) {
  core::keep_freed_memory();
  std::signal(SIGXFSZ, SIG_IGN);  // A file at its limit is an error like a full disk.
  CLI::App app{
      "Fast-SegSim: does this perception change make the robot reach its goal more often?\n"
      "Closed-loop navigation trials in reconstructed scenes.",
      "segsim"};
  app.set_version_flag("--version", core::version());
  bool fast = false;  // The launcher takes it away.
  app.add_flag("--fast", fast,
               "Use whatever this processor has: quicker, and not comparable bit by bit with "
               "other machines (docs/reproducibility.md)");
  app.require_subcommand(1);
  app.footer(
      "Exit codes: 0 done, 1 an expectation failed, 2 bad input, too little memory or room on "
      "the disk,\n3 internal error, 4 stopped by a signal with work left.\n"
      "Each subcommand has its own --help.");
  add_commands(app);
  refuse_non_numbers(app);

  try {
    require_known_command(app, argc, argv);
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // Prints help or the version.
    return end(kInputError, std::string(error.what()) + " (--help says what can be given)");
  } catch (...) {
    return end_of(std::current_exception(), command_of(argc, argv));
  }
  return kDone;
}

}  // namespace segsim::experiments
