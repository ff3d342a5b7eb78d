#include <algorithm>
#include <cmath>
#include <map>

#include "core/check.h"
#include "core/error.h"
#include "perception/data/letterbox.h"
#include "perception/data/nms.h"
#include "perception/models/internal/detectors.h"
#include "perception/models/internal/preprocess.h"

namespace segsim::perception {
namespace {

using core::Detection;
using core::InputError;

constexpr float kScoreThreshold = 0.25F, kNmsIou = 0.7F;  // Ultralytics' defaults.
constexpr int kInputPx = 640;

/// A matrix of an output: element (row, column), however it is stored.
struct Table {
  const float* values;
  std::int64_t rows, columns, row_stride, column_stride;

  [[nodiscard]] float operator()(std::int64_t row, std::int64_t column) const {
    return values[row * row_stride + column * column_stride];
  }
};

class Yolo final : public core::Detector {
 public:
  Yolo(const ModelDescription& description, const ObjectDetectorOptions& options)
      : place_(description.file("model").string()),
        session_(open_model(description.file("model"))),
        max_detections_(options.max_detections) {
    score_threshold_ = options.score_threshold.value_or(
        description.score_threshold.value_or(kScoreThreshold));
    nms_iou_ = description.nms_iou.value_or(kNmsIou);
    const TensorInfo& input = image_input(*session_, place_);
    input_name_ = input.name;
    height_px_ = stated_side(input, 2, description.height_px.value_or(metadata_side(0)));
    width_px_ = stated_side(input, 3, description.width_px.value_or(metadata_side(1)));
    model_names_ = description.class_names;
    if (const auto names = session_->metadata().find("names");
        model_names_.empty() && names != session_->metadata().end()) {
      model_names_ = parse_class_names(names->second, place_ + ": names");
    }
    if (model_names_.empty()) {
      throw InputError::expected(
          place_, "class_names in a description, or 'names' in the file", "neither");
    }
    choose_classes(options.prompts);
  }

  [[nodiscard]] const std::vector<std::string>& class_names() const override {
    return class_names_;
  }

  [[nodiscard]] std::vector<Detection> detect(const core::Observation& observation) override {
    SEGSIM_CHECK(observation.rgb != nullptr && !observation.rgb->empty(), "no image");
    const ColourImage& image = *observation.rgb;
    const Letterbox fit =
        Letterbox::fit(image.width_px(), image.height_px(), width_px_, height_px_);
    // The reference does not average when it shrinks: letterbox() would.
    const ColourImage scaled =
        resize_like_opencv(image, fit.scaled_width_px(), fit.scaled_height_px());
    ColourImage square(width_px_, height_px_,
                       {kLetterboxGrey, kLetterboxGrey, kLetterboxGrey});
    for (int y = 0; y < scaled.height_px(); ++y) {
      std::copy(scaled.row(y), scaled.row(y) + scaled.width_px(),
                square.row(fit.offset_y_px + y) + fit.offset_x_px);
    }
    std::vector<Detection> found = decode(
        session_->run({{input_name_, to_planes(square, width_px_, height_px_, kZeroToOne)}}));
    for (Detection& detection : found) detection.box = fit.to_image(detection.box);
    return found;
  }

 private:
  /// Ultralytics' "imgsz": "[640, 640]" (height, width).
  [[nodiscard]] int metadata_side(std::size_t axis) const {
    const auto found = session_->metadata().find("imgsz");
    if (found == session_->metadata().end()) return kInputPx;
    int sides[2] = {0, 0};
    const int read = std::sscanf(found->second.c_str(), "[%d, %d]", &sides[0], &sides[1]);
    constexpr int kMost = 8192;
    const bool fits =
        read == 2 && sides[0] > 0 && sides[0] <= kMost && sides[1] > 0 && sides[1] <= kMost;
    return fits ? sides[axis] : kInputPx;
  }

  void choose_classes(const std::vector<std::string>& wanted) {
    class_names_ = wanted.empty() ? model_names_ : wanted;
    for (std::size_t i = 0; i < class_names_.size(); ++i) {
      const auto found = std::find(model_names_.begin(), model_names_.end(), class_names_[i]);
      if (found == model_names_.end()) {
        throw InputError::expected(place_, "classes of the model",
                                   "'" + class_names_[i] + "', which it does not have");
      }
      class_of_[found - model_names_.begin()] = static_cast<int>(i);
    }
  }

