#include <cstdio>

#include "checks.h"

namespace segsim::perception::checks {

void time_inference(const std::string& name, const DetectorWeights& weights,
                    const torch::Device& device) {
  for (const bool mixed : {false, true}) {
    Inference inference(make_inference_network(weights, name, device), weights.input_px,
                        device, mixed);
    for (const int batch : {1, 8, 16}) {
      const std::vector<core::Image<core::Rgb8>> squares(
          static_cast<std::size_t>(batch),
          core::Image<core::Rgb8>(weights.input_px, weights.input_px, {90, 120, 70}));
      const auto input = inference.upload(squares);
      constexpr int kRounds = 30;
      const double network_ms =
          median_ms(device, kRounds, [&] { (void)inference.candidates(input, 0.9F); });
      const double upload_ms =
          median_ms(device, kRounds, [&] { (void)inference.upload(squares); });
      const double pageable_ms = median_ms(device, kRounds, [&] {
        (void)torch::empty({batch, 3, weights.input_px, weights.input_px}).to(device);
      });
      std::printf(
          "time %s %d px, %s, batch %2d: network and decoding %.3f ms (%.3f an image), upload "
          "%.3f ms (pageable floats %.3f)\n",
          name.c_str(), weights.input_px, mixed ? "mixed" : "float32", batch, network_ms,
          network_ms / batch, upload_ms, pageable_ms);
      std::fflush(stdout);
    }
  }
}

}  // namespace segsim::perception::checks
