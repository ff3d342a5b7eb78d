#pragma once

/// @file
/// What the symbols on trial pictures and videos mean, and the words for outcomes.

#include <string>

#include <opencv2/core.hpp>

#include "sim/trial/trial.h"

namespace segsim::experiments::drawing {

/// In capitals, for people.
[[nodiscard]] std::string outcome_words(sim::Outcome outcome);

/// A label on a coloured ground, its baseline at `at`. @return  Its right end.
double draw_pill(cv::Mat& image, const std::string& text, const cv::Point2d& at,
                 double letter_px, const cv::Scalar& color);

/// The symbols with their words, in as many rows as `width_px` needs, from the corner on.
/// @param scale  1: rows of 30 pixels.
void draw_map_legend(cv::Mat& image, const cv::Point& corner, int width_px, double scale);
[[nodiscard]] int map_legend_height_px(int width_px, double scale);

}  // namespace segsim::experiments::drawing
