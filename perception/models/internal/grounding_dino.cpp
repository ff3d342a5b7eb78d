// Grounding DINO (Liu et al. 2023): image and caption -> boxes with a score per token.
#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "core/error.h"
#include "perception/data/nms.h"
#include "perception/models/internal/detectors.h"
#include "perception/models/internal/preprocess.h"
#include "perception/models/internal/prompt_tokens.h"

namespace segsim::perception {
namespace {

using core::InputError;

// The reference's defaults; boxes of one object found by several queries are joined at the IoU
// that Grounded-SAM uses.
constexpr float kBoxThreshold = 0.35F, kTextThreshold = 0.25F, kNmsIou = 0.8F;
constexpr int kShortestPx = 800, kLongestPx = 1333;
constexpr std::size_t kMaxTokens = 256;

class GroundingDino final : public core::Detector {
 public:
  GroundingDino(const ModelDescription& description, const ObjectDetectorOptions& options)
      : place_(description.file("model").string()),
        session_(open_model(description.file("model"))),
        class_names_(options.prompts),
        max_detections_(options.max_detections) {
    if (class_names_.empty()) {
      throw InputError::expected(place_, "a text prompt", "none");
    }
    box_threshold_ =
        options.score_threshold.value_or(description.score_threshold.value_or(kBoxThreshold));
    text_threshold_ = description.text_threshold.value_or(kTextThreshold);
    nms_iou_ = description.nms_iou.value_or(kNmsIou);
    const auto tokenizer = load_tokenizer(description.file("tokenizer"));
    tokens_ = tokenize_phrases(class_names_, *tokenizer);
    if (tokens_.ids.size() > kMaxTokens) {
      throw InputError::expected(place_, "a prompt of at most 256 tokens",
                                 std::to_string(tokens_.ids.size()));
    }
    const TensorInfo& image = image_input(*session_, place_);
    image_name_ = image.name;
    height_px_ = stated_side(image, 2, description.height_px.value_or(0));
    width_px_ = stated_side(image, 3, description.width_px.value_or(0));
  }

  [[nodiscard]] const std::vector<std::string>& class_names() const override {
    return class_names_;
  }

  [[nodiscard]] std::vector<core::Detection> detect(
      const core::Observation& observation) override {
    SEGSIM_CHECK(observation.rgb != nullptr && !observation.rgb->empty(), "no image");
    const ColourImage& image = *observation.rgb;
    int width = width_px_, height = height_px_;
    if (width == 0 || height == 0) fit(image, width, height);
    const auto outputs = session_->run(
        inputs(resize_like_pillow(image, width, height, Kernel::kLinear), width, height));
    return decode(outputs, image.width_px(), image.height_px());
  }

 private:
  /// Shortest side 800, longest at most 1333.
  static void fit(const ColourImage& image, int& width, int& height) {
    const int shortest = std::min(image.width_px(), image.height_px());
    const int longest = std::max(image.width_px(), image.height_px());
    int side = kShortestPx;
    if (static_cast<double>(longest) / shortest * side > kLongestPx) {
      side = std::max(1, static_cast<int>(std::lround(static_cast<double>(kLongestPx) *
                                                      shortest / longest)));
    }
    const auto scaled = [&](int length) {
      return std::clamp(static_cast<int>(static_cast<double>(side) * length / shortest), 1,
                        kLongestPx);
    };
    width = image.width_px() <= image.height_px() ? side : scaled(image.width_px());
    height = image.width_px() <= image.height_px() ? scaled(image.height_px()) : side;
  }

  [[nodiscard]] std::map<std::string, HostTensor> inputs(const ColourImage& image, int width,
                                                         int height) const {
    std::map<std::string, HostTensor> all;
    const auto n = static_cast<std::int64_t>(tokens_.ids.size());
    const std::vector<std::int64_t> ones(tokens_.ids.size(), 1);
    for (const TensorInfo& info : session_->inputs()) {
      const std::string& name = info.name;
      if (name == image_name_) {
        all[name] = to_planes(image, width, height, kImageNet);
      } else if (name == "input_ids") {
        all[name] = {{1, n}, tokens_.ids};
      } else if (name == "attention_mask") {
        all[name] = {{1, n}, ones};
      } else if (name == "token_type_ids") {
        all[name] = {{1, n}, std::vector<std::int64_t>(tokens_.ids.size(), 0)};
      } else if (name == "position_ids") {
        all[name] = {{1, n}, tokens_.positions};
      } else if (name == "text_token_mask" || name == "text_self_attention_masks") {
        all[name] = {{1, n, n}, tokens_.attention};
      } else if (name == "pixel_mask") {
        const bool present = height > 0 && width > 0;
        all[name] = {{1, height, width},
                     std::vector<std::int64_t>(
                         static_cast<std::size_t>(height) * static_cast<std::size_t>(width),
                         present ? 1 : 0)};
      } else {
        throw InputError::expected(place_, "inputs of Grounding DINO",
                                   "'" + info.describe() + "'");
      }
    }
    return all;
  }

