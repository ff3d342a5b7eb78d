#include "experiments/commands/light/flag_values.h"

#include <CLI/CLI.hpp>

#include "core/input/bounds.h"

namespace segsim::experiments::commands::light {

CLI::Validator image_side() { return CLI::Range(8, 8192); }
CLI::Validator field_of_view_deg() { return CLI::Range(10.0, 170.0); }
CLI::Validator camera_height_m() { return CLI::Range(0.01, 100.0); }
CLI::Validator coordinate() { return CLI::Range(-core::kFarthest_m, core::kFarthest_m); }
CLI::Validator length_m() { return CLI::Range(0.0, core::kFarthest_m); }

}  // namespace segsim::experiments::commands::light
