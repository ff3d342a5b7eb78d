#pragma once

/// @file
/// `segsim scene label` on a free port.

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "experiments/scene_labels/label_server.h"
#include "tests/experiments/label_scene.h"
#include "tests/experiments/raw_http.h"

namespace segsim::experiments {

class ServedLabels {
 public:
  explicit ServedLabels(const std::filesystem::path& bundle, const std::string& token = {})
      : server_(bundle, options(token)), thread_([this] { server_.serve(); }) {
    while (get("/favicon.ico").status == 0) std::this_thread::yield();
  }
  ~ServedLabels() {
    server_.stop();
    thread_.join();
  }
  ServedLabels(const ServedLabels&) = delete;
  ServedLabels& operator=(const ServedLabels&) = delete;

  [[nodiscard]] int port() const { return server_.port(); }
  [[nodiscard]] std::string address() const { return server_.address(); }
  [[nodiscard]] Answer get(const std::string& path, const std::string& headers = {},
                           const std::string& host = "localhost") const {
    return send_raw(port(), request_head("GET", path, headers, host));
  }
  [[nodiscard]] Answer post(const std::string& path, const std::string& body,
                            const std::string& headers = "Content-Type: application/json\r\n",
                            const std::string& host = "localhost") const {
    return send_raw(
        port(),
        request_head("POST", path,
                     headers + "Content-Length: " + std::to_string(body.size()) + "\r\n",
                     host) +
            body);
  }
  /// Posts an edit of the labels as they are now. @param fields  `"do":"undo"`, ...
  [[nodiscard]] Answer edit(const std::string& fields) const {
    return post("/api/edits",
                "{\"revision\":" + scene()["revision"].dump() + "," + fields + "}");
  }
  [[nodiscard]] nlohmann::json scene() const { return get("/api/scene").json(); }

  /// Instance ids of a view, row by row. @param query  "camera=0&width=320"
  struct Ids {
    int width_px = 0, height_px = 0;
    std::vector<int> instance, semantic;
  };
  [[nodiscard]] Ids ids(const std::string& query) const {
    const std::string bytes = get("/api/view.ids?" + query).body;
    std::vector<std::uint16_t> words(bytes.size() / 2);
    std::memcpy(words.data(), bytes.data(), 2 * words.size());
    Ids ids;
    ids.width_px = words.at(0);
    ids.height_px = words.at(2);
    for (std::size_t k = 4; k + 2 < words.size(); k += 3) {
      ids.instance.insert(ids.instance.end(), words[k + 2], words[k]);
      ids.semantic.insert(ids.semantic.end(), words[k + 2], words[k + 1]);
    }
    return ids;
  }
  /// A pixel well inside an instance: its pixel that is nearest to the mean of all.
  [[nodiscard]] static std::pair<int, int> pixel_of(const Ids& ids, int instance) {
    std::vector<std::pair<int, int>> mine;
    double x_sum = 0.0, y_sum = 0.0;
    for (std::size_t i = 0; i < ids.instance.size(); ++i) {
      if (ids.instance[i] != instance) continue;
      mine.emplace_back(static_cast<int>(i) % ids.width_px,
                        static_cast<int>(i) / ids.width_px);
      x_sum += mine.back().first;
      y_sum += mine.back().second;
    }
    const auto count = static_cast<double>(mine.size());
    return *std::min_element(mine.begin(), mine.end(), [&](const auto& a, const auto& b) {
      const auto off = [&](const std::pair<int, int>& p) {
        return std::hypot(p.first - x_sum / count, p.second - y_sum / count);
      };
      return off(a) < off(b);
    });
  }

 private:
  static web::HttpOptions options(const std::string& token) {
    web::HttpOptions of;
    of.port = 0;
    of.token = token;
    return of;
  }
  scene_labels::LabelServer server_;
  std::thread thread_;
};

}  // namespace segsim::experiments
