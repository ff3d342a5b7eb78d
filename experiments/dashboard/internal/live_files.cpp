#include "experiments/dashboard/internal/live_files.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>

#include <nlohmann/json.hpp>

#include "experiments/trials/live_view.h"

namespace segsim::experiments::dashboard::internal {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr double kForgottenAfter_s = 120.0;
constexpr std::uintmax_t kLargestFile = 16U << 20U;
constexpr std::size_t kMostWorkers = 256;

double age_of(const fs::path& file, std::error_code& error) {
  const auto written = fs::last_write_time(file, error);
  return std::chrono::duration<double>(fs::file_time_type::clock::now() - written).count();
}

/// The whole file; empty if it is gone or too large.
std::string bytes_of(const fs::path& file) {
  std::error_code error;
  if (fs::file_size(file, error) > kLargestFile || error) return {};
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

bool is_live_header(const Json& json) {
  return json.is_object() && json.value("schema", "") == trials::kLiveSchema &&
         json.contains("parts") && json["parts"].is_array();
}

/// Worker and path of each file that is new enough.
std::vector<std::pair<std::string, fs::path>> recent_files(
    const std::vector<fs::path>& folders) {
  std::vector<std::pair<std::string, fs::path>> files;
  for (const fs::path& folder : folders) {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder / trials::kLiveFolder, error)) {
      const fs::path& file = entry.path();
      std::error_code gone;
      if (file.extension() != trials::kLiveEnding || file.filename().string().front() == '.')
        continue;
      if (age_of(file, gone) > kForgottenAfter_s || gone) continue;
      files.emplace_back(file.stem().string(), file);
    }
  }
  std::sort(files.begin(), files.end());
  if (files.size() > kMostWorkers) files.resize(kMostWorkers);
  return files;
}

}  // namespace

bool ask_for_live_files(const fs::path& folder) {
  const fs::path marker = folder / trials::kLiveFolder / trials::kLiveMarker;
  std::error_code error;
  fs::last_write_time(marker, fs::file_time_type::clock::now(), error);
  if (!error) return true;
  fs::create_directory(folder / trials::kLiveFolder, error);
  return static_cast<bool>(std::ofstream(marker));
}

std::vector<LiveFile> read_live_files(const std::vector<fs::path>& folders) {
  std::vector<LiveFile> live;
  for (const auto& [worker, file] : recent_files(folders)) {
    std::error_code error;
    const double age_s = age_of(file, error);
    std::ifstream in(file, std::ios::binary);
    std::string header;
    if (error || !std::getline(in, header)) continue;
    if (!is_live_header(Json::parse(header, nullptr, false))) continue;
    live.push_back({worker, std::max(0.0, age_s), std::move(header)});
  }
  return live;
}

std::optional<std::string> read_live_part(const std::vector<fs::path>& folders,
                                          const std::string& worker, const std::string& part) {
  const auto files = recent_files(folders);
  const auto found = std::find_if(files.begin(), files.end(),
                                  [&](const auto& file) { return file.first == worker; });
  if (found == files.end()) return std::nullopt;
  const std::string bytes = bytes_of(found->second);
  const std::size_t line = bytes.find('\n');
  if (line == std::string::npos) return std::nullopt;
  const Json header = Json::parse(bytes.substr(0, line), nullptr, false);
  if (!is_live_header(header)) return std::nullopt;
  std::size_t at = line + 1;
  for (const Json& entry : header["parts"]) {
    if (!entry.is_array() || entry.size() != 2 || !entry[0].is_string() ||
        !entry[1].is_number_unsigned()) {
      return std::nullopt;
    }
    const std::size_t size = entry[1].get<std::size_t>();
    if (size > bytes.size() - at) return std::nullopt;
    if (entry[0] == part) return bytes.substr(at, size);
    at += size;
  }
  return std::nullopt;
}

}  // namespace segsim::experiments::dashboard::internal
