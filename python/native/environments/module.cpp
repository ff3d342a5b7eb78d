// The extension module fastsegsim._environments: it needs libraries that drawing does not.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "python/native/environments/environment_batch.h"
#include "python/native/environments/settings.h"
#include "sim/trial/outcome.h"

NB_MODULE(_environments, module) {
  using namespace segsim;
  module.doc() = "What of fastsegsim.environments is C++.";
  // InputError comes to Python by what _native registers, which the package always loads
  // first.
  std::vector<std::string> outcomes;
  for (int k = 0; k <= static_cast<int>(sim::Outcome::kAborted); ++k) {
    outcomes.emplace_back(sim::to_string(static_cast<sim::Outcome>(k)));
  }
  module.attr("outcomes") = outcomes;
  python::bind_settings(module);
  python::bind_environment_batch(module);
}
