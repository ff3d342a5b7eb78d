#pragma once

/// @file
/// Small RGB-D recordings on disk and in memory, for the tests of loaders and lifting.

#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <glm/mat3x3.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "core/frames.h"
#include "tests/temporary_folder.h"

namespace segsim::reconstruction::testing {

using tests::TemporaryFolder;

inline void write_text(const std::filesystem::path& file, const std::string& text) {
  std::ofstream(file) << text;
}

inline constexpr int kWidth = 16, kHeight = 12;

/// Colour (10, 20, 30) left and (200, 100, 50) right; depth 1000 mm + x, with 0 and 65535 in
/// row 0.
inline void write_images(const std::filesystem::path& rgb,
                         const std::filesystem::path& depth) {
  cv::Mat color(kHeight, kWidth, CV_8UC3, cv::Scalar(30, 20, 10));
  color(cv::Rect(kWidth / 2, 0, kWidth / 2, kHeight)).setTo(cv::Scalar(50, 100, 200));
  cv::imwrite(rgb.string(), color);
  cv::Mat millimetres(kHeight, kWidth, CV_16UC1);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      millimetres.at<std::uint16_t>(y, x) = static_cast<std::uint16_t>(1000 + x);
    }
  }
  millimetres.at<std::uint16_t>(0, 0) = 0;
  millimetres.at<std::uint16_t>(0, 1) = 65535;
  cv::imwrite(depth.string(), millimetres);
}

inline std::string pose_line(double x, double y, double z, const char* separator = " ") {
  return "1 0 0 " + std::to_string(x) + separator + "0 1 0 " + std::to_string(y) + separator +
         "0 0 1 " + std::to_string(z) + separator + "0 0 0 1\n";
}

/// Three frames with gaps in their numbers.
inline void write_hololens(const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder / "rgb");
  std::filesystem::create_directories(folder / "depth");
  std::string poses;
  int i = 0;
  for (const char* name : {"00003", "00004", "00007"}) {
    write_images(folder / "rgb" / (std::string(name) + ".png"),
                 folder / "depth" / (std::string(name) + ".png"));
    poses += pose_line(1.0 + i++, 2.0, 3.0);
  }
  write_text(folder / "poses.txt", poses);
  write_text(folder / "K.txt", "20 0 7.5\n0 21 5.5\n0 0 1\n");
}

inline void write_seven_scenes(const std::filesystem::path& folder, bool labels) {
  for (const char* name : {"frame-000000", "frame-000002"}) {
    const std::string stem = (folder / name).string();
    write_images(stem + ".color.png", stem + ".depth.png");
    write_text(stem + ".pose.txt", pose_line(1.0, 2.0, 3.0, "\n"));
    if (!labels) continue;
    cv::Mat semantic(kHeight, kWidth, CV_16UC1, cv::Scalar(3));
    cv::Mat instance(kHeight, kWidth, CV_16UC1, cv::Scalar(700));
    instance.at<std::uint16_t>(0, 0) = 0;
    cv::imwrite(stem + ".semantic.png", semantic);
    cv::imwrite(stem + ".instance.png", instance);
  }
  write_text(folder / "intrinsics.txt", "20 0 7.5\n0 21 5.5\n0 0 1\n");
  if (!labels) return;
  write_text(folder / "labels.yaml",
             "schema: segsim.labels\nversion: 1\npixel_center: 0.5\nup: z\nsource: a test\n"
             "classes:\n  - {id: 3, name: chair, thing: true}\n"
             "instances:\n  - {id: 700, class: 3, name: ChairA}\n");
}

/// Cuts a file to the given share of its length.
inline void truncate_file(const std::filesystem::path& file, double share) {
  const auto size = static_cast<double>(std::filesystem::file_size(file));
  std::filesystem::resize_file(file, static_cast<std::uintmax_t>(size * share));
}

}  // namespace segsim::reconstruction::testing
