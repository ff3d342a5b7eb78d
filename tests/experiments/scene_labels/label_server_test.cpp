#include "experiments/scene_labels/label_server.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/file_io.h"
#include "tests/experiments/scene_labels/served_labels.h"

namespace segsim::experiments {
namespace {

using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

class LabelServerTest : public testing::Test {
 protected:
  LabelServerTest()
      : bundle_(write_label_scene(folder_ / "scene", LabelKind::kDistributions)),
        served_(bundle_) {}

  [[nodiscard]] std::string chair() const {
    const core::SceneManifest m = core::load_bundle(bundle_).manifest;
    return m.class_name(m.find_instance(kChairId)->class_id);
  }

  TemporaryFolder folder_;
  std::filesystem::path bundle_;
  ServedLabels served_;
};

TEST_F(LabelServerTest, ThePageAndItsFilesAreThere) {
  for (const char* page : {"/", "/label.html"}) {
    const Answer answer = served_.get(page);
    EXPECT_EQ(answer.status, 200);
    EXPECT_THAT(answer.head, HasSubstr("Content-Type: text/html"));
    EXPECT_THAT(answer.head, HasSubstr("default-src 'none'; script-src 'self'"));
    EXPECT_THAT(answer.body, Not(HasSubstr("://")));  // Nothing from elsewhere.
    EXPECT_THAT(answer.body, Not(HasSubstr("style=")));
    int files = 0;
    for (std::size_t at = answer.body.find("/static/"); at != std::string::npos;
         at = answer.body.find("/static/", at + 1), ++files) {
      const std::string file = answer.body.substr(at, answer.body.find('"', at) - at);
      EXPECT_EQ(served_.get(file).status, 200) << file;
    }
    EXPECT_GE(files, 5);
  }
  for (const char* path : {"/scene.yaml", "/static/scene.yaml", "/static/..%2fscene.yaml",
                           "/runs.html", "/static/label.html", "/api", "/api/", "/api/runs",
                           "/api/edits", "/api/scene/x", "/x/y"}) {
    EXPECT_EQ(served_.get(path).status, 404) << path;
  }
}

TEST_F(LabelServerTest, TheSceneIsTold) {
  const nlohmann::json scene = served_.scene();
  EXPECT_EQ(scene["name"], "tiny");
  EXPECT_EQ(scene["distributions"], true);
  EXPECT_EQ(scene["classes"].size(), 4U);
  EXPECT_EQ(scene["instances"].size(), 2U);
  EXPECT_EQ(scene["instances"][1]["name"], "chair_1");
  EXPECT_EQ(scene["instances"][1]["class"], TinyScene::kChair);
  EXPECT_GT(scene["instances"][1]["surfels"], 100);
  EXPECT_EQ(scene["undo"], nullptr);
  const nlohmann::json cameras = served_.get("/api/cameras").json();
  ASSERT_EQ(cameras["cameras"].size(), 2U);
  EXPECT_EQ(cameras["cameras"][1]["frame"], "chair");
  EXPECT_DOUBLE_EQ(cameras["cameras"][1]["x"], -1.4);
  EXPECT_NEAR(cameras["cameras"][1]["yaw"], std::atan2(1.9, -1.7), 1e-9);
  EXPECT_NEAR(cameras["cameras"][1]["pitch"], std::atan2(0.9, std::hypot(1.9, 1.7)), 1e-9);
}

TEST_F(LabelServerTest, ViewsShowWhatTheyShould) {
  const Answer picture = served_.get("/api/view.jpg?camera=1&width=320");
  EXPECT_EQ(picture.status, 200);
  EXPECT_THAT(picture.body, StartsWith("\xff\xd8\xff"));
  const ServedLabels::Ids ids = served_.ids("camera=1&width=320");
  EXPECT_EQ(ids.width_px, 320);
  EXPECT_EQ(ids.height_px, 240);
  ASSERT_EQ(ids.instance.size(), 320U * 240U);
  const auto [x, y] = ServedLabels::pixel_of(ids, kChairId);
  const std::string pixel = "&px=" + std::to_string(x) + "&py=" + std::to_string(y);
  const nlohmann::json picked = served_.get("/api/pick?camera=1&width=320" + pixel).json();
  EXPECT_EQ(picked["instance"], kChairId);
  EXPECT_EQ(picked["class"], TinyScene::kChair);
  // On the chair's box.
  EXPECT_NEAR(picked["p_m"][0], -3.15, 0.35);
  EXPECT_NEAR(picked["p_m"][1], 1.85, 0.35);
  EXPECT_NEAR(picked["p_m"][2], 0.45, 0.55);
  // The free camera at the same place sees the same.
  const nlohmann::json at = served_.get("/api/cameras").json()["cameras"][1];
  const auto number = [&](const char* key) { return at[key].dump(); };
  const std::string free = "x=" + number("x") + "&y=" + number("y") + "&z=" + number("z") +
                           "&yaw=" + number("yaw") + "&pitch=" + number("pitch") +
                           "&width=320";
  const ServedLabels::Ids freely = served_.ids(free);
  EXPECT_EQ(freely.instance[static_cast<std::size_t>(120 * 320 + 160)],
            ids.instance[static_cast<std::size_t>(120 * 320 + 160)]);
  for (const char* query :
       {"camera=2&width=320", "camera=-1&width=320", "camera=x&width=320", "camera=0&width=63",
        "camera=0&width=1281", "camera=0", "width=320",
        "x=1&y=1&z=1&yaw=nan&pitch=0&width=320", "x=1e9&y=1&z=1&yaw=0&pitch=0&width=320"}) {
    const Answer answer = served_.get(std::string("/api/view.jpg?") + query);
    EXPECT_EQ(answer.status, 404) << query;
    EXPECT_THAT(answer.body, HasSubstr("expected")) << query;
  }
  EXPECT_EQ(served_.get("/api/pick?camera=1&width=320&px=320&py=0").status, 404);
  EXPECT_EQ(served_.get("/api/pick?camera=1&width=320&px=0").status, 404);
}

TEST_F(LabelServerTest, EditsAreSavedShownAndUndone) {
  const std::string before = core::read_file(bundle_ / "scene.yaml");
  const Answer renamed =
      served_.edit(R"("do":"rename","instance":2,"class":"bar stool","name":"Änne's")");
  ASSERT_EQ(renamed.status, 200) << renamed.body;
  EXPECT_EQ(renamed.json()["said"], "chair_1 is bar stool, named Änne's");
  EXPECT_EQ(renamed.json()["undo"], "chair_1 is bar stool, named Änne's");
  EXPECT_EQ(chair(), "bar stool");
  const ServedLabels::Ids ids = served_.ids("camera=1&width=320");
  const auto [x, y] = ServedLabels::pixel_of(ids, kChairId);
  EXPECT_EQ(ids.semantic[static_cast<std::size_t>(y * 320 + x)], 5);

  EXPECT_EQ(served_.edit(R"("do":"merge","instance":2,"into":1)").status, 200);
  EXPECT_EQ(served_.scene()["instances"].size(), 1U);
  EXPECT_EQ(served_.edit(R"("do":"pieces","instance":1,"gap_m":0.05)").status, 200);
  EXPECT_EQ(served_.scene()["instances"].size(), 2U);
  EXPECT_EQ(served_.edit(R"("do":"cut","instance":1,"seeds":[[0,2.1,-2,0.8],[1,3.8,-2,0.8]])")
                .status,
            200);
  EXPECT_EQ(served_.scene()["instances"].size(), 3U);
  EXPECT_EQ(served_.edit(R"("do":"delete","instance":1)").status, 200);
  EXPECT_EQ(served_.scene()["instances"].size(), 2U);
  EXPECT_GT(served_.scene()["void_surfels"], 500);
  for (int k = 0; k < 5; ++k) EXPECT_EQ(served_.edit(R"("do":"undo")").status, 200) << k;
  EXPECT_EQ(served_.edit(R"("do":"undo")").status, 400);
  EXPECT_EQ(core::read_file(bundle_ / "scene.yaml"), before);
  EXPECT_EQ(served_.edit(R"("do":"redo")").status, 200);
  EXPECT_EQ(chair(), "bar stool");
}

TEST_F(LabelServerTest, WhatIsNoEditIsRefusedAndChangesNothing) {
  const std::string before = core::read_file(bundle_ / "scene.yaml");
  for (const char* fields : {R"("do":"paint","instance":1)",
                             R"("do":5)",
                             R"("instance":1)",
                             R"("do":"rename","instance":1)",
                             R"("do":"rename","instance":"1","class":"bed")",
                             R"("do":"rename","instance":1.5,"class":"bed")",
                             R"("do":"rename","instance":65537,"class":"bed")",
                             R"("do":"rename","instance":-1,"class":"bed")",
                             R"("do":"rename","instance":1,"class":5)",
                             R"("do":"rename","instance":1,"class":"BED")",
                             R"("do":"rename","instance":1,"class":"bed","thing":1)",
                             R"("do":"rename","instance":1,"class":"bed","name":7)",
                             R"("do":"merge","instance":1)",
                             R"("do":"merge","instance":1,"into":9)",
                             R"("do":"pieces","instance":1,"gap_m":"x")",
                             R"("do":"pieces","instance":1,"gap_m":-1)",
                             R"("do":"cut","instance":1)",
                             R"("do":"cut","instance":1,"seeds":[[0,1,2]])",
                             R"("do":"cut","instance":1,"seeds":[[0,1,2,3],[900,1,2,3]])",
                             R"("do":"cut","instance":1,"seeds":[[0,1,2,3],[2,1,2,4]])",
                             R"("do":"cut","instance":1,"seeds":{"a":1}})",
                             R"("do":"delete","instance":8)"}) {
    const Answer answer = served_.edit(fields);
    EXPECT_EQ(answer.status, 400) << fields << answer.body;
    EXPECT_THAT(answer.json()["error"].get<std::string>(), HasSubstr("expected")) << fields;
  }
  for (const char* body :
       {"", "[]", "7", "{", "{}", R"({"do":"undo"})", R"({"revision":"1","do":"undo"})"}) {
    EXPECT_EQ(served_.post("/api/edits", body).status, 400) << body;
  }
  const Answer stale = served_.post("/api/edits", R"({"revision":99,"do":"undo"})");
  EXPECT_EQ(stale.status, 409);
  EXPECT_THAT(stale.body, HasSubstr("changed elsewhere"));
  EXPECT_NE(served_.post("/api/edits", std::string(5000, ' ')).status, 200);
  EXPECT_EQ(served_.post("/api/scene", "{}").status, 404);
  EXPECT_EQ(core::read_file(bundle_ / "scene.yaml"), before);
  EXPECT_FALSE(std::filesystem::exists(bundle_ / "label_journal.jsonl"));
}

TEST_F(LabelServerTest, PagesElsewhereCannotEdit) {
  const std::string body = R"({"revision":1,"do":"delete","instance":1})";
  const std::string json = "Content-Type: application/json\r\n";
  const std::string own = "localhost:" + std::to_string(served_.port());
  const auto status = [&](const std::string& headers, const std::string& host) {
    return served_.post("/api/edits", body, headers, host).status;
  };
  // A form or a simple request of a page elsewhere: no JSON, or a foreign origin.
  EXPECT_EQ(status("", own), 415);
  EXPECT_EQ(status("Content-Type: text/plain\r\n", own), 415);
  EXPECT_EQ(status("Content-Type: application/x-www-form-urlencoded\r\n", own), 415);
  EXPECT_EQ(status(json + "Origin: http://evil.example\r\n", own), 403);
  EXPECT_EQ(status(json + "Origin: null\r\n", own), 403);
  EXPECT_EQ(status(json + "Origin: http://localhost:1\r\n", own), 403);
  EXPECT_EQ(status(json + "Origin: https://" + own + "\r\n", own), 403);
  EXPECT_EQ(status(json + "Sec-Fetch-Site: cross-site\r\n", own), 403);
  EXPECT_EQ(status(json + "Sec-Fetch-Site: same-site\r\n", own), 403);
  // A name of somebody else's that was made to point here.
  EXPECT_EQ(status(json + "Origin: http://evil.example\r\n", "evil.example"), 403);
  EXPECT_EQ(status(json, "evil.example"), 403);
  for (const char* method : {"PUT", "DELETE", "PATCH", "OPTIONS"}) {
    const Answer answer =
        send_raw(served_.port(), request_head(method, "/api/edits", "Content-Length: 0\r\n"));
    EXPECT_EQ(answer.status, 405) << method;
    EXPECT_THAT(answer.head, HasSubstr("Allow: GET, HEAD, POST\r\n"));
    EXPECT_THAT(answer.head, Not(HasSubstr("Access-Control")));
  }
  EXPECT_EQ(served_.scene()["edits"], 0);
  EXPECT_EQ(
      status(json + "Origin: http://" + own + "\r\nSec-Fetch-Site: same-origin\r\n", own),
      200);
  EXPECT_EQ(served_.scene()["edits"], 1);
}

TEST(LabelServer, ATokenIsAskedForBeforeEdits) {
  const TemporaryFolder folder;
  const ServedLabels served(write_label_scene(folder / "scene"),
                            "correct-horse-battery-staple");
  EXPECT_THAT(served.address(), HasSubstr("?token=correct-horse-battery-staple"));
  const std::string body = R"({"revision":1,"do":"delete","instance":1})";
  const std::string json = "Content-Type: application/json\r\n";
  EXPECT_EQ(served.get("/").status, 401);
  EXPECT_EQ(served.post("/api/edits", body).status, 401);
  EXPECT_EQ(served.post("/api/edits", body, json + "Authorization: Bearer no\r\n").status,
            401);
  EXPECT_EQ(served
                .post("/api/edits?token=correct-horse-battery-staple", body,
                      json + "Origin: http://evil.example\r\n")
                .status,
            403);
  EXPECT_EQ(served
                .post("/api/edits", body,
                      json + "Authorization: Bearer correct-horse-battery-staple\r\n")
                .status,
            200);
}

}  // namespace
}  // namespace segsim::experiments
