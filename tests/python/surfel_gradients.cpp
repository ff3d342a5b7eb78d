// What the differentiable rasterizer makes of surfels without Python between:
//
//   surfel_gradients float|double < INPUT > OUTPUT
//
// Binary, in this machine's order of bytes. INPUT: count, SH degree, active SH degree, width
// and height as int64; T_world_camera and K as float64 matrices; position_m, log_scale,
// rotation, opacity_logit and sh; derivatives by rgb, depth_m, alpha, normal and distortion.
// OUTPUT: the images rgb, depth_m, alpha, normal, distortion and median_m; max_weight;
// derivatives by the surfels' arrays, and screen.
#include <cstdint>
#include <iostream>
#include <string>
#include <vector>

#include <glm/gtc/quaternion.hpp>

#include "reconstruction/rasterizer/differentiable_rasterizer.h"

namespace segsim::reconstruction {
namespace {

template <class Value>
std::vector<Value> read(std::size_t count) {
  std::vector<Value> values(count);
  std::cin.read(reinterpret_cast<char*>(values.data()),
                static_cast<std::streamsize>(count * sizeof(Value)));
  if (!std::cin) throw std::runtime_error("the input ends too early");
  return values;
}

template <class Value>
void write(const std::vector<Value>& values) {
  std::cout.write(reinterpret_cast<const char*>(values.data()),
                  static_cast<std::streamsize>(values.size() * sizeof(Value)));
}

template <class Real>
void run() {
  const auto head = read<std::int64_t>(5);
  const auto T = read<double>(16);
  const auto K = read<double>(9);
  const auto count = static_cast<std::size_t>(head[0]);
  const auto area = static_cast<std::size_t>(head[3] * head[4]);
  const auto sh_values = static_cast<std::size_t>(3 * (head[1] + 1) * (head[1] + 1)) * count;
  const auto position_m = read<Real>(3 * count), log_scale = read<Real>(2 * count),
             rotation = read<Real>(4 * count), opacity_logit = read<Real>(count),
             sh = read<Real>(sh_values);
  const auto by_rgb = read<Real>(3 * area), by_depth = read<Real>(area),
             by_alpha = read<Real>(area), by_normal = read<Real>(3 * area),
             by_distortion = read<Real>(area);

  const glm::dmat3 R({T[0], T[4], T[8]}, {T[1], T[5], T[9]}, {T[2], T[6], T[10]});
  const core::CameraPose T_world_camera(glm::normalize(glm::quat_cast(R)),
                                        {T[3], T[7], T[11]});
  const int width = static_cast<int>(head[3]), height = static_cast<int>(head[4]);
  const core::CameraIntrinsics camera{width, height, K[0], K[4], K[2], K[5]};
  const SurfelParameters<Real> surfels{head[0],
                                       static_cast<int>(head[1]),
                                       static_cast<int>(head[2]),
                                       position_m.data(),
                                       log_scale.data(),
                                       rotation.data(),
                                       opacity_logit.data(),
                                       sh.data()};
  std::vector<Real> rgb(3 * area), depth(area), alpha(area), normal(3 * area), median(area),
      distortion(area), max_weight(count);
  const auto rasterizer = make_cpu_rasterizer<Real>();
  rasterizer->forward(surfels, camera, T_world_camera,
                      {width, height, rgb.data(), depth.data(), alpha.data(), normal.data(),
                       median.data(), distortion.data()},
                      max_weight.data());
  std::vector<Real> by_position(3 * count), by_scale(2 * count), by_rotation(4 * count),
      by_logit(count), by_sh(sh_values), screen(count);
  rasterizer->backward(surfels,
                       {width, height, by_rgb.data(), by_depth.data(), by_alpha.data(),
                        by_normal.data(), nullptr, by_distortion.data()},
                       {by_position.data(), by_scale.data(), by_rotation.data(),
                        by_logit.data(), by_sh.data(), screen.data(), nullptr});
  for (const auto* values :
       {&rgb, &depth, &alpha, &normal, &distortion, &median, &max_weight, &by_position,
        &by_scale, &by_rotation, &by_logit, &by_sh, &screen}) {
    write(*values);
  }
}

}  // namespace
}  // namespace segsim::reconstruction

int main(int argc, char** argv) {
  try {
    const std::string kind = argc == 2 ? argv[1] : "";
    if (kind != "float" && kind != "double") {
      std::cerr << "surfel_gradients: expected float or double\n";
      return 2;
    }
    kind == "float" ? segsim::reconstruction::run<float>()
                    : segsim::reconstruction::run<double>();
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "surfel_gradients: " << error.what() << '\n';
    return 1;
  }
}
