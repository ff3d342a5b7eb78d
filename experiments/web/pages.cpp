#include "experiments/web/pages.h"

#include "experiments/report/report_assets.h"
#include "experiments/web/internal/web_assets.h"

namespace segsim::experiments::web {
namespace {

constexpr const char* kStyleType = "text/css; charset=utf-8";
constexpr const char* kPageType = "text/html; charset=utf-8";

}  // namespace

HttpReply page(const std::string& name, const char* own) {
  if (name == "favicon.ico") {
    return binary_reply("image/svg+xml", internal::find_asset("favicon.svg"), true);
  }
  if (own == nullptr || !name.ends_with(".html")) return not_found("no such page");
  return file_reply(kPageType, own);
}

HttpReply file_of_pages(const std::string& name, const char* own) {
  if (name == "report.css") {
    return file_reply(kStyleType, report::internal::kReportCss);
  }
  const char* text = own != nullptr ? own : internal::find_asset(name);
  const bool style = name.ends_with(".css");
  if (text == nullptr || (!style && !name.ends_with(".js"))) return not_found("no such file");
  return file_reply(style ? kStyleType : kScriptType, text);
}

}  // namespace segsim::experiments::web
