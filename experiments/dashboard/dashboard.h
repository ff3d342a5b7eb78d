#pragma once

/// @file
/// Runs in a browser while they run, and their trials afterwards: `segsim serve`
/// (docs/dashboard.md).
///
/// Reads only: results are opened for reading, GET and HEAD are all that is answered, and an
/// address never becomes the name of a file. What it may serve are its own pages, two packaged
/// libraries, and what it makes of results databases and of the bundles that their logs name.
/// The one thing that it writes is the time stamp of live/watched beside the results, which
/// asks running workers for pictures (experiments/trials/live_view.h).

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "experiments/web/http_server.h"

namespace segsim::experiments::dashboard {

struct DashboardOptions : web::HttpOptions {
  /// Work folders, folders of work folders, or results databases; looked at again and again,
  /// so runs may begin later.
  std::vector<std::filesystem::path> roots;
};

class Dashboard {
 public:
  /// Takes the port.
  /// @throws core::InputError if a root is missing, or as web::HttpServer.
  explicit Dashboard(const DashboardOptions& options);
  ~Dashboard();
  Dashboard(const Dashboard&) = delete;
  Dashboard& operator=(const Dashboard&) = delete;

  [[nodiscard]] int port() const;
  /// "http://127.0.0.1:8080/", with the token if there is one.
  [[nodiscard]] std::string address() const;

  /// Answers until stop() is called from another thread.
  void serve();
  void stop();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace segsim::experiments::dashboard
