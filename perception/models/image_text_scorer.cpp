#include "perception/models/image_text_scorer.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "core/check.h"
#include "core/error.h"
#include "perception/models/internal/preprocess.h"
#include "perception/models/model_description.h"
#include "perception/models/text/tokenizer.h"

namespace segsim::perception {
namespace {

using core::InputError;
using Embedding = std::vector<float>;

constexpr int kInputPx = 224;
constexpr std::int64_t kClipTokens = 77, kSiglipTokens = 64;

/// Image -> tensor, and text -> tensors, for one task.
class Inputs {
 public:
  explicit Inputs(const ModelDescription& description)
      : task_(description.task), tokenizer_(load_tokenizer(description.file("tokenizer"))) {}

  [[nodiscard]] HostTensor image(const ColourImage& source, int width, int height) const {
    if (task_ == ModelTask::kClip) {
      const double scale =
          static_cast<double>(width) / std::min(source.width_px(), source.height_px());
      const auto side = [&](int length) {
        return std::max(width, static_cast<int>(length * scale));
      };
      const ColourImage scaled = resize_like_pillow(source, side(source.width_px()),
                                                    side(source.height_px()), Kernel::kCubic);
      return to_planes(centre_crop(scaled, width), width, height, kClipColours);
    }
    const ColourImage scaled = resize_like_pillow(source, width, height, Kernel::kCubic);
    return to_planes(scaled, width, height,
                     task_ == ModelTask::kSiglip ? kHalfAndHalf : kClipColours);
  }

  /// All text inputs of the graph.
  void add_text(const std::string& text, const ModelSession& session, const std::string& place,
                std::map<std::string, HostTensor>& inputs) const {
    const TensorInfo* info = find_input(session, {"input_ids", "text", "tokens"});
    if (info == nullptr) {
      throw InputError::expected(place, "an input input_ids, text or tokens", "none");
    }
    // A model of free length reads as many tokens as there are, but for the two whose training
    // always padded.
    const std::int64_t usual = task_ == ModelTask::kItm    ? 0
                               : task_ == ModelTask::kClip ? kClipTokens
                                                           : kSiglipTokens;
    const auto length =
        static_cast<std::size_t>(stated_side(*info, 1, static_cast<int>(usual)));
    std::vector<std::int64_t> ids =
        tokenizer_->encode(text, length == 0 ? kMostTokens : length);
    std::vector<std::int64_t> mask(ids.size(), 1);
    ids.resize(std::max(ids.size(), length), tokenizer_->padding_id());
    mask.resize(ids.size(), 0);
    const std::vector<std::int64_t> shape{1, static_cast<std::int64_t>(ids.size())};
    inputs[info->name] = {shape, ids};
    if (find_input(session, {"attention_mask"}) != nullptr) {
      inputs["attention_mask"] = {shape, mask};
    }
    if (find_input(session, {"token_type_ids"}) != nullptr) {
      inputs["token_type_ids"] = {shape, std::vector<std::int64_t>(ids.size(), 0)};
    }
  }

 private:
  static constexpr std::size_t kMostTokens = 512;
  ModelTask task_;
  std::unique_ptr<Tokenizer> tokenizer_;
};

Embedding unit(const HostTensor& tensor, const std::string& place) {
  if (!std::holds_alternative<std::vector<float>>(tensor.values) || tensor.floats().empty() ||
      tensor.shape.size() > 2 || (tensor.shape.size() == 2 && tensor.shape[0] != 1)) {
    throw InputError::expected(place, "an embedding [1, n]", shape_text(tensor.shape));
  }
  Embedding values = tensor.floats();
  double sum = 0.0;
  for (const float value : values) sum += double{value} * value;
  const auto length = static_cast<float>(std::sqrt(sum));
  if (!(length > 0.0F) || !std::isfinite(length)) {
    throw InputError::expected(place, "an embedding of finite length", std::to_string(length));
  }
  for (float& value : values) value /= length;
  return values;
}

/// CLIP and SigLIP.
class Embedder final : public ImageTextScorer {
 public:
  explicit Embedder(const ModelDescription& description)
      : description_(description), inputs_(description) {
    joint_ = description.files.contains("model");
    for (const char* role : {"image", "text"}) {
      const auto& file = description.file(joint_ ? "model" : role);
      (std::string(role) == "image" ? image_place_ : text_place_) = file.string();
    }
    image_session_ = open_model(image_place_);
    if (!joint_) text_session_ = open_model(text_place_);
  }

  [[nodiscard]] std::vector<float> scores(const core::Image<core::Rgb8>& image,
                                          const std::vector<std::string>& texts) override {
    SEGSIM_CHECK(!image.empty(), "no image");
    std::vector<float> result;
    if (texts.empty()) return result;
    const Embedding seen = embed_image(image, texts[0]);
    for (const std::string& text : texts) {
      const Embedding& wanted = embed_text(text, image);
      if (wanted.size() != seen.size()) {
        throw InputError::expected(
            text_place_, "as many numbers as images have, " + std::to_string(seen.size()),
            std::to_string(wanted.size()));
      }
      double cosine = 0.0;
      for (std::size_t i = 0; i < seen.size(); ++i) cosine += double{seen[i]} * wanted[i];
      result.push_back(to_score(static_cast<float>(cosine)));
    }
    return result;
  }

