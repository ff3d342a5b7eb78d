#include "experiments/bags/bag_file.h"

#include <algorithm>
#include <map>
#include <utility>

#include <sqlite3.h>

#include "core/error.h"
#include "core/input/regular_file.h"
#include "ros/mcap/mcap_reader.h"

namespace segsim::experiments::bags {

namespace fs = std::filesystem;
using ros::mcap::Channel;
using ros::mcap::StoredMessage;

/// One file.
struct BagFile::Source {
  virtual ~Source() = default;
  [[nodiscard]] virtual std::vector<const Channel*> channels() const = 0;
  [[nodiscard]] virtual std::string truncation() const { return {}; }
  virtual void read(const std::function<void(const StoredMessage&)>& receive,
                    std::span<const std::string> topics) = 0;
};

struct BagFile::McapSource final : Source {
  explicit McapSource(const fs::path& file) : reader(file) {}
  [[nodiscard]] std::vector<const Channel*> channels() const override {
    return reader.channels();
  }
  [[nodiscard]] std::string truncation() const override { return reader.truncation(); }
  void read(const std::function<void(const StoredMessage&)>& receive,
            std::span<const std::string> topics) override {
    reader.read(receive, topics);
  }
  ros::mcap::Reader reader;
};

namespace {

using Database = std::unique_ptr<sqlite3, decltype(&sqlite3_close)>;
using Statement = std::unique_ptr<sqlite3_stmt, decltype(&sqlite3_finalize)>;

Database open_database(const fs::path& file) {
  sqlite3* opened = nullptr;
  int code = SQLITE_CANTOPEN;
  if (core::can_be_read(file)) {
    code = sqlite3_open_v2(file.c_str(), &opened, SQLITE_OPEN_READONLY, nullptr);
  }
  Database database(opened, &sqlite3_close);
  if (code != SQLITE_OK) {
    throw core::InputError::expected(file.string(), "a readable file", sqlite3_errstr(code));
  }
  return database;
}

Statement prepare(sqlite3* database, const char* text, const std::string& file) {
  sqlite3_stmt* prepared = nullptr;
  const int code = sqlite3_prepare_v2(database, text, -1, &prepared, nullptr);
  if (code != SQLITE_OK) {
    throw core::InputError::expected(file, "a recording of rosbag2", sqlite3_errmsg(database));
  }
  return {prepared, &sqlite3_finalize};
}

/// Whether there is a row more.
bool step(sqlite3* database, sqlite3_stmt* statement, const std::string& file) {
  const int code = sqlite3_step(statement);
  if (code == SQLITE_ROW) return true;
  if (code == SQLITE_DONE) return false;
  throw core::InputError::expected(file, "a recording that is whole",
                                   sqlite3_errmsg(database));
}

std::string text_of(sqlite3_stmt* statement, int column) {
  const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement, column));
  return text == nullptr ? std::string() : std::string(text);
}

}  // namespace

struct BagFile::SqliteSource final : Source {
  explicit SqliteSource(const fs::path& path)
      : file(path.string()), database(open_database(path)) {
    const Statement topics = prepare(
        database.get(), "SELECT id, name, type, serialization_format FROM topics", file);
    while (step(database.get(), topics.get(), file)) {
      Channel& channel = by_id[sqlite3_column_int64(topics.get(), 0)];
      channel.topic = text_of(topics.get(), 1);
      channel.schema.name = text_of(topics.get(), 2);
      channel.message_encoding = text_of(topics.get(), 3);
    }
  }
  [[nodiscard]] std::vector<const Channel*> channels() const override {
    std::vector<const Channel*> channels;
    for (const auto& [id, channel] : by_id) channels.push_back(&channel);
    return channels;
  }
  void read(const std::function<void(const StoredMessage&)>& receive,
            std::span<const std::string> topics) override {
    const Statement rows =
        prepare(database.get(),
                "SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id", file);
    while (step(database.get(), rows.get(), file)) {
      const auto channel = by_id.find(sqlite3_column_int64(rows.get(), 0));
      if (channel == by_id.end()) {
        throw core::InputError::expected(file, "the topics of all messages",
                                         "a message without");
      }
      const std::string& topic = channel->second.topic;
      if (std::find(topics.begin(), topics.end(), topic) == topics.end()) continue;
      StoredMessage message;
      message.channel = &channel->second;
      message.log_time_ns = static_cast<std::uint64_t>(sqlite3_column_int64(rows.get(), 1));
      message.publish_time_ns = message.log_time_ns;
      const auto* data = static_cast<const std::byte*>(sqlite3_column_blob(rows.get(), 2));
      message.data = {data, static_cast<std::size_t>(sqlite3_column_bytes(rows.get(), 2))};
      message.file = &file;
      receive(message);
    }
  }

  std::string file;
  Database database;
  std::map<std::int64_t, Channel> by_id;
};

BagFile::BagFile(const fs::path& path) {
  std::vector<fs::path> files = {path};
  if (fs::is_directory(path)) {
    files.clear();
    for (const auto& entry : fs::directory_iterator(path)) {
      const fs::path ending = entry.path().extension();
      if (ending == ".mcap" || ending == ".db3") files.push_back(entry.path());
    }
    // rosbag2 numbers them; a name that is shorter has a smaller number.
    std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
      return std::pair(a.native().size(), a) < std::pair(b.native().size(), b);
    });
  }
  for (const fs::path& file : files) {
    if (file.extension() == ".db3") {
      sources_.push_back(std::make_unique<SqliteSource>(file));
    } else {
      sources_.push_back(std::make_unique<McapSource>(file));
    }
  }
  if (!sources_.empty()) return;
  throw core::InputError::expected(path.string(), "a folder with files .mcap or .db3", "none");
}

BagFile::~BagFile() = default;

std::vector<const Channel*> BagFile::channels() const {
  std::vector<const Channel*> channels;
  for (const auto& source : sources_) {
    for (const Channel* channel : source->channels()) channels.push_back(channel);
  }
  return channels;
}

std::string BagFile::truncation() const {
  for (const auto& source : sources_) {
    if (std::string missing = source->truncation(); !missing.empty()) return missing;
  }
  return {};
}

void BagFile::read(const std::function<void(const StoredMessage&)>& receive,
                   std::span<const std::string> topics) {
  for (const auto& source : sources_) source->read(receive, topics);
}

}  // namespace segsim::experiments::bags
