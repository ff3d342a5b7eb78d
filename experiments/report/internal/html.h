#pragma once

/// @file
/// Text, links and tables as HTML. Everything that comes from a spec, a scene or a file goes
/// through html_escaped(): names hold what people type.

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "experiments/support/grid_document.h"

namespace segsim::experiments::report::internal {

/// For text and for attributes in either kind of quotes.
[[nodiscard]] std::string html_escaped(const std::string& text);
/// For one part of an address: everything but letters, digits and -._~ in percent form.
[[nodiscard]] std::string url_escaped(const std::string& text);
/// JSON that may stand in a script element: no "<" is left.
[[nodiscard]] std::string script_json(const std::string& json);
/// Letters, digits, "-", "_" and "."; never empty. Not unique.
[[nodiscard]] std::string file_stem(const std::string& text);

/// @param href  Already escaped for an address; empty: no link.
[[nodiscard]] std::string html_link(const std::string& href, const std::string& text);

/// What a list of trials is narrowed to: key and value, see report.js.
using TrialFilter = std::vector<std::pair<std::string, std::string>>;
/// @param root  Where the report begins, seen from the page: "" or "../".
[[nodiscard]] std::string trials_href(const TrialFilter& filter, const std::string& root = "");

/// @param href  Of the cell in that row and column (0-based); empty: no link.
[[nodiscard]] std::string html_table(
    const support::internal::Grid& grid,
    const std::function<std::string(std::size_t, std::size_t)>& href = {});

/// A whole page. @param body  HTML. @param root  See trials_href().
/// @param with_plots  Load the plot library, which must lie in the report.
[[nodiscard]] std::string html_page(const std::string& title, const std::string& body,
                                    const std::string& root, bool with_plots);

}  // namespace segsim::experiments::report::internal
