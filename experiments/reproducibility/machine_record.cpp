#include "experiments/reproducibility/machine_record.h"

#include <gnu/libc-version.h>

#include <cmath>
#include <memory>
#include <span>
#include <vector>

#include "core/file_io.h"
#include "core/process/measurement_record.h"
#include "core/random.h"
#include "perception/detector/library_versions.h"
#include "perception/detector/numeric_fingerprints.h"
#include "renderer/cpu_renderer.h"
#include "renderer/scene/room_scene.h"
#include "renderer/scene/simd_target.h"
#include "sim/ground/ray_scene.h"
#include "worlds/mesh/library_versions.h"
#include "worlds/procedural/procedural_flat.h"

namespace segsim::experiments::reproducibility {
namespace {

template <class T>
std::string sha256_of(const std::vector<T>& values) {
  return core::sha256_hex(std::as_bytes(std::span(values)));
}

/// The functions of the C library that poses, rays and losses go through.
std::string c_library_fingerprint() {
  core::RandomStream random(1, "fingerprint of the C library");
  std::vector<double> values;
  for (int i = 0; i < 4096; ++i) {
    const double x = random.uniform(-8.0, 8.0), y = random.uniform(0.1, 8.0);
    for (const double value : {std::sin(x), std::cos(x), std::exp(x), std::log(y),
                               std::atan2(x, y), std::pow(y, x), std::tanh(x)}) {
      values.push_back(value);
    }
    const auto narrow = static_cast<float>(x);
    values.push_back(static_cast<double>(std::exp(narrow) + std::sin(narrow)));
  }
  return sha256_of(values);
}

std::string surfel_renderer_fingerprint() {
  auto room = std::make_shared<renderer::SurfelCloud>(
      renderer::make_room_scene({.surfel_count = 20'000}));
  const auto renderer = renderer::make_cpu_renderer(room);
  const core::Frame frame =
      renderer->render(renderer::room_camera_ring(1).front(), renderer::room_camera(160, 120),
                       core::Channels::kAll);
  std::string text;
  for (const std::string& part :
       {sha256_of(frame.rgb.pixels()), sha256_of(frame.depth_m.pixels()),
        sha256_of(frame.semantic.pixels())}) {
    text += part;
  }
  return core::sha256_hex(text);
}

std::string ray_fingerprint() {
  worlds::FlatOptions options;
  options.seed = 1;
  const sim::MeshScene flat = worlds::make_flat(options);
  const sim::RayScene rays(flat);
  core::RandomStream random(1, "fingerprint of the rays");
  std::vector<float> values;
  for (int i = 0; i < 4096; ++i) {
    const glm::vec3 direction(random.normal(), random.normal(), random.normal());
    const sim::RayHit hit = rays.cast({0.0F, 0.0F, 1.2F}, direction);
    for (const float value : {hit.t, hit.u, hit.v, static_cast<float>(hit.triangle)}) {
      values.push_back(value);
    }
  }
  return sha256_of(values);
}

std::map<std::string, std::string> processor_features() {
  std::map<std::string, std::string> features;
#ifdef __x86_64__
  const auto add = [&](const char* name, int has) {
    features[name] = has != 0 ? "yes" : "no";
  };
  add("avx2", __builtin_cpu_supports("avx2"));
  add("fma", __builtin_cpu_supports("fma"));
  add("avx512f", __builtin_cpu_supports("avx512f"));
  add("avx512bf16", __builtin_cpu_supports("avx512bf16"));
  add("avx512vnni", __builtin_cpu_supports("avx512vnni"));
#endif
  return features;
}

}  // namespace

MachineRecord describe_machine() {
  MachineRecord record;
  record.kernels = core::kernel_choice();
  record.processor = core::processor_name();
  record.features = processor_features();
  record.libraries = perception::library_versions();
  record.libraries.merge(worlds::library_versions());
  record.libraries["C library"] = std::string("glibc ") + gnu_get_libc_version();
  record.libraries["compiler"] = __VERSION__;
  record.libraries["SIMD"] = renderer::simd_target();
  record.fingerprints = perception::numeric_fingerprints();
  record.fingerprints["elementary functions (C library)"] = c_library_fingerprint();
  record.fingerprints["surfel renderer (Highway)"] = surfel_renderer_fingerprint();
  record.fingerprints["ray casting (Embree)"] = ray_fingerprint();
  return record;
}

std::string processor_in_words(const MachineRecord& machine) {
  const auto has = [&](const char* feature) {
    const auto found = machine.features.find(feature);
    return found != machine.features.end() && found->second == "yes";
  };
  const char* vectors = has("avx512f") ? "AVX-512" : has("avx2") ? "AVX2" : "no AVX2";
  return machine.processor + " (" + vectors + ")";
}

}  // namespace segsim::experiments::reproducibility
