// Answers of cspace/ompl.hpp: ompl_answers MAP, with rows of two configurations on standard input. It sets up a planner that
// needs a projection, and writes a line a row: isValid, clearance, checkMotion, whether lastValid agrees, lastValid's share,
// and its state.
#include <iomanip>
#include <iostream>

#include <cspace/ompl.hpp>
#include <ompl/geometric/planners/kpiece/KPIECE1.h>
#include <ompl/util/Console.h>

int main(int, char** arguments) {
  const auto map = std::make_shared<const cspace::Map>(cspace::Map::open(arguments[1]));
  ompl::geometric::SimpleSetup setup(cspace::state_space(*map));
  cspace::set_checkers(setup, map);
  const auto& si = setup.getSpaceInformation();
  // KPIECE1 throws for a space without a projection.
  ompl::msg::setLogLevel(ompl::msg::LOG_ERROR);
  setup.setPlanner(std::make_shared<ompl::geometric::KPIECE1>(si));
  setup.setup();
  ompl::base::State *first = si->allocState(), *last = si->allocState(), *reached = si->allocState();
  std::vector<double> q0(map->size()), q1(map->size());
  std::cout << std::setprecision(17);
  while (true) {
    for (double& number : q0) std::cin >> number;
    for (double& number : q1) std::cin >> number;
    if (!std::cin) return 0;
    cspace::write_state(*map, q0, first);
    cspace::write_state(*map, q1, last);
    std::pair<ompl::base::State*, double> last_valid(reached, 1.0);
    si->copyState(reached, last);
    const bool is_valid = si->getMotionValidator()->checkMotion(first, last);
    const bool again = si->getMotionValidator()->checkMotion(first, last, last_valid);
    std::cout << si->isValid(first) << " " << setup.getStateValidityChecker()->clearance(first) << " " << is_valid << " "
              << (is_valid == again) << " " << last_valid.second;
    const std::array<double, 7> numbers = cspace::numbers_of(*map, reached);
    for (std::size_t k = 0; k < map->size(); ++k) std::cout << " " << numbers[k];
    std::cout << "\n";
  }
}
