#pragma once

/// @file
/// Labels of a bundle corrected in a browser: `segsim scene label` (docs/scene_label.md).
///
/// An address is never turned into the name of a file: it serves its own page, views of the
/// one bundle, and edits of its labels. Who may look may edit.

#include <filesystem>
#include <memory>
#include <string>

#include "experiments/web/http_server.h"

namespace segsim::experiments::scene_labels {

class LabelServer {
 public:
  /// Opens the bundle and takes the port. @param options  `takes_posts` is set.
  /// @throws core::InputError as LabelEditor and web::HttpServer.
  LabelServer(const std::filesystem::path& bundle, web::HttpOptions options);
  ~LabelServer();
  LabelServer(const LabelServer&) = delete;
  LabelServer& operator=(const LabelServer&) = delete;

  [[nodiscard]] int port() const;
  /// Of the page, with the token if there is one.
  [[nodiscard]] std::string address() const;

  /// Answers until stop() is called from another thread.
  void serve();
  void stop();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace segsim::experiments::scene_labels
