#include "perception/data/yolo_labels.h"

#include <algorithm>
#include <cstdio>
#include <ostream>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"

namespace segsim::perception {
namespace {

constexpr const char* kImages = "images/";

/// "images/a/b.png" -> "labels/a/b.txt", as the trainers derive it.
std::filesystem::path label_file(const std::string& image_file) {
  if (!image_file.starts_with(kImages)) {
    throw core::InputError::expected(image_file, "an image below images/", "another folder");
  }
  std::filesystem::path file =
      std::filesystem::path("labels") / image_file.substr(std::string(kImages).size());
  return file.replace_extension(".txt");
}

std::string line_of(const LabeledBox& box, const LabeledImage& image) {
  const auto share = [](double value, int size_px) {
    return std::clamp(value / size_px, 0.0, 1.0);
  };
  const double x0 = share(box.box.x0, image.width_px), x1 = share(box.box.x1, image.width_px);
  const double y0 = share(box.box.y0, image.height_px);
  const double y1 = share(box.box.y1, image.height_px);
  char line[96];
  std::snprintf(line, sizeof line, "%d %.6f %.6f %.6f %.6f\n", box.class_index,
                0.5 * (x0 + x1), 0.5 * (y0 + y1), x1 - x0, y1 - y0);
  return line;
}

/// A YAML scalar in double quotes.
std::string quoted(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') result += '\\';
    result += c;
  }
  return result + '"';
}

}  // namespace

int write_yolo_labels(const std::filesystem::path& folder, const CocoDataset& dataset) {
  int left_out = 0;
  for (const LabeledImage& image : dataset.images) {
    std::string text;
    for (const LabeledBox& box : image.boxes) {
      if (box.not_scored()) {
        ++left_out;
      } else {
        text += line_of(box, image);
      }
    }
    core::write_file_atomically(folder / label_file(image.file),
                                [&text](std::ostream& out) { out << text; });
  }
  return left_out;
}

void write_yolo_splits(const std::filesystem::path& folder,
                       const std::map<std::string, CocoDataset>& splits) {
  SEGSIM_CHECK(!splits.empty(), "no split");
  for (const auto& [name, dataset] : splits) {
    core::write_file_atomically(folder / (name + ".txt"),
                                [&images = dataset.images](std::ostream& out) {
                                  for (const LabeledImage& image : images)
                                    out << "./" << image.file << '\n';
                                });
  }
  core::write_file_atomically(folder / "data.yaml", [&](std::ostream& out) {
    for (const auto& [name, dataset] : splits) out << name << ": " << name << ".txt\n";
    if (!splits.contains("val")) {
      for (const char* name : {"val_views", "val_scenes"}) {
        if (!splits.contains(name)) continue;
        out << "val: " << name << ".txt\n";
        break;
      }
    }
    out << "names:\n";
    const auto& names = splits.begin()->second.class_names;
    for (std::size_t i = 0; i < names.size(); ++i) {
      out << "  " << i << ": " << quoted(names[i]) << '\n';
    }
  });
}

}  // namespace segsim::perception
