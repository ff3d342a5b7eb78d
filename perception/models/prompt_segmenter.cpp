#include "perception/models/prompt_segmenter.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "core/error.h"
#include "perception/models/internal/bilinear.h"
#include "perception/models/internal/preprocess.h"
#include "perception/models/model_description.h"

namespace segsim::perception {
namespace {

using core::InputError;

constexpr int kSidePx = 1024;
constexpr float kTopLeft = 2.0F, kBottomRight = 3.0F;  // Labels of a box's corners.
constexpr std::int64_t kNoPoint = -10;  // Hugging Face's label of a point to ignore.

class Sam final : public PromptSegmenter {
 public:
  explicit Sam(const ModelDescription& description)
      : encoder_place_(description.file("encoder").string()),
        decoder_place_(description.file("decoder").string()),
        encoder_(open_model(description.file("encoder"))),
        decoder_(open_model(description.file("decoder"))) {
    if (encoder_->inputs().size() != 1) {
      throw InputError::expected(encoder_place_, "one image input",
                                 std::to_string(encoder_->inputs().size()) + " inputs");
    }
    const TensorInfo& input = encoder_->inputs()[0];
    raw_pixels_ = input.shape_known && input.shape.size() == 3;
    side_px_ =
        raw_pixels_ ? kSidePx : stated_side(input, 2, description.height_px.value_or(kSidePx));
    // Hugging Face's labels of points are 0, 1, -1 and -10: none is a corner of a box.
    if (find_input(*decoder_, {"point_coords", "input_boxes"}) == nullptr) {
      const bool points = find_input(*decoder_, {"input_points"}) != nullptr;
      throw InputError::expected(decoder_place_, "an input point_coords or input_boxes",
                                 points ? "input_points alone, which take no box" : "neither");
    }
  }

  [[nodiscard]] std::vector<PromptMask> segment(const core::Image<core::Rgb8>& image,
                                                std::span<const core::BoxPx> boxes) override {
    SEGSIM_CHECK(!image.empty(), "no image");
    std::vector<PromptMask> masks;
    if (boxes.empty()) return masks;
    const double scale =
        static_cast<double>(side_px_) / std::max(image.width_px(), image.height_px());
    const auto scaled = [&](int side) {
      return std::clamp(static_cast<int>(std::lround(side * scale)), 1, side_px_);
    };
    const int width = scaled(image.width_px()), height = scaled(image.height_px());
    const std::vector<ModelOutput> features = encode(image, width, height);
    for (const core::BoxPx& box : boxes) {
      masks.push_back(decode(features, box, image, width, height));
    }
    return masks;
  }

 private:
  [[nodiscard]] std::vector<ModelOutput> encode(const core::Image<core::Rgb8>& image,
                                                int width, int height) const {
    const ColourImage small = resize_like_pillow(image, width, height, Kernel::kLinear);
    const std::string& name = encoder_->inputs()[0].name;
    if (!raw_pixels_) {
      return encoder_->run({{name, to_planes(small, side_px_, side_px_, kImageNet)}});
    }
    std::vector<float> values;
    for (const core::Rgb8& pixel : small.pixels()) {
      for (const std::uint8_t channel : {pixel.r, pixel.g, pixel.b}) {
        values.push_back(static_cast<float>(channel));
      }
    }
    return encoder_->run({{name, {{height, width, 3}, std::move(values)}}});
  }

  /// The encoder's output for an input of the decoder: by name, else the first.
  [[nodiscard]] HostTensor feature(const std::vector<ModelOutput>& features,
                                   const std::string& name) const {
    if (const HostTensor* found = find_output(features, {name.c_str()})) return *found;
    if (name == "image_embeddings" && features.size() == 1) return features[0].tensor;
    throw InputError::expected(encoder_place_, "an output '" + name + "'",
                               "none of that name");
  }

