// SQLite files of rosbag2 (experiments/bags/bag_file.h): SQL that is run on an empty one, or a
// file as it is.
#include <sqlite3.h>

#include "experiments/bags/bag_file.h"
#include "ros/mcap/topic.h"
#include "ros/messages/std_msgs.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/targets/experiments/limited_sql.h"

namespace segsim::fuzz {
namespace {

constexpr const char* kTables =
    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT,"
    " serialization_format TEXT, offered_qos_profiles TEXT);"
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,"
    " data BLOB);";
constexpr const char* kRows =
    "INSERT INTO topics VALUES(1, '/text', 'std_msgs/msg/String', 'cdr', '');"
    "INSERT INTO messages VALUES(1, 1, 5, x'00010000020000006100');";

}  // namespace

void parse(const std::string& bytes) {
  const bool whole = bytes.starts_with("SQLite format 3");
  const std::filesystem::path file = in_file(whole ? bytes : "", "input.db3");
  if (!whole) {
    run_limited_sql(file, kTables);
    run_limited_sql(file, bytes);
  }
  experiments::bags::BagFile bag(file);
  std::vector<std::string> topics{"/text"};
  for (const ros::mcap::Channel* channel : bag.channels()) topics.push_back(channel->topic);
  bag.read(
      [](const auto& message) { (void)ros::mcap::decode<ros::std_msgs::String>(message); },
      topics);
}

std::vector<std::string> seeds() {
  return {kRows, written(
                     [](const auto& file) {
                       run_limited_sql(file, kTables);
                       run_limited_sql(file, kRows);
                     },
                     "seed.db3")};
}

}  // namespace segsim::fuzz
