// Robots as YAML (sim/ground/robot.h).
#include "sim/ground/robot.h"

#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) { (void)sim::RobotModel::load(in_file(bytes)); }

std::vector<std::string> seeds() { return {project_file("sim/robots/jackal.yaml")}; }

}  // namespace segsim::fuzz
