#pragma once

#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

/// Budgets that specs and trials name, where they are for files of specs/ and trials/.
inline void copy_budgets() {
  static const bool copied = [] {
    for (const char* folder : {"budgets", "specs", "trials"}) {
      std::filesystem::create_directories(work_folder() / folder);
    }
    for (const std::string name : {"budgets/amd-epyc.yaml", "budgets/example-edge.yaml"}) {
      (void)in_file(project_file("experiments/" + name), name);
    }
    return true;
  }();
  (void)copied;
}

}  // namespace segsim::fuzz
