#include "experiments/scene_labels/label_server.h"

#include <mutex>
#include <utility>

#include "core/camera_path.h"
#include "experiments/scene_labels/internal/label_json.h"
#include "experiments/scene_labels/internal/label_views.h"
#include "experiments/scene_labels/internal/scene_labels_assets.h"
#include "experiments/scene_labels/label_editor.h"
#include "experiments/web/pages.h"

namespace segsim::experiments::scene_labels {
namespace {

using web::binary_reply;
using web::HttpReply;
using web::HttpRequest;
using web::json_reply;
using web::not_found;

core::CameraPath cameras_of(const LabelEditor& editor) {
  const core::BundleFile& file = editor.parts().cameras;
  if (file.name.empty()) return {};
  return core::read_camera_path(editor.bundle().folder / file.name);
}

}  // namespace

struct LabelServer::Impl {
  std::mutex mutex;  ///< One edit or view at a time: both use what is below.
  LabelEditor editor;
  internal::LabelViews views;
  std::uint64_t drawn_revision = 0;  ///< That the views show; 0: none.
  std::unique_ptr<web::HttpServer> server;

  explicit Impl(const std::filesystem::path& bundle)
      : editor(bundle), views(cameras_of(editor)) {}

  [[nodiscard]] HttpReply answer(const HttpRequest& request) {
    const std::vector<std::string>& parts = request.parts;
    if (request.posts) {
      if (parts == std::vector<std::string>{"api", "edits"}) return edit(request.body);
      return not_found("nothing to post to here");
    }
    if (parts.size() < 2) {
      const std::string name = parts.empty() ? "label.html" : parts[0];
      return web::page(name, internal::find_asset(name));
    }
    if (parts.size() != 2) return not_found("nothing here");
    if (parts[0] == "static") {
      return web::file_of_pages(parts[1], internal::find_asset(parts[1]));
    }
    if (parts[0] != "api") return not_found("nothing here");
    const std::lock_guard<std::mutex> lock(mutex);
    if (parts[1] == "scene") return json_reply(internal::scene_json(editor, ""));
    if (parts[1] == "cameras") {
      return json_reply(internal::cameras_json(views.cameras(), editor));
    }
    if (drawn_revision != editor.revision()) {
      views.set_scene(editor.surfels());
      drawn_revision = editor.revision();
    }
    if (parts[1] == "view.jpg") {
      return binary_reply("image/jpeg", views.jpeg(internal::view_of(request.query)), false);
    }
    if (parts[1] == "view.ids") {
      return binary_reply("application/octet-stream",
                          views.ids(internal::view_of(request.query)), false);
    }
    if (parts[1] == "pick") {
      const auto pixel = [&](const char* key) {
        return static_cast<int>(internal::query_number(request.query, key));
      };
      return json_reply(internal::picked_json(
          views.pick(internal::view_of(request.query), pixel("px"), pixel("py"))));
    }
    return not_found("nothing here");
  }

  HttpReply edit(const std::string& body) {
    const std::lock_guard<std::mutex> lock(mutex);
    try {
      const std::string said = internal::do_edit(editor, body);
      return json_reply(internal::scene_json(editor, said));
    } catch (const internal::StaleRevision&) {
      return web::refusal(409,
                          "The labels were changed elsewhere meanwhile; nothing was done.");
    }
  }
};

LabelServer::LabelServer(const std::filesystem::path& bundle, web::HttpOptions options)
    : impl_(std::make_unique<Impl>(bundle)) {
  options.takes_posts = true;
  impl_->server = std::make_unique<web::HttpServer>(
      options,
      [impl = impl_.get()](const HttpRequest& request) { return impl->answer(request); });
}

LabelServer::~LabelServer() = default;

int LabelServer::port() const { return impl_->server->port(); }
std::string LabelServer::address() const { return impl_->server->address(); }
void LabelServer::serve() { impl_->server->serve(); }
void LabelServer::stop() { impl_->server->stop(); }

}  // namespace segsim::experiments::scene_labels
