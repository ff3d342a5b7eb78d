#include "experiments/report/internal/html.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace segsim::experiments::internal {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr const char* kHostile = R"(<script>alert("a & 'b'")</script>)";

TEST(Html, TextCannotBecomeMarkup) {
  EXPECT_EQ(report::internal::html_escaped(kHostile),
            "&lt;script&gt;alert(&quot;a &amp; &#39;b&#39;&quot;)&lt;/script&gt;");
  EXPECT_EQ(report::internal::html_escaped("K\xc3\xbc"
                                           "che"),
            "K\xc3\xbc"
            "che");
}

TEST(Html, AddressesKeepEveryByte) {
  EXPECT_EQ(report::internal::url_escaped("flat-3/couch_1.a~"), "flat-3%2Fcouch_1.a~");
  EXPECT_EQ(report::internal::url_escaped("a&b=c#d\"e f+%"), "a%26b%3Dc%23d%22e%20f%2B%25");
  EXPECT_EQ(report::internal::url_escaped("\xc3\xbc"), "%C3%BC");
  EXPECT_EQ(report::internal::trials_href({{"scene", "a&b"}, {"arm", "x"}}, "../"),
            "../trials.html#scene=a%26b&arm=x");
  EXPECT_EQ(report::internal::trials_href({}), "trials.html");
}

TEST(Html, JsonInAScriptCannotEndIt) {
  const nlohmann::json plot{{"name", "</script><b>"}};
  const std::string safe = report::internal::script_json(plot.dump());
  EXPECT_THAT(safe, Not(HasSubstr("<")));
  EXPECT_EQ(nlohmann::json::parse(safe), plot);
}

TEST(Html, FileStemsAreFileNames) {
  EXPECT_EQ(report::internal::file_stem("flat-3/chair/00"), "flat-3-chair-00");
  EXPECT_EQ(report::internal::file_stem("../../etc"), "..-..-etc");
  EXPECT_EQ(report::internal::file_stem(".."), "x..");
  EXPECT_EQ(report::internal::file_stem(""), "x");
}

TEST(Html, TablesEscapeCellsAndLinkOnlyWhatIsThere) {
  const support::internal::Grid grid{"T <1>", {"A", "B"}, {{"x & y", "3"}, {"z", "-"}}};
  const std::string html =
      report::internal::html_table(grid, [](std::size_t row, std::size_t column) {
        return column == 1 ? "t.html#r=" + std::to_string(row) + "&q=\"" : std::string();
      });
  EXPECT_THAT(html, HasSubstr("<caption>T &lt;1&gt;</caption>"));
  EXPECT_THAT(html,
              HasSubstr("<td>x &amp; y</td><td><a href=\"t.html#r=0&amp;q=&quot;\">3</a>"));
  EXPECT_THAT(html, HasSubstr("<td>z</td><td>-</td>"));
}

TEST(Html, PagesLoadNothingFromElsewhere) {
  const std::string page = report::internal::html_page("a < b", "<p>x</p>", "../", true);
  EXPECT_THAT(page, HasSubstr("<title>a &lt; b</title>"));
  EXPECT_THAT(page, HasSubstr("src=\"../chart.min.js\""));
  EXPECT_THAT(page, Not(HasSubstr("http")));
  EXPECT_THAT(report::internal::html_page("t", "", "", false), Not(HasSubstr("chart.min.js")));
}

}  // namespace
}  // namespace segsim::experiments::internal
