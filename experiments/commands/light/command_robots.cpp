// `segsim robots`: what can drive, and what is planned with for it.
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/formatted.h"
#include "experiments/commands/light/light_commands.h"
#include "experiments/support/text_grid.h"
#include "nav/grid/robot_fit.h"
#include "sim/ground/robot.h"

namespace segsim::experiments::commands::light {
namespace {

std::vector<std::string> row_of(const sim::RobotModel& robot) {
  const nav::RobotFit fit = nav::fit_of(robot);
  return {robot.name,
          core::print("%.3f x %.3f", robot.length_m, robot.width_m),
          core::print("%.2f", robot.max_forward_mps),
          core::print("%.2f", robot.max_turn_radps),
          core::print("%.1f", robot.max_acceleration_mps2),
          core::print("%.2f", robot.camera_height_m),
          core::print("%.2f", fit.radius_m),
          core::print("%.2f", fit.tight_radius_m),
          robot.title};
}

void list_robots(const std::vector<std::string>& files) {
  support::internal::TextGrid grid{{"Robot", "size [m]", "v [m/s]", "w [rad/s]", "a [m/s^2]",
                                    "camera [m]", "planned with [m]", "where closed [m]", ""},
                                   {}};
  const std::vector<std::string>& names = files.empty() ? sim::RobotModel::names() : files;
  for (const std::string& name : names) {
    grid.rows.push_back(row_of(sim::RobotModel::by_name(name)));
  }
  std::printf("%s", support::internal::text_of(grid).c_str());
}

}  // namespace

void add_robots_command(CLI::App& app) {
  auto files = std::make_shared<std::vector<std::string>>();
  CLI::App* command = add_listed(app, kCommands, "robots");
  command->add_option("robot", *files, "Names or files (YAML, as sim/robots/jackal.yaml)");
  command->callback([files] { list_robots(*files); });
}

}  // namespace segsim::experiments::commands::light
