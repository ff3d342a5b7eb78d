#include "experiments/scene_labels/edit_journal.h"

#include <cerrno>
#include <cstring>
#include <utility>

#include <fcntl.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "perception/data/checked_json.h"

namespace segsim::experiments::scene_labels {
namespace {

namespace fs = std::filesystem;
using core::InputError;
using Json = perception::OrderedCheckedJson;
using Kind = JournalRecord::Kind;
using Move = renderer::LabelEdits::Move;
using Run = renderer::LabelEdits::Run;

constexpr const char* kSchema = "segsim.label_journal";
constexpr int kVersion = 1;
constexpr std::size_t kChecksumDigits = 16;

/// Names come from files that need not be UTF-8.
std::string text_of(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Json json_of(const renderer::LabelEdits& edits) {
  Json runs = Json::array(), moves = Json::array();
  for (const Run& run : edits.runs) {
    runs.push_back({run.first, run.count, run.class_id, run.instance_id});
  }
  for (const Move& move : edits.moves) moves.push_back({move.from, move.to});
  return {{"set", runs}, {"moves", moves}};
}

Json json_of(const std::vector<core::SceneClass>& classes) {
  Json list = Json::array();
  for (const core::SceneClass& c : classes) list.push_back({c.id, c.name, c.thing});
  return list;
}

Json json_of(const std::vector<core::SceneInstance>& instances) {
  Json list = Json::array();
  for (const core::SceneInstance& i : instances) {
    list.push_back({i.id, i.class_id, i.name, i.box_min_m.x, i.box_min_m.y, i.box_min_m.z,
                    i.box_max_m.x, i.box_max_m.y, i.box_max_m.z});
  }
  return list;
}

renderer::LabelEdits edits_of(const Json& json) {
  renderer::LabelEdits edits;
  for (const Json& run : json.at("set")) {
    edits.runs.push_back({run.at(0), run.at(1), run.at(2), run.at(3)});
  }
  for (const Json& move : json.at("moves")) edits.moves.push_back({move.at(0), move.at(1)});
  return edits;
}

std::vector<core::SceneClass> classes_of(const Json& json) {
  std::vector<core::SceneClass> classes;
  for (const Json& c : json) classes.push_back({c.at(0), c.at(1), c.at(2)});
  return classes;
}

std::vector<core::SceneInstance> instances_of(const Json& json) {
  std::vector<core::SceneInstance> instances;
  for (const Json& i : json) {
    instances.push_back(
        {i.at(0), i.at(1), i.at(2), {i.at(3), i.at(4), i.at(5)}, {i.at(6), i.at(7), i.at(8)}});
  }
  return instances;
}

Json json_of(const JournalStart& start) {
  Json json{{"schema", kSchema},
            {"version", kVersion},
            {"surfels", start.surfels},
            {"surfels_sha256", start.surfels_sha256},
            {"labels_sha256", start.labels_sha256},
            {"classes", json_of(start.classes)},
            {"instances", json_of(start.instances)}};
  json.update(json_of(start.edits));
  return json;
}

JournalStart start_of(const Json& json) {
  return {json.at("surfels"),
          json.at("surfels_sha256"),
          json.at("labels_sha256"),
          classes_of(json.at("classes")),
          instances_of(json.at("instances")),
          edits_of(json)};
}

Json json_of(const JournalRecord& record) {
  if (record.kind != Kind::kEdit) {
    return {{record.kind == Kind::kUndo ? "undo" : "redo", record.edit.what}};
  }
  Json edit{{"what", record.edit.what}};
  edit.update(json_of(record.edit.labels));
  edit["new_classes"] = json_of(record.edit.new_classes);
  edit["instances"] = json_of(record.edit.instances);
  edit["removed"] = record.edit.removed;
  return {{"edit", edit}};
}

JournalRecord record_of(const Json& json) {
  JournalRecord record;
  if (json.contains("edit")) {
    const Json& edit = json.at("edit");
    record.edit.what = edit.at("what");
    record.edit.labels = edits_of(edit);
    record.edit.new_classes = classes_of(edit.at("new_classes"));
    record.edit.instances = instances_of(edit.at("instances"));
    record.edit.removed = edit.at("removed").get<std::vector<std::uint16_t>>();
    return record;
  }
  record.kind = json.contains("undo") ? Kind::kUndo : Kind::kRedo;
  record.edit.what = json.at(record.kind == Kind::kUndo ? "undo" : "redo");
  return record;
}

std::string checksum_of(const std::string& above, const std::string& json) {
  return core::sha256_hex(above + " " + json).substr(0, kChecksumDigits);
}

/// All of it on the disk, or an exception with the reason.
void write_at(const fs::path& file, std::uintmax_t offset, const std::string& text) {
  const int descriptor = ::open(file.c_str(), O_CREAT | O_WRONLY | O_CLOEXEC, 0644);
  const auto fail = [&](const char* expected) {
    const int code = errno;
    if (descriptor >= 0) {
      static_cast<void>(::ftruncate(descriptor, static_cast<off_t>(offset)) == 0);
      ::close(descriptor);
    }
    throw InputError::expected(file.string(), expected, std::strerror(code));
  };
  if (descriptor < 0 || ::ftruncate(descriptor, static_cast<off_t>(offset)) != 0 ||
      ::lseek(descriptor, 0, SEEK_END) < 0) {
    fail("a file that can be written");
  }
  for (std::size_t done = 0; done < text.size();) {
    const ssize_t written = ::write(descriptor, text.data() + done, text.size() - done);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) fail("room to write");
    done += static_cast<std::size_t>(written);
  }
  if (::fdatasync(descriptor) != 0) fail("a disk that keeps what is written");
  ::close(descriptor);
}

}  // namespace

EditJournal::EditJournal(fs::path file, const JournalStart& start)
    : file_(std::move(file)), start_(start) {
  if (fs::exists(file_)) read();
  if (start_.surfels != start.surfels || start_.surfels_sha256 != start.surfels_sha256 ||
      start_.labels_sha256 != start.labels_sha256) {
    throw InputError::expected(file_.string(), "a journal of this scene's surfels and labels",
                               "one of others (move it away to begin a new one)");
  }
}

void EditJournal::read() {
  const std::string text = core::read_file(file_);
  std::size_t line = 0, begin = 0;
  for (std::size_t end = text.find('\n'); end != std::string::npos;
       begin = end + 1, end = text.find('\n', begin)) {
    ++line;
    const std::string place = file_.string() + ":" + std::to_string(line);
    const std::string whole = text.substr(begin, end - begin);
    const std::string json =
        whole.size() > kChecksumDigits + 1 ? whole.substr(kChecksumDigits + 1) : std::string();
    const std::string wanted = checksum_of(checksum_, json);
    if (whole != std::string(wanted).append(" ").append(json)) {
      throw InputError::expected(place,
                                 "a line that its checksum " + wanted + " is written of",
                                 whole.substr(0, kChecksumDigits) +
                                     " (the journal is damaged; without it the labels stay "
                                     "as the bundle has them)");
    }
    try {
      const Json parsed = Json::parse(json);
      if (line == 1) {
        if (parsed.at("schema") != kSchema || parsed.at("version") != kVersion) {
          throw InputError::expected(place, std::string(kSchema) + " of version 1",
                                     parsed.at("version").dump());
        }
        start_ = start_of(parsed);
      } else {
        records_.push_back(record_of(parsed));
      }
    } catch (const Json::exception& error) {
      throw InputError::expected(place, "an edit, undo or redo", error.what());
    }
    checksum_ = wanted;
    good_bytes_ = end + 1;
  }
}

std::string EditJournal::line_of(const std::string& json) {
  checksum_ = checksum_of(checksum_, json);
  return checksum_ + " " + json + "\n";
}

void EditJournal::append(JournalRecord record) {
  const std::string before = checksum_;
  std::string text;
  if (good_bytes_ == 0) text = line_of(text_of(json_of(start_)));
  text += line_of(text_of(json_of(record)));
  try {
    write_at(file_, good_bytes_, text);
  } catch (...) {
    checksum_ = before;
    throw;
  }
  good_bytes_ += text.size();
  records_.push_back(std::move(record));
}

}  // namespace segsim::experiments::scene_labels
