// `segsim scene label` as a user starts it, and what the other commands see of its edits.
#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/file_io.h"
#include "segsim_process.h"
#include "tests/experiments/label_scene.h"
#include "tests/experiments/raw_http.h"

namespace segsim::tests {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;

class LabelCli : public testing::TestWithParam<experiments::LabelKind> {
 protected:
  LabelCli() { experiments::write_label_scene(folder_ / "scene", GetParam()); }
  ~LabelCli() override {
    if (server_ > 0) ::kill(server_, SIGKILL);
  }

  [[nodiscard]] std::string quoted(const std::string& name) const {
    return "'" + (folder_ / name).string() + "'";
  }
  /// @return  Its port.
  int start() {
    const ProcessOutput started =
        run_shell(std::string(SEGSIM_BINARY) + " scene label " + quoted("scene") +
                  " --port 0 >" + quoted("out") + " 2>" + quoted("err") + " & echo $!");
    server_ = std::stoi(started.text);
    for (int k = 0; k < 1200; ++k) {
      const std::string said = core::read_file(folder_ / "out");
      if (said.ends_with("/\n")) return std::stoi(said.substr(said.rfind(':') + 1));
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    ADD_FAILURE() << core::read_file(folder_ / "err");
    return 0;
  }
  [[nodiscard]] static experiments::Answer post(int port, const std::string& body) {
    return experiments::send_raw(
        port, experiments::request_head("POST", "/api/edits",
                                        "Content-Type: application/json\r\nContent-Length: " +
                                            std::to_string(body.size()) + "\r\n") +
                  body);
  }
  void stop(int signal) {
    ASSERT_EQ(::kill(server_, signal), 0);
    for (int k = 0; k < 600 && ::kill(server_, 0) == 0; ++k) {
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    EXPECT_NE(::kill(server_, 0), 0) << "still there";
    server_ = 0;
  }

  TemporaryFolder folder_;
  pid_t server_ = 0;
};

TEST_P(LabelCli, EveryCommandSeesTheEdits) {
  EXPECT_EQ(run_segsim("render " + quoted("scene") + " --view 1 --out " + quoted("before.png"))
                .exit_code,
            0);
  const int port = start();
  const experiments::Answer renamed =
      post(port, R"({"revision":1,"do":"rename","instance":2,"class":"bed"})");
  EXPECT_EQ(renamed.status, 200) << renamed.body;
  // One editor at a time.
  const ProcessOutput second = run_segsim("scene label " + quoted("scene") + " --port 0");
  expect_input_error(second, "another segsim");
  stop(SIGKILL);  // What was answered is saved.

  const ProcessOutput inspected = run_segsim("scene inspect " + quoted("scene"));
  EXPECT_EQ(inspected.exit_code, 0) << inspected.text;
  EXPECT_THAT(inspected.text, HasSubstr("label edits    set by hand of 657 surfels"));
  EXPECT_THAT(inspected.text, testing::ContainsRegex("    5  bed +thing +1 +657\n"));
  EXPECT_THAT(inspected.text, testing::ContainsRegex("    4  chair +thing +0 +0\n"));
  EXPECT_EQ(run_segsim("render " + quoted("scene") + " --view 1 --out " + quoted("after.png"))
                .exit_code,
            0);
  EXPECT_NE(core::read_file(folder_ / "before.png"), core::read_file(folder_ / "after.png"));

  const ProcessOutput labelled =
      run_segsim("label " + quoted("scene") + " --out " + quoted("views") +
                 " --views 4 --classes bed couch");
  EXPECT_EQ(labelled.exit_code, 0) << labelled.text;
  const auto coco = nlohmann::json::parse(core::read_file(folder_ / "views/labels.json"));
  int beds = 0;
  for (const auto& box : coco.at("annotations")) beds += box.at("instance_id") == 2 ? 1 : 0;
  EXPECT_GT(beds, 0);

  const ProcessOutput episodes =
      run_segsim("episodes generate " + quoted("scene") + " -o " + quoted("set.jsonl") +
                 " --count 2 --goals bed --allow-visible-start");
  EXPECT_EQ(episodes.exit_code, 0) << episodes.text;
  EXPECT_THAT(core::read_file(folder_ / "set.jsonl"), HasSubstr("\"bed\""));

  const ProcessOutput remeshed =
      run_segsim("scene remesh " + quoted("scene") + " --out " + quoted("new"));
  EXPECT_EQ(remeshed.exit_code, 0) << remeshed.text;
  const ProcessOutput anew = run_segsim("scene inspect " + quoted("new"));
  EXPECT_THAT(anew.text, Not(HasSubstr("label edits")));  // They are the bundle's own now.
  EXPECT_THAT(anew.text, testing::ContainsRegex("    5  bed +thing +1 +657\n"));
  EXPECT_FALSE(fs::exists(folder_ / "new/label_journal.jsonl"));
}

TEST_P(LabelCli, UndoneAfterARestartAndADamagedJournalIsOneLine) {
  const std::string before = core::read_file(folder_ / "scene/scene.yaml");
  EXPECT_EQ(post(start(), R"({"revision":1,"do":"delete","instance":1})").status, 200);
  stop(SIGINT);
  const std::string journal = core::read_file(folder_ / "scene/label_journal.jsonl");
  EXPECT_EQ(post(start(), R"({"revision":1,"do":"undo"})").status, 200);
  stop(SIGTERM);
  EXPECT_EQ(core::read_file(folder_ / "scene/scene.yaml"), before);

  std::string damaged = journal;
  damaged[damaged.size() / 2] ^= 1;
  std::ofstream(folder_ / "scene/label_journal.jsonl", std::ios::binary) << damaged;
  const ProcessOutput refused = run_segsim("scene label " + quoted("scene") + " --port 0");
  expect_input_error(refused, "label_journal.jsonl:");
  EXPECT_EQ(std::count(refused.text.begin(), refused.text.end(), '\n'), 1) << refused.text;
  EXPECT_EQ(run_segsim("scene inspect " + quoted("scene")).exit_code, 0);
}

INSTANTIATE_TEST_SUITE_P(Bundles, LabelCli,
                         testing::Values(experiments::LabelKind::kIds,
                                         experiments::LabelKind::kDistributionsWithClasses),
                         [](const auto& kind) {
                           return kind.param == experiments::LabelKind::kIds
                                      ? "Ids"
                                      : "QueriesWithClasses";
                         });

}  // namespace
}  // namespace segsim::tests
