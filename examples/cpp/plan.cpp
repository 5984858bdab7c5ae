// Plan on a saved map with RRTConnect and BIT*: plan MAP OUTPUT START... GOAL...
//
// The path of each planner is written to OUTPUT-PLANNER.csv, a configuration a line, for Python's certify_path.
#include <fstream>
#include <iomanip>
#include <iostream>

#include <ompl/geometric/planners/informedtrees/BITstar.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>

#include <cspace/ompl.hpp>

namespace ob = ompl::base;
namespace og = ompl::geometric;

int main(int count, char** arguments) try {
  ompl::msg::setLogLevel(ompl::msg::LOG_WARN);
  if (count < 3) throw std::invalid_argument("usage: plan MAP OUTPUT START... GOAL...");
  const auto map = std::make_shared<const cspace::Map>(cspace::Map::open(arguments[1]));
  if (static_cast<std::size_t>(count) != 3 + 2 * map->size()) throw std::invalid_argument("start and goal have other lengths");
  std::vector<double> ends;
  for (int k = 3; k < count; ++k) ends.push_back(std::stod(arguments[k]));

  for (const std::string name : {"RRTConnect", "BITstar"}) {
    og::SimpleSetup setup(cspace::state_space(*map));
    cspace::set_checkers(setup, map);
    ob::ScopedState<> start(setup.getStateSpace()), goal(setup.getStateSpace());
    const auto middle = ends.begin() + static_cast<std::ptrdiff_t>(map->size());
    cspace::write_state(*map, {ends.begin(), middle}, start.get());
    cspace::write_state(*map, {middle, ends.end()}, goal.get());
    setup.setStartAndGoalStates(start, goal);
    const auto& si = setup.getSpaceInformation();
    if (name == "BITstar") setup.setPlanner(std::make_shared<og::BITstar>(si));
    else setup.setPlanner(std::make_shared<og::RRTConnect>(si));
    // BIT* goes on to shorten its path until the time is over.
    if (setup.solve(1.0) != ob::PlannerStatus::EXACT_SOLUTION) {
      std::cout << name << ": no path in a second\n";
      continue;
    }
    og::PathGeometric& path = setup.getSolutionPath();
    std::ofstream file(std::string(arguments[2]) + "-" + name + ".csv");
    file << std::setprecision(17);
    for (const ob::State* state : path.getStates()) {
      const std::array<double, 7> q = cspace::numbers_of(*map, state);
      for (std::size_t k = 0; k < map->size(); ++k) file << (k > 0 ? "," : "") << q[k];
      file << "\n";
    }
    std::cout << name << ": " << path.getStateCount() << " states, length " << path.length() << "\n";
  }
  return 0;
} catch (const std::exception& error) {
  std::cerr << error.what() << "\n";
  return 2;
}
