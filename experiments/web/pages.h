#pragma once

/// @file
/// Pages that travel inside the program, with the styles and scripts that all of them share
/// (experiments/web/pages, and the styles of the report).

#include <string>

#include "experiments/web/http_server.h"

namespace segsim::experiments::web {

inline constexpr const char* kScriptType = "text/javascript; charset=utf-8";

/// A page by its name: "NAME.html", or "favicon.ico".
/// @param own  Text of the caller's file of that name; nullptr: it has none.
[[nodiscard]] HttpReply page(const std::string& name, const char* own);

/// A style or script of pages, below "/static/". @param own  As of page().
[[nodiscard]] HttpReply file_of_pages(const std::string& name, const char* own);

}  // namespace segsim::experiments::web
