// `segsim-light`: the subcommands that read results and files alone, and --help for all.
#include "experiments/commands/light/light_commands.h"
#include "experiments/program.h"

int main(int argc, char** argv) {
  return segsim::experiments::run_program(
      argc, argv, segsim::experiments::commands::light::add_light_commands);
}
