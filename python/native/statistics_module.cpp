// The extension module fastsegsim._statistics: statistics of experiments/results as they are,
// so that Python's figures are those of the program's tables to the last bit.
// fastsegsim/results/statistics.py documents them.
#include <cstddef>
#include <string>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "experiments/results/statistics.h"
#include "experiments/results/training_statistics.h"

namespace segsim::python {
namespace {

namespace nb = nanobind;
using namespace nb::literals;
namespace statistics = experiments::results;

/// mean, low, high
using Mean = std::tuple<double, double, double>;
Mean mean_of(const statistics::MeanInterval& found) {
  return {found.mean, found.interval.low, found.interval.high};
}

/// What fastsegsim.results.SeededValues holds, a list for each of its columns.
std::vector<statistics::SeededValue> seeded_values(const std::vector<int>& reconstruction,
                                                   const std::vector<int>& training,
                                                   const std::vector<int>& scene,
                                                   const std::vector<int>& episode,
                                                   const std::vector<double>& value) {
  std::vector<statistics::SeededValue> values(value.size());
  for (std::size_t k = 0; k < values.size(); ++k) {
    values[k] = {reconstruction.at(k), training.at(k), scene.at(k), episode.at(k), value[k]};
  }
  return values;
}

void bind_hierarchical(nb::module_& module) {
  module.def(
      "hierarchical_interval",
      [](const std::vector<int>& reconstruction, const std::vector<int>& training,
         const std::vector<int>& scene, const std::vector<int>& episode,
         const std::vector<double>& value, double confidence) {
        return mean_of(statistics::hierarchical_interval(
            seeded_values(reconstruction, training, scene, episode, value), confidence));
      });
  module.def(
      "hierarchical_rate_interval",
      [](const std::vector<int>& reconstruction, const std::vector<int>& training,
         const std::vector<int>& scene, const std::vector<int>& episode,
         const std::vector<double>& value, double confidence) {
        return mean_of(statistics::hierarchical_rate_interval(
            seeded_values(reconstruction, training, scene, episode, value), confidence));
      });
  module.def(
      "training_test", [](const std::vector<int>& reconstruction,
                          const std::vector<int>& training, const std::vector<int>& scene,
                          const std::vector<int>& episode, const std::vector<double>& value) {
        const statistics::TrainingTest test = statistics::training_test(
            seeded_values(reconstruction, training, scene, episode, value));
        return std::tuple(test.p, test.degrees_of_freedom, test.training_sd, test.episode_sd);
      });
}

}  // namespace
}  // namespace segsim::python

NB_MODULE(_statistics, module) {
  using namespace segsim;
  namespace statistics = experiments::results;
  module.doc() = "What of fastsegsim.results is C++.";
  module.def("normal_quantile", &statistics::normal_quantile);
  module.def("clopper_pearson_interval", [](int successes, int trials, double confidence) {
    const statistics::Interval found =
        statistics::clopper_pearson_interval({successes, trials}, confidence);
    return std::pair(found.low, found.high);
  });
  module.def("mcnemar_exact_p", &statistics::mcnemar_exact_p);
  module.def("mcnemar_mid_p", &statistics::mcnemar_mid_p);
  module.def("pairs_needed", &statistics::pairs_needed);
  module.def("holm_correction", [](const std::vector<double>& p_values) {
    return statistics::holm_correction(p_values);
  });
  module.def("sign_flip_p",
             [](const std::vector<double>& differences, int rounds, unsigned seed) {
               return statistics::sign_flip_p(differences, rounds, seed);
             });
  module.def("bootstrap_mean",
             [](const std::vector<double>& values, int rounds, unsigned seed) {
               return python::mean_of(statistics::bootstrap_mean(values, rounds, seed));
             });
  module.def("verdict", [](int both, int only_after, int only_before, int neither, double p,
                           double difference, double low, double high) {
    return statistics::verdict({both, only_after, only_before, neither}, p,
                               {difference, {low, high}});
  });
  python::bind_hierarchical(module);
}