  [[nodiscard]] std::vector<Detection> decode(const std::vector<ModelOutput>& outputs) const {
    if (outputs.size() >= 4 && outputs[1].tensor.shape.size() == 3 &&
        outputs[1].tensor.shape[2] == 4) {
      return from_four(outputs);
    }
    // A segmentation or pose model has more outputs; the first is the boxes.
    if (outputs.empty() ||
        !std::holds_alternative<std::vector<float>>(outputs[0].tensor.values)) {
      throw InputError::expected(place_, "boxes as the first output", "none");
    }
    const HostTensor& tensor = outputs[0].tensor;
    std::vector<std::int64_t> shape = tensor.shape;
    if (shape.size() == 3 && shape[0] == 1) shape.erase(shape.begin());
    const auto classes = static_cast<std::int64_t>(model_names_.size());
    if (shape.size() == 2) {
      const float* values = tensor.floats().data();
      const Table by_row{values, shape[0], shape[1], shape[1], 1};
      const Table by_column{values, shape[1], shape[0], 1, shape[1]};
      // Told by the number of classes. Masks have 32 coefficients behind the scores.
      constexpr std::int64_t kCoefficients = 32;
      const bool batched = tensor.shape.size() == 3;
      if (batched && (shape[0] == 4 + classes || shape[0] == 4 + classes + kCoefficients)) {
        return suppress(dense(by_column, 4, false));
      }
      if (batched && shape[1] == 6 && classes <= 2) {  // 5 + 1 and 4 + 2 numbers, too.
        throw InputError::expected(
            place_,
            "an output [1, " + std::to_string(4 + classes) +
                ", n] (exported without nms), since for " + std::to_string(classes) +
                (classes == 1 ? " class" : " classes") +
                " six columns may be chosen boxes or scores of all anchors",
            shape_text(tensor.shape));
      }
      if (shape[1] == 6) return listed(by_row, 0, 4, 5);
      if (!batched && shape[1] == 7) return listed(by_row, 1, 6, 5);
      if (batched && shape[1] == 5 + classes) return suppress(dense(by_row, 5, true));
      if (batched && shape[1] == 4 + classes) return suppress(dense(by_row, 4, false));
    }
    throw InputError::expected(place_,
                               "an output [1, " + std::to_string(4 + classes) +
                                   ", n], [1, n, " + std::to_string(5 + classes) +
                                   "], [1, n, 6] or [n, 7] for its " +
                                   std::to_string(classes) + " classes",
                               shape_text(tensor.shape));
  }

  /// Centre, size and scores of every anchor.
  [[nodiscard]] std::vector<Detection> dense(const Table& table, std::int64_t first,
                                             bool objectness) const {
    std::vector<Detection> found;
    for (std::int64_t a = 0; a < table.rows; ++a) {
      const float factor = objectness ? table(a, 4) : 1.0F;
      for (const auto& [model_class, index] : class_of_) {
        const float score = factor * table(a, first + model_class);
        if (!(score >= score_threshold_)) continue;
        const float x = table(a, 0), y = table(a, 1);
        const float w = table(a, 2) / 2.0F, h = table(a, 3) / 2.0F;
        found.push_back({index, std::min(score, 1.0F), {x - w, y - h, x + w, y + h}});
      }
    }
    return found;
  }

  [[nodiscard]] std::vector<Detection> suppress(const std::vector<Detection>& all) const {
    return suppress_overlaps(all, nms_iou_, max_detections_);
  }

  /// Rows that the graph has already chosen; unused rows have score 0.
  [[nodiscard]] std::vector<Detection> listed(const Table& table, std::int64_t box,
                                              std::int64_t score, std::int64_t label) const {
    std::vector<Detection> found;
    for (std::int64_t i = 0; i < table.rows; ++i) {
      add(found, table(i, label), table(i, score),
          {table(i, box), table(i, box + 1), table(i, box + 2), table(i, box + 3)});
    }
    return sorted(std::move(found));
  }

  void add(std::vector<Detection>& found, float label, float score,
           const core::BoxPx& box) const {
    if (!(score >= score_threshold_) || !(score > 0.0F)) return;
    const auto known =
        std::isfinite(label) ? class_of_.find(std::lround(label)) : class_of_.end();
    if (known != class_of_.end()) found.push_back({known->second, std::min(score, 1.0F), box});
  }

