#pragma once

/// @file
/// Still screens between the parts of a video.

#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "experiments/results/table.h"

namespace segsim::experiments::films::internal {

/// A large text above smaller paragraphs, wrapped.
[[nodiscard]] cv::Mat title_card(const std::string& title,
                                 const std::vector<std::string>& paragraphs);

/// How to read the screens that follow: panes and symbols.
[[nodiscard]] cv::Mat reading_card(const std::string& before, const std::string& after);

/// Success rates with their intervals as bars, differences, p-values, and what limits them.
[[nodiscard]] cv::Mat result_card(const results::ResultTable& table);

/// Breaks a text into lines no wider than that.
[[nodiscard]] std::vector<std::string> wrapped(const std::string& text, double letter_px,
                                               double width_px, bool bold = false);

}  // namespace segsim::experiments::films::internal
