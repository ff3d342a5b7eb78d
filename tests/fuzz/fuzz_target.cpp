#include "tests/fuzz/fuzz_target.h"

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <new>
#include <stdexcept>
#include <system_error>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/process/temporary_folder.h"

namespace segsim::fuzz {
namespace {

namespace fs = std::filesystem;

std::string bytes_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

const fs::path& work_folder() {
  static const core::TemporaryFolder folder("segsim_fuzz");
  return folder.path();
}

fs::path in_file(const std::string& bytes, const std::string& name) {
  fs::path file = work_folder() / name;
  std::ofstream(file, std::ios::binary | std::ios::trunc) << bytes;
  return file;
}

std::string written(const std::function<void(const fs::path& file)>& write,
                    const std::string& name) {
  const fs::path file = work_folder() / name;
  write(file);
  std::string bytes = bytes_of(file);
  fs::remove(file);
  return bytes;
}

std::string project_file(const std::string& name) {
  const char* elsewhere = std::getenv("SEGSIM_SOURCE");
  return core::read_file(fs::path(elsewhere != nullptr ? elsewhere : SEGSIM_SOURCE) / name);
}

std::string join_parts(const std::vector<std::string>& parts) {
  std::string bytes;
  for (std::size_t i = 0; i < parts.size(); ++i) bytes += (i > 0 ? kPartsMark : "") + parts[i];
  return bytes;
}

std::vector<std::string> split_parts(const std::string& bytes, std::size_t count) {
  std::vector<std::string> parts;
  std::size_t begin = 0;
  while (parts.size() + 1 < count) {
    const std::size_t mark = bytes.find(kPartsMark, begin);
    if (mark == std::string::npos) break;
    parts.push_back(bytes.substr(begin, mark - begin));
    begin = mark + std::strlen(kPartsMark);
  }
  parts.push_back(bytes.substr(begin));
  parts.resize(count);
  return parts;
}

/// The exceptions that experiments/program.cpp ends on with exit code 2.
Verdict run_input(const std::string& bytes) {
  try {
    parse(bytes);
    return {true, {}};
  } catch (const core::InputError& error) {
    return {false, error.what()};
  } catch (const std::system_error& error) {  // Of files, too.
    return {false, error.what()};
  } catch (const nlohmann::json::exception& error) {
    return {false, error.what()};
  } catch (const std::bad_alloc& error) {
    return {false, error.what()};
  } catch (const std::length_error& error) {
    return {false, error.what()};
  }
}

void write_seeds(const fs::path& folder) {
  fs::create_directories(folder);
  int number = 0;
  for (const std::string& seed : seeds()) {
    std::ofstream(folder / ("seed-" + std::to_string(number++)), std::ios::binary) << seed;
  }
}

}  // namespace segsim::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  (void)segsim::fuzz::run_input(bytes);
  return 0;
}

/// `--seeds FOLDER` in place of everything else: also where libFuzzer has the main function.
extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  if (*argc != 3 || std::strcmp((*argv)[1], "--seeds") != 0) return 0;
  segsim::fuzz::write_seeds((*argv)[2]);
  std::exit(0);
}
