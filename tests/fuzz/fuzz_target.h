#pragma once

/// @file
/// What every target of tests/fuzz/targets is made of. A target is one file that defines
/// `parse` and `seeds`; fuzz_target.cpp judges what `parse` throws. docs:
/// tests/fuzz/README.md.

#include <cstddef>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace segsim::fuzz {

// A target defines these two.

/// Gives the bytes to the parser, after repairing hashes and checksums that would refuse
/// almost everything before the parser sees it.
void parse(const std::string& bytes);
/// Small inputs that the parser takes, made by the program's own writers where it has them.
[[nodiscard]] std::vector<std::string> seeds();

/// The bytes as a file of this name in a folder of this process, the same one each time: what
/// was there before is replaced.
[[nodiscard]] std::filesystem::path in_file(const std::string& bytes,
                                            const std::string& name = "input");
/// That folder, for parsers that read several files.
[[nodiscard]] const std::filesystem::path& work_folder();
/// What `write` writes into the file that it is given.
[[nodiscard]] std::string written(
    const std::function<void(const std::filesystem::path& file)>& write,
    const std::string& name = "written");

/// A text file of this project, for seeds. The environment variable SEGSIM_SOURCE says where
/// the project is if it is not where it was built.
[[nodiscard]] std::string project_file(const std::string& name);

/// One input for parsers of several files: their contents with kPartsMark between them.
inline constexpr const char* kPartsMark = "\n--8<--\n";
[[nodiscard]] std::string join_parts(const std::vector<std::string>& parts);
/// Exactly `count` parts; those that are missing are empty.
[[nodiscard]] std::vector<std::string> split_parts(const std::string& bytes,
                                                   std::size_t count);

// For the two programs that are made of a target.

/// Whether the parser took an input; `refusal` is what it said if it did not. Anything that
/// the program would not end on with exit code 2 is thrown on.
struct Verdict {
  bool taken = false;
  std::string refusal;
};
[[nodiscard]] Verdict run_input(const std::string& bytes);

/// Seeds as files of a folder, which is made.
void write_seeds(const std::filesystem::path& folder);

}  // namespace segsim::fuzz
