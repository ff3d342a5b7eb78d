#include "experiments/runs/shard.h"

#include <charconv>
#include <cstdlib>
#include <optional>

#include "core/error.h"

namespace segsim::experiments::runs {
namespace {

struct Engine {
  const char* index;
  const char* count;     ///< nullptr: it tells nobody.
  const char* smallest;  ///< Variable with the smallest index of an array; nullptr: `first`.
  const char* largest;
  const char* step;
  int first;
};
constexpr Engine kEngines[] = {
    {"SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_COUNT", "SLURM_ARRAY_TASK_MIN",
     "SLURM_ARRAY_TASK_MAX", "SLURM_ARRAY_TASK_STEP", 0},
    {"JOB_COMPLETION_INDEX", nullptr, nullptr, nullptr, nullptr, 0},
    {"OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE", nullptr, nullptr, nullptr, 0},
    {"PMI_RANK", "PMI_SIZE", nullptr, nullptr, nullptr, 0},
    {"SLURM_PROCID", "SLURM_NTASKS", nullptr, nullptr, nullptr, 0},
    {"AWS_BATCH_JOB_ARRAY_INDEX", "AWS_BATCH_JOB_ARRAY_SIZE", nullptr, nullptr, nullptr, 0},
    {"PBS_ARRAY_INDEX", nullptr, nullptr, nullptr, nullptr, 0},
    {"PARALLEL_SEQ", nullptr, nullptr, nullptr, nullptr, 1},
};
constexpr const char* kCount = "SHARD_COUNT";
constexpr const char* kFirst = "SHARD_FIRST";

std::optional<int> whole_number(const std::string& text) {
  int value = 0;
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (code != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// nullopt if the variable is not set.
std::optional<int> number_in(const Environment& environment, const char* name) {
  const char* text = name == nullptr ? nullptr : environment(name);
  if (text == nullptr) return std::nullopt;
  const std::optional<int> value = whole_number(text);
  if (!value) {
    throw core::InputError::expected(std::string("environment variable ") + name,
                                     "a whole number", "\"" + std::string(text) + "\"");
  }
  return value;
}

Shard checked(const std::string& place, int index, int count) {
  if (count < 1 || index < 0 || index >= count) {
    throw core::InputError::expected(place,
                                     "an index I and a number of parts N with 0 <= I < N",
                                     std::to_string(index) + " of " + std::to_string(count));
  }
  return {index, count};
}

/// An array with holes (--array=3,7) does not say how many parts the run has.
void check_no_holes(const Environment& environment, const Engine& engine, int count,
                    int smallest, int step) {
  const int largest =
      number_in(environment, engine.largest).value_or(smallest + (count - 1) * step);
  if (step > 0 && largest == smallest + (count - 1) * step) return;
  throw core::InputError::expected(
      engine.index, std::string("an array without holes, or ") + kCount + " with the parts",
      std::to_string(count) + " tasks from " + std::to_string(smallest) + " to " +
          std::to_string(largest));
}

std::optional<Shard> shard_of(const Environment& environment, const Engine& engine) {
  const std::optional<int> index = number_in(environment, engine.index);
  if (!index) return std::nullopt;
  if (const std::optional<int> count = number_in(environment, kCount)) {
    const int first = number_in(environment, kFirst).value_or(engine.first);
    return checked(std::string(engine.index) + " and " + kCount, *index - first, *count);
  }
  const std::optional<int> count = number_in(environment, engine.count);
  if (!count) {
    throw core::InputError::expected(std::string(engine.index) + "=" + std::to_string(*index),
                                     std::string("the number of parts in ") +
                                         (engine.count == nullptr ? kCount : engine.count),
                                     "none");
  }
  const int smallest = number_in(environment, engine.smallest).value_or(engine.first);
  const int step = number_in(environment, engine.step).value_or(1);
  if (engine.smallest != nullptr) check_no_holes(environment, engine, *count, smallest, step);
  return checked(engine.index, (*index - smallest) / step, *count);
}

Shard shard_of_engine(const Environment& environment) {
  // Every batch script of Slurm is "task 0 of 1" of srun, whatever runs inside of it.
  std::optional<Shard> whole;
  for (const Engine& engine : kEngines) {
    const std::optional<Shard> shard = shard_of(environment, engine);
    if (shard && shard->count > 1) return *shard;
    if (shard && !whole) whole = shard;
  }
  if (whole) return *whole;
  std::string names;
  for (const Engine& engine : kEngines) {
    names += (names.empty() ? "" : ", ") + std::string(engine.index);
  }
  throw core::InputError::expected("--shard auto", "a variable of an engine: " + names,
                                   "none; give --shard I/N");
}

}  // namespace

std::string Shard::text() const { return std::to_string(index) + "/" + std::to_string(count); }

std::string Shard::folder_name() const {
  return std::to_string(index) + "-of-" + std::to_string(count);
}

Environment process_environment() {
  return [](const char* name) { return std::getenv(name); };
}

Shard shard_from(const std::string& word, const Environment& environment) {
  if (word == "auto") return shard_of_engine(environment);
  const std::size_t slash = word.find('/');
  const std::optional<int> index = whole_number(word.substr(0, slash));
  const std::optional<int> count =
      slash == std::string::npos ? std::nullopt : whole_number(word.substr(slash + 1));
  if (!index || !count) {
    throw core::InputError::expected("--shard", "auto, or I/N with 0 <= I < N",
                                     "\"" + word + "\"");
  }
  return checked("--shard " + word, *index, *count);
}

}  // namespace segsim::experiments::runs
