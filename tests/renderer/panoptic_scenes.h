#pragma once

/// @file
/// Scenes with features and panoptic models for tests.

#include <cmath>
#include <vector>

#include <glm/geometric.hpp>

#include "core/random.h"
#include "renderer/scene/panoptic_field.h"
#include "tests/renderer/scenes.h"

namespace segsim::renderer::testing {

/// Queries all over a box of 4 m about (0, 0, 0), some of them elongated; every second class
/// is a thing.
inline PanopticModel random_model(std::uint64_t seed, int classes, int queries,
                                  float temperature = 0.1F, double sigma_max_m = 0.8) {
  core::RandomStream random(seed, "panoptic_model");
  const auto uniform = [&](double lo, double hi) {
    return static_cast<float>(random.uniform(lo, hi));
  };
  PanopticModel model;
  model.temperature = temperature;
  for (int c = 0; c < classes; ++c) {
    PanopticClass row;
    row.id = static_cast<std::uint16_t>(3 * c);
    row.thing = c % 2 == 1;
    for (float& w : row.weight) w = 0.5F * static_cast<float>(random.normal());
    row.bias = uniform(-1.0, 1.0);
    model.classes.push_back(row);
  }
  for (int q = 0; q < queries; ++q) {
    InstanceQuery query;
    query.id = static_cast<std::uint16_t>(2 * q + 7);
    query.position_m = {uniform(-2.0, 2.0), uniform(-2.0, 2.0), uniform(-2.0, 2.0)};
    query.R_world_query = random_rotation(random);
    query.sigma_m = {uniform(0.1, sigma_max_m), uniform(0.1, sigma_max_m),
                     uniform(0.1, sigma_max_m)};
    for (float& f : query.feature) f = 0.5F * static_cast<float>(random.normal());
    model.queries.push_back(query);
  }
  return model;
}

/// Dense softmax over all queries, in double precision and straight from the paper's formulas.
inline std::vector<double> dense_instances(const PanopticModel& model,
                                           const SurfelCloud& surfels, std::size_t surfel) {
  std::vector<double> p;
  double sum = 0.0;
  for (const InstanceQuery& q : model.queries) {
    const glm::dmat3 R = glm::mat3_cast(glm::normalize(glm::dquat(q.R_world_query)));
    const glm::dvec3 s(q.sigma_m);
    const glm::dmat3 S2(s.x * s.x, 0, 0, 0, s.y * s.y, 0, 0, 0, s.z * s.z);
    const glm::dmat3 inverse = glm::inverse(R * S2 * glm::transpose(R));
    const glm::dvec3 d = glm::dvec3(surfels.position_m[surfel]) - glm::dvec3(q.position_m);
    const double density_ratio = std::exp(-0.5 * glm::dot(d, inverse * d));
    double similarity = 0.0;
    for (std::size_t k = 0; k < q.feature.size(); ++k) {
      similarity += static_cast<double>(q.feature[k]) *
                    static_cast<double>(surfels.instance_feature[surfel][k]);
    }
    const double a = density_ratio / (1.0 + std::exp(-similarity));
    p.push_back(std::exp(a / static_cast<double>(model.temperature)));
    sum += p.back();
  }
  for (double& value : p) value /= sum;
  return p;
}

inline std::vector<double> dense_classes(const PanopticModel& model,
                                         const SurfelCloud& surfels, std::size_t surfel) {
  std::vector<double> p;
  double sum = 0.0;
  for (const PanopticClass& c : model.classes) {
    double logit = static_cast<double>(c.bias);
    for (std::size_t k = 0; k < c.weight.size(); ++k) {
      logit += static_cast<double>(c.weight[k]) *
               static_cast<double>(surfels.semantic_feature[surfel][k]);
    }
    p.push_back(std::exp(logit));
    sum += p.back();
  }
  for (double& value : p) value /= sum;
  return p;
}

}  // namespace segsim::renderer::testing