 private:
  [[nodiscard]] float to_score(float cosine) const {
    if (description_.task != ModelTask::kSiglip || !description_.logit_scale ||
        !description_.logit_bias) {
      return cosine;
    }
    return 1.0F /
           (1.0F + std::exp(-(*description_.logit_scale * cosine + *description_.logit_bias)));
  }

  [[nodiscard]] std::pair<std::string, HostTensor> image_tensor(
      const ColourImage& image) const {
    const TensorInfo& info = image_input(*image_session_, image_place_);
    const int height = stated_side(info, 2, description_.height_px.value_or(kInputPx));
    const int width = stated_side(info, 3, description_.width_px.value_or(kInputPx));
    return {info.name, inputs_.image(image, width, height)};
  }

  [[nodiscard]] Embedding embed_image(const ColourImage& image,
                                      const std::string& text) const {
    std::map<std::string, HostTensor> inputs{image_tensor(image)};
    if (joint_) inputs_.add_text(text, *image_session_, image_place_, inputs);
    return pick(image_session_->run(inputs), {"image_embeds", "image_features"}, image_place_);
  }

  const Embedding& embed_text(const std::string& text, const ColourImage& image) {
    const auto known = texts_.find(text);
    if (known != texts_.end()) return known->second;
    ModelSession& session = joint_ ? *image_session_ : *text_session_;
    std::map<std::string, HostTensor> inputs;
    if (joint_) inputs.insert(image_tensor(image));
    inputs_.add_text(text, session, text_place_, inputs);
    return texts_[text] =
               pick(session.run(inputs), {"text_embeds", "text_features"}, text_place_);
  }

  /// By name, else "pooler_output", else the only output.
  [[nodiscard]] Embedding pick(const std::vector<ModelOutput>& outputs,
                               std::initializer_list<const char*> names,
                               const std::string& place) const {
    const HostTensor* found = find_output(outputs, names);
    if (found == nullptr && !joint_) found = find_output(outputs, {"pooler_output"});
    if (found == nullptr && !joint_ && outputs.size() == 1) found = &outputs[0].tensor;
    if (found == nullptr) {
      throw InputError::expected(place, std::string("an output ") + *names.begin(), "others");
    }
    return unit(*found, place);
  }

  ModelDescription description_;
  Inputs inputs_;
  bool joint_ = false;
  std::string image_place_, text_place_;
  std::unique_ptr<ModelSession> image_session_, text_session_;
  std::map<std::string, Embedding> texts_;
};

/// Image and text in one graph.
class Matcher final : public ImageTextScorer {
 public:
  explicit Matcher(const ModelDescription& description)
      : description_(description),
        place_(description.file("model").string()),
        inputs_(description),
        session_(open_model(description.file("model"))) {}

  [[nodiscard]] std::vector<float> scores(const core::Image<core::Rgb8>& image,
                                          const std::vector<std::string>& texts) override {
    SEGSIM_CHECK(!image.empty(), "no image");
    const TensorInfo& info = image_input(*session_, place_);
    const int height = stated_side(info, 2, description_.height_px.value_or(kInputPx));
    const int width = stated_side(info, 3, description_.width_px.value_or(kInputPx));
    const HostTensor pixels = inputs_.image(image, width, height);
    std::vector<float> result;
    for (const std::string& text : texts) {
      std::map<std::string, HostTensor> inputs{{info.name, pixels}};
      inputs_.add_text(text, *session_, place_, inputs);
      result.push_back(match(session_->run(inputs)));
    }
    return result;
  }

 private:
  [[nodiscard]] float match(const std::vector<ModelOutput>& outputs) const {
    const bool floating = !outputs.empty() &&
                          std::holds_alternative<std::vector<float>>(outputs[0].tensor.values);
    const std::size_t count = floating ? outputs[0].tensor.floats().size() : 0;
    if (count != 1 && count != 2) {
      throw InputError::expected(place_, "two logits or one score for a pair",
                                 floating ? shape_text(outputs[0].tensor.shape) : "others");
    }
    const std::vector<float>& logits = outputs[0].tensor.floats();
    return count == 1 ? logits[0] : 1.0F / (1.0F + std::exp(logits[0] - logits[1]));
  }

  ModelDescription description_;
  std::string place_;
  Inputs inputs_;
  std::unique_ptr<ModelSession> session_;
};

}  // namespace

std::unique_ptr<ImageTextScorer> load_image_text_scorer(const std::filesystem::path& model) {
  const ModelDescription description = read_model_description(model);
  switch (description.task) {
    case ModelTask::kClip:
    case ModelTask::kSiglip:
      return std::make_unique<Embedder>(description);
    case ModelTask::kItm:
      return std::make_unique<Matcher>(description);
    default:
      throw InputError::expected(description.place, "task clip | siglip | itm",
                                 "a model of another task");
  }
}

}  // namespace segsim::perception