  [[nodiscard]] std::vector<Detection> sorted(std::vector<Detection> found) const {
    std::stable_sort(found.begin(), found.end(),
                     [](const auto& a, const auto& b) { return a.score > b.score; });
    if (found.size() > static_cast<std::size_t>(max_detections_)) {
      found.resize(static_cast<std::size_t>(max_detections_));
    }
    return found;
  }

  /// Count [1, 1], boxes [1, n, 4], scores [1, n], classes [1, n].
  [[nodiscard]] std::vector<Detection> from_four(
      const std::vector<ModelOutput>& outputs) const {
    const auto numbers = [&](std::size_t i) {
      const auto& values = outputs[i].tensor.values;
      if (const auto* floats = std::get_if<std::vector<float>>(&values)) return *floats;
      const auto& integers = outputs[i].tensor.integers();
      return std::vector<float>(integers.begin(), integers.end());
    };
    const std::vector<float> count = numbers(0), boxes = numbers(1), scores = numbers(2),
                             labels = numbers(3);
    if (count.size() != 1 || boxes.size() != 4 * scores.size() ||
        labels.size() != scores.size()) {
      throw InputError::expected(place_, "count, boxes, scores and classes that agree",
                                 shape_text(outputs[1].tensor.shape));
    }
    std::vector<Detection> found;
    for (std::size_t i = 0; i < scores.size() && static_cast<float>(i) < count[0]; ++i) {
      add(found, labels[i], scores[i],
          {boxes[4 * i], boxes[4 * i + 1], boxes[4 * i + 2], boxes[4 * i + 3]});
    }
    return sorted(std::move(found));
  }

  std::string place_, input_name_;
  std::unique_ptr<ModelSession> session_;
  int max_detections_, height_px_ = 0, width_px_ = 0;
  float score_threshold_ = 0.0F, nms_iou_ = 0.0F;
  std::vector<std::string> model_names_, class_names_;
  std::map<std::int64_t, int> class_of_;  ///< Class of the model -> class_names_.
};

/// Position of the first character that is no blank.
std::size_t skip_blanks(const std::string& text, std::size_t at) {
  while (at < text.size() && (text[at] == ' ' || text[at] == '\n')) ++at;
  return at;
}

}  // namespace

std::vector<std::string> parse_class_names(const std::string& text, const std::string& place) {
  const auto refuse = [&] {
    throw InputError::expected(place, "names like {0: 'person', 1: 'chair'}",
                               text.substr(0, 60));
  };
  std::map<int, std::string> names;
  std::size_t at = skip_blanks(text, 0);
  if (at >= text.size() || text[at] != '{') refuse();
  ++at;
  while (true) {
    at = skip_blanks(text, at);
    if (at < text.size() && text[at] == '}') break;
    const bool quoted_key = at < text.size() && text[at] == '"';
    at += quoted_key ? 1 : 0;
    int key = 0;
    std::size_t digits = 0;
    for (; at < text.size() && text[at] >= '0' && text[at] <= '9' && digits < 6;
         ++at, ++digits) {
      key = key * 10 + (text[at] - '0');
    }
    at = skip_blanks(text, at + (quoted_key ? 1 : 0));
    if (digits == 0 || at >= text.size() || text[at] != ':') refuse();
    at = skip_blanks(text, at + 1);
    if (at >= text.size() || (text[at] != '\'' && text[at] != '"')) refuse();
    const char quote = text[at++];
    std::string name;
    while (at < text.size() && text[at] != quote) {
      if (text[at] == '\\' && at + 1 < text.size()) ++at;
      name.push_back(text[at++]);
    }
    if (at >= text.size()) refuse();
    names[key] = name;
    at = skip_blanks(text, at + 1);
    if (at < text.size() && text[at] == ',') ++at;
  }
  std::vector<std::string> list;
  for (const auto& [key, name] : names) {
    if (key != static_cast<int>(list.size())) refuse();
    list.push_back(name);
  }
  return list;
}

std::unique_ptr<core::Detector> make_yolo(const ModelDescription& description,
                                          const ObjectDetectorOptions& options) {
  return std::make_unique<Yolo>(description, options);
}

}  // namespace segsim::perception