  [[nodiscard]] PromptMask decode(const std::vector<ModelOutput>& features,
                                  const core::BoxPx& box, const core::Image<core::Rgb8>& image,
                                  int width, int height) const {
    const float sx = static_cast<float>(width) / static_cast<float>(image.width_px());
    const float sy = static_cast<float>(height) / static_cast<float>(image.height_px());
    const std::vector<float> corners{box.x0 * sx, box.y0 * sy, box.x1 * sx, box.y1 * sy};
    constexpr std::int64_t kMaskSide = 256;
    std::map<std::string, HostTensor> inputs;
    for (const TensorInfo& info : decoder_->inputs()) {
      const std::string& name = info.name;
      if (name == "point_coords") {
        inputs[name] = {{1, 2, 2}, corners};
      } else if (name == "point_labels") {
        inputs[name] = {{1, 2}, std::vector<float>{kTopLeft, kBottomRight}};
      } else if (name == "input_boxes") {
        inputs[name] = {{1, 1, 4}, corners};
      } else if (name == "input_points") {
        inputs[name] = {{1, 1, 1, 2}, std::vector<float>{0.0F, 0.0F}};
      } else if (name == "input_labels") {
        inputs[name] = {{1, 1, 1}, std::vector<std::int64_t>{kNoPoint}};
      } else if (name == "mask_input") {
        inputs[name] = {{1, 1, kMaskSide, kMaskSide},
                        std::vector<float>(kMaskSide * kMaskSide, 0.0F)};
      } else if (name == "has_mask_input") {
        inputs[name] = {{1}, std::vector<float>{0.0F}};
      } else if (name == "orig_im_size") {
        inputs[name] = {{2},
                        std::vector<float>{static_cast<float>(image.height_px()),
                                           static_cast<float>(image.width_px())}};
      } else if (name.starts_with("image_")) {
        inputs[name] = feature(features, name);
      } else {
        throw InputError::expected(decoder_place_, "inputs of SAM's decoder",
                                   "'" + info.describe() + "'");
      }
    }
    return best_mask(decoder_->run(inputs), image, width, height);
  }

  [[nodiscard]] PromptMask best_mask(const std::vector<ModelOutput>& outputs,
                                     const core::Image<core::Rgb8>& image, int width,
                                     int height) const {
    const HostTensor* scores = find_output(outputs, {"iou_predictions", "iou_scores"});
    const HostTensor* full = find_output(outputs, {"masks"});
    const HostTensor* small = find_output(outputs, {"low_res_masks", "pred_masks"});
    const HostTensor* masks = full != nullptr ? full : small;
    if (scores == nullptr || masks == nullptr || masks->shape.size() < 4) {
      throw InputError::expected(decoder_place_,
                                 "iou_predictions with masks or low_res_masks (or iou_scores "
                                 "with pred_masks)",
                                 "others");
    }
    const std::vector<float>& iou = scores->floats();
    const auto rows = masks->shape[masks->shape.size() - 2], columns = masks->shape.back();
    const std::size_t pixels =
        static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns);
    if (iou.empty() || pixels == 0 || masks->floats().size() != iou.size() * pixels) {
      throw InputError::expected(
          decoder_place_, "one score per mask",
          std::to_string(iou.size()) + " for masks " + shape_text(masks->shape));
    }
    const auto best =
        static_cast<std::size_t>(std::max_element(iou.begin(), iou.end()) - iou.begin());
    const FloatGrid grid{masks->floats().data() + best * pixels, static_cast<int>(columns),
                         static_cast<int>(rows)};
    const bool ready =
        full != nullptr && columns == image.width_px() && rows == image.height_px();
    // Low masks cover the whole square, of which the image fills width x height.
    const double step_x =
        ready ? 1.0 : static_cast<double>(columns) / side_px_ * width / image.width_px();
    const double step_y =
        ready ? 1.0 : static_cast<double>(rows) / side_px_ * height / image.height_px();
    PromptMask result;
    result.predicted_iou = std::clamp(iou[best], 0.0F, 1.0F);
    result.inside = core::Image<std::uint8_t>(image.width_px(), image.height_px());
    for (int y = 0; y < image.height_px(); ++y) {
      for (int x = 0; x < image.width_px(); ++x) {
        const float logit = bilinear(grid, (x + 0.5) * step_x - 0.5, (y + 0.5) * step_y - 0.5);
        result.inside(x, y) = logit > 0.0F ? 1 : 0;
      }
    }
    return result;
  }

  std::string encoder_place_, decoder_place_;
  std::unique_ptr<ModelSession> encoder_, decoder_;
  bool raw_pixels_ = false;
  int side_px_ = kSidePx;
};

}  // namespace

std::unique_ptr<PromptSegmenter> load_prompt_segmenter(const std::filesystem::path& model) {
  const ModelDescription description = read_model_description(model);
  if (description.task != ModelTask::kSam) {
    throw InputError::expected(description.place, "a description with task sam",
                               "a model of another task");
  }
  return std::make_unique<Sam>(description);
}

}  // namespace segsim::perception
