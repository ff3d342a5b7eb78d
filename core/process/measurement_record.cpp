#include "core/process/measurement_record.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <system_error>
#include <thread>

#include "core/check.h"
#include "core/version.h"

namespace segsim::core {
namespace {

namespace fs = std::filesystem;

/// As JSON.
std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    if (static_cast<unsigned char>(c) < 0x20) {
      char escape[8];
      std::snprintf(escape, sizeof escape, "\\u%04x", static_cast<unsigned>(c));
      out += escape;
    } else {
      out += c;
    }
  }
  return out + "\"";
}

std::string quoted_or_null(const std::optional<std::string>& text) {
  return text ? quoted(*text) : "null";
}

/// More digits than any time has.
std::string number(double value) {
  SEGSIM_CHECK(std::isfinite(value), "a measured value is a number");
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

/// The rest of the first line of a file that begins with `key` and a colon.
std::optional<std::string> after_key(const fs::path& file, const std::string& key) {
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (line.rfind(key, 0) != 0) continue;
    const std::size_t begin = line.find_first_not_of(" \t", line.find(':') + 1);
    if (begin != std::string::npos) return line.substr(begin);
  }
  return std::nullopt;
}

/// Of the first GPU that the NVIDIA driver lists.
std::optional<std::string> gpu_name() {
  std::error_code error;
  for (const auto& gpu : fs::directory_iterator("/proc/driver/nvidia/gpus", error)) {
    if (auto name = after_key(gpu.path() / "information", "Model")) return name;
  }
  return std::nullopt;
}

std::string today() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char text[16];
  std::strftime(text, sizeof text, "%Y-%m-%d", &utc);
  return text;
}

std::string goal_text(const MeasurementGoal& goal) {
  const bool at_most = goal.kind == MeasurementGoal::Kind::kAtMost;
  return std::string("{\"") + (at_most ? "at_most" : "at_least") + "\": " + number(goal.bar) +
         (goal.aim ? ", \"aim\": " + number(*goal.aim) : "") + "}";
}

std::string value_text(const MeasuredValue& value) {
  return "  {" +
         (value.case_name.empty() ? "" : "\"case\": " + quoted(value.case_name) + ", ") +
         "\"name\": " + quoted(value.name) + ", \"unit\": " + quoted(value.unit) +
         ", \"value\": " + number(value.value) +
         (value.interval95 ? ", \"interval95\": [" + number(value.interval95->first) + ", " +
                                 number(value.interval95->second) + "]"
                           : "") +
         (value.goal ? ", \"goal\": " + goal_text(*value.goal) : "") + "}";
}

std::string shell_word(const std::string& word) {
  const bool plain =
      !word.empty() && word.find_first_of(" \t\n'\"\\$&;|<>()*?[]#~`") == std::string::npos;
  if (plain) return word;
  std::string out = "'";
  for (const char c : word) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

}  // namespace

std::string processor_name() {
  return after_key("/proc/cpuinfo", "model name").value_or("unknown");
}

std::string command_line() {
  std::ifstream in("/proc/self/cmdline", std::ios::binary);
  std::vector<std::string> arguments;
  for (std::string word; std::getline(in, word, '\0');) arguments.push_back(word);
  return command_line(arguments);
}

std::string command_line(const std::vector<std::string>& arguments) {
  std::string line;
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    if (arguments[i].rfind("--record=", 0) == 0) continue;
    if (arguments[i] == "--record") {
      ++i;
      continue;
    }
    line +=
        i == 0 ? fs::path(arguments[i]).filename().string() : " " + shell_word(arguments[i]);
  }
  return line;
}

std::optional<std::string> commit_of(const std::string& version) {
  const std::size_t open = version.find('('), close = version.find(')');
  if (open == std::string::npos || close == std::string::npos) return std::nullopt;
  const std::string commit = version.substr(open + 1, close - open - 1);
  const std::size_t digits = commit.find_first_not_of("0123456789abcdef");
  const bool hash = digits == std::string::npos ? commit.size() >= 7 : digits >= 7;
  return hash ? std::optional(commit) : std::nullopt;
}

std::string record_text(const MeasurementRecord& record) {
  SEGSIM_CHECK(!record.values.empty(), "a record has values");
  const std::string command = command_line();
  std::string text =
      "{\n \"schema\": \"segsim.record/1\",\n \"title\": " + quoted(record.title) +
      ",\n \"command\": " + (command.empty() ? "null" : quoted(command)) +
      ",\n \"commit\": " + quoted_or_null(commit_of(version())) +
      ",\n \"date\": " + quoted(today()) +
      ",\n \"machine\": {\"processor\": " + quoted(processor_name()) +
      ", \"cores\": " + std::to_string(std::max(1U, std::thread::hardware_concurrency())) +
      ", \"gpu\": " + (record.on_gpu ? quoted_or_null(gpu_name()) : std::string("null")) +
      "},\n \"note\": [],\n \"values\": [\n";
  for (std::size_t i = 0; i < record.values.size(); ++i) {
    text += value_text(record.values[i]) + (i + 1 < record.values.size() ? ",\n" : "\n");
  }
  return text + " ]\n}\n";
}

}  // namespace segsim::core
