// Draws a wall of red surfels with one blue surfel before its middle, and looks at the pixels.
// Exit code 1 if they are not as they should be.
#include <cmath>
#include <cstdio>
#include <memory>

#include "core/camera.h"
#include "core/render.h"
#include "renderer/cpu_renderer.h"
#include "renderer/scene/surfels.h"

namespace {

using segsim::renderer::SurfelCloud;

/// An opaque disc that faces the z axis.
void add_disc(SurfelCloud& cloud, const glm::vec3& p_m, float scale_m,
              const glm::vec3& color) {
  cloud.position_m.push_back(p_m);
  cloud.R_world_surfel.emplace_back(1.0F, 0.0F, 0.0F, 0.0F);
  cloud.scale_m.emplace_back(scale_m, scale_m);
  cloud.opacity.push_back(0.99F);
  cloud.sh.push_back((color - 0.5F) / segsim::renderer::kShC0);
}

std::shared_ptr<SurfelCloud> wall_and_disc() {
  auto cloud = std::make_shared<SurfelCloud>();
  for (int y = -20; y <= 20; ++y) {
    for (int x = -20; x <= 20; ++x) {
      add_disc(*cloud, {0.1F * static_cast<float>(x), 0.1F * static_cast<float>(y), 2.0F},
               0.1F, {1.0F, 0.0F, 0.0F});
    }
  }
  add_disc(*cloud, {0.0F, 0.0F, 1.0F}, 0.1F, {0.0F, 0.0F, 1.0F});
  return cloud;
}

bool expect(bool holds, const char* what) {
  if (!holds) std::printf("expected %s\n", what);
  return holds;
}

}  // namespace

int main() {
  using namespace segsim;  // NOLINT(google-build-using-namespace): a program of one page
  const auto renderer = renderer::make_cpu_renderer(wall_and_disc());
  // The camera's frame is the world's: it looks along z.
  const core::Frame frame =
      renderer->render(core::CameraPose{}, core::CameraIntrinsics::from_fov(64, 48, 1.2),
                       core::Channels::kRgbd);
  const core::Rgb8 middle = frame.rgb(32, 24), beside = frame.rgb(4, 4);
  const bool good = expect(middle.b > 240 && middle.r < 15, "blue in the middle") &
                    expect(beside.r > 240 && beside.b < 15, "red beside it") &
                    expect(std::abs(frame.depth_m(32, 24) - 1.0F) < 1e-3F, "the disc at 1 m") &
                    expect(std::abs(frame.depth_m(4, 4) - 2.0F) < 1e-3F, "the wall at 2 m");
  std::printf("%d x %d pixels of %zu surfels\n", frame.rgb.width_px(), frame.rgb.height_px(),
              wall_and_disc()->size());
  return good ? 0 : 1;
}