  [[nodiscard]] std::vector<core::Detection> decode(const std::vector<ModelOutput>& outputs,
                                                    int width_px, int height_px) const {
    const HostTensor* logits = find_output(outputs, {"logits", "pred_logits"});
    const HostTensor* boxes = find_output(outputs, {"boxes", "pred_boxes"});
    const bool fits = logits != nullptr && boxes != nullptr && logits->shape.size() == 3 &&
                      boxes->shape.size() == 3 && boxes->shape[2] == 4 &&
                      logits->shape[1] == boxes->shape[1] && logits->shape[0] == 1 &&
                      logits->shape[2] >= static_cast<std::int64_t>(tokens_.ids.size());
    if (!fits) {
      throw InputError::expected(place_, "logits [1, n, 256] and boxes [1, n, 4]",
                                 logits == nullptr ? "others" : shape_text(logits->shape));
    }
    std::vector<core::Detection> found;
    for (std::int64_t q = 0; q < logits->shape[1]; ++q) {
      const float* row = logits->floats().data() + q * logits->shape[2];
      const auto [phrase, score] = best_phrase(row);
      if (!(score >= box_threshold_) || !(score >= text_threshold_)) continue;
      const float* b = boxes->floats().data() + 4 * q;
      const auto place = [](float at, int limit) {
        return std::clamp(at, 0.0F, 1.0F) * static_cast<float>(limit);
      };
      found.push_back({phrase,
                       score,
                       {place(b[0] - b[2] / 2, width_px), place(b[1] - b[3] / 2, height_px),
                        place(b[0] + b[2] / 2, width_px), place(b[1] + b[3] / 2, height_px)}});
    }
    return suppress_overlaps(found, nms_iou_, max_detections_);
  }

  /// The phrase with the best token, and that token's probability.
  [[nodiscard]] std::pair<int, float> best_phrase(const float* logits) const {
    int best = 0;
    float best_score = 0.0F;
    for (std::size_t p = 0; p < tokens_.spans.size(); ++p) {
      for (std::size_t t = tokens_.spans[p].first; t < tokens_.spans[p].second; ++t) {
        const float score = 1.0F / (1.0F + std::exp(-logits[t]));
        if (!(score > best_score)) continue;
        best = static_cast<int>(p);
        best_score = score;
      }
    }
    return {best, best_score};
  }

  std::string place_, image_name_;
  std::unique_ptr<ModelSession> session_;
  std::vector<std::string> class_names_;
  int max_detections_, height_px_ = 0, width_px_ = 0;
  float box_threshold_ = 0.0F, text_threshold_ = 0.0F, nms_iou_ = 0.0F;
  PromptTokens tokens_;
};

}  // namespace

PromptTokens tokenize_phrases(const std::vector<std::string>& phrases,
                              const Tokenizer& tokenizer) {
  PromptTokens tokens;
  const std::vector<std::int64_t> dot = tokenizer.pieces(".");
  std::size_t block = 0;  // Where tokens that see one another begin.
  const auto n_so_far = [&] { return tokens.ids.size(); };
  std::vector<std::pair<std::size_t, std::size_t>> blocks;
  tokens.ids.push_back(tokenizer.start_id());
  blocks.emplace_back(0, 1);
  block = 1;
  for (const std::string& phrase : phrases) {
    const std::vector<std::int64_t> pieces = tokenizer.pieces(phrase);
    tokens.spans.emplace_back(n_so_far(), n_so_far() + pieces.size());
    tokens.ids.insert(tokens.ids.end(), pieces.begin(), pieces.end());
    tokens.ids.insert(tokens.ids.end(), dot.begin(), dot.end());
    blocks.emplace_back(block, n_so_far());
    block = n_so_far();
  }
  tokens.ids.push_back(tokenizer.end_id());
  blocks.emplace_back(block, n_so_far());
  const std::size_t n = tokens.ids.size();
  tokens.positions.assign(n, 0);
  tokens.attention.assign(n * n, 0);
  for (const auto& [start, end] : blocks) {
    for (std::size_t i = start; i < end; ++i) {
      tokens.positions[i] = static_cast<std::int64_t>(i - start);
      for (std::size_t j = start; j < end; ++j) tokens.attention[i * n + j] = 1;
    }
  }
  return tokens;
}

std::unique_ptr<core::Detector> make_grounding_dino(const ModelDescription& description,
                                                    const ObjectDetectorOptions& options) {
  return std::make_unique<GroundingDino>(description, options);
}

}  // namespace segsim::perception
