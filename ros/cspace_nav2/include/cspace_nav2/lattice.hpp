/// @file lattice.hpp
/// Search on a lattice of yaws, for robots that cannot move aside: hybrid A* (D. Dolgov et al., 2008).
#ifndef CSPACE_NAV2_LATTICE_HPP
#define CSPACE_NAV2_LATTICE_HPP

#include <functional>
#include <limits>
#include <queue>
#include <unordered_map>
#include <utility>
#include <vector>

#include "cspace_nav2/surroundings.hpp"

namespace cspace_nav2 {

/// Says whether a search must end.
using IsOver = std::function<bool()>;

/// Pairs of a cost and a number of a node or block, the least cost first.
using Queue = std::priority_queue<std::pair<double, std::int64_t>, std::vector<std::pair<double, std::int64_t>>,
                                  std::greater<>>;

/// Blocks of cells of a map, and which of them have a cell that is free at some yaw, found when asked and kept.
class Blocks {
 public:
  static constexpr std::int64_t SIDE = 4;  ///< cells

  explicit Blocks(const cspace::Map& map) : map_(map), lower_{map.lower()[0], map.lower()[1]} {
    for (std::size_t axis = 0; axis < 2; ++axis) shape_[axis] = (map.shape()[axis] - 1) / SIDE + 1;
    states_.assign(shape_[0] * shape_[1], UNKNOWN);
  }

  std::int64_t rows() const { return shape_[1]; }
  std::int64_t size() const { return shape_[0] * shape_[1]; }
  double side() const { return SIDE * map_.spacing(); }  ///< metres

  std::int64_t block_of(const Configuration& q) const {
    std::int64_t index[2];
    for (std::size_t axis = 0; axis < 2; ++axis) {
      const double place = std::floor((q[axis] - lower_[axis]) / side());
      index[axis] = static_cast<std::int64_t>(std::clamp(place, 0.0, static_cast<double>(shape_[axis] - 1)));
    }
    return index[0] * rows() + index[1];
  }

  Configuration center_of(std::int64_t block) const {
    return {lower_[0] + (static_cast<double>(block / rows()) + 0.5) * side(),
            lower_[1] + (static_cast<double>(block % rows()) + 0.5) * side(), 0.0};
  }

  bool is_open(std::int64_t block) {
    if (states_[block] == UNKNOWN) states_[block] = has_free_cell(block) ? OPEN : CLOSED;
    return states_[block] == OPEN;
  }

 private:
  enum State : unsigned char { UNKNOWN, OPEN, CLOSED };

  bool has_free_cell(std::int64_t block) const {
    const auto turns = static_cast<double>(map_.rotations());
    const Configuration center = center_of(block);
    for (double turn = 0.5; turn < turns; ++turn)
      for (std::int64_t cell = 0; cell < SIDE * SIDE; ++cell) {
        const double q[] = {center[0] + (static_cast<double>(cell / SIDE) - 0.5 * (SIDE - 1)) * map_.spacing(),
                            center[1] + (static_cast<double>(cell % SIDE) - 0.5 * (SIDE - 1)) * map_.spacing(),
                            turn / turns * 2.0 * M_PI};
        if (map_.is_free(q)) return true;
      }
    return false;
  }

  const cspace::Map& map_;
  const double lower_[2];
  std::int64_t shape_[2];
  std::vector<State> states_;
};

/// Costs of the cheapest ways to a goal through open blocks, computed when asked.
class Guide {
 public:
  Guide(Blocks& blocks, const Surroundings& surroundings, const Configuration& start, const Configuration& goal,
        const IsOver& is_over)
      : blocks_(blocks), surroundings_(surroundings), is_over_(is_over), start_(blocks.block_of(start)) {
    costs_.assign(blocks.size(), std::numeric_limits<double>::infinity());
    is_settled_.assign(blocks.size(), false);
    costs_[blocks.block_of(goal)] = 0.0;
    queue_.push({0.0, blocks.block_of(goal)});
  }

  /// Return the cost of the way from a pose; infinity if there is none.
  double cost(const Configuration& q) {
    const std::int64_t wanted = blocks_.block_of(q);
    while (!is_settled_[wanted] && !queue_.empty() && !is_over_()) settle();
    return costs_[wanted];
  }

 private:
  /// Settle the first block of the queue, and look at its neighbours.
  void settle() {
    const std::int64_t block = queue_.top().second, rows = blocks_.rows(), columns = blocks_.size() / rows;
    queue_.pop();
    if (is_settled_[block]) return;
    is_settled_[block] = true;
    const std::int64_t i = block / rows, j = block % rows;
    for (std::int64_t x = std::max<std::int64_t>(i - 1, 0); x <= std::min(i + 1, columns - 1); ++x)
      for (std::int64_t y = std::max<std::int64_t>(j - 1, 0); y <= std::min(j + 1, rows - 1); ++y) {
        const std::int64_t next = x * rows + y;
        if (is_settled_[next]) continue;
        is_settled_[next] = !blocks_.is_open(next);  // at infinity, and not asked again
        if (is_settled_[next]) continue;
        const double apart = x == i || y == j ? 1.0 : M_SQRT2;
        const double cost = costs_[block] + apart * blocks_.side() * surroundings_.weight(blocks_.center_of(next));
        if (cost >= costs_[next]) continue;
        costs_[next] = cost;
        // With the least cost from the start, A* settles fewer blocks than Dijkstra's search, and each at its least cost, too.
        const auto [near, far] = std::minmax({std::abs(x - start_ / rows), std::abs(y - start_ % rows)});
        const double rest = blocks_.side() * (static_cast<double>(far - near) + M_SQRT2 * static_cast<double>(near));
        queue_.push({cost + rest, next});
      }
  }

  Blocks& blocks_;
  const Surroundings& surroundings_;
  const IsOver& is_over_;
  std::int64_t start_;
  std::vector<double> costs_;
  std::vector<bool> is_settled_;
  Queue queue_;
};

/// Finds paths: poses between which the robot drives arcs, or straight motions of a holonomic one.
class Lattice {
 public:
  Lattice(const Surroundings& surroundings, Blocks& blocks, const IsOver& is_over)
      : surroundings_(surroundings), blocks_(blocks), is_over_(is_over) {}

  /// Return the poses of a path, both ends included; empty if none is found.
  ///
  /// If a robot that drives only ahead, or a car, has none, it may first back out, on gentle arcs, too, as from a corner.
  std::vector<Configuration> find_path(const Configuration& start, const Configuration& goal) const {
    const Drive& drive = surroundings_.drive();
    Guide guide(blocks_, surroundings_, start, goal, is_over_);
    std::vector<Configuration> path;
    const int finest = drive.is_holonomic ? 0 : FINEST;
    for (const bool backs_out : {false, true})
      for (int level = COARSEST; level >= finest && path.empty() && !is_over_(); --level)
        if (!backs_out || drive.is_car || !(drive.reverses || drive.is_holonomic))
          path = search(start, goal, guide, level, std::numeric_limits<double>::infinity(), backs_out);
    shorten(path);
    return path;
  }

  /// Return the poses of a path that costs less than a bound, by a coarse search; empty if it finds none.
  std::vector<Configuration> find_cheaper(const Configuration& start, const Configuration& goal, double bound) const {
    Guide guide(blocks_, surroundings_, start, goal, is_over_);
    if (guide.cost(start) >= bound) return {};
    std::vector<Configuration> path = search(start, goal, guide, COARSEST, bound);
    shorten(path);
    return path;
  }

 private:
  static constexpr int COARSEST = 2, FINEST = -1;
  static constexpr int YAWS = 96;
  static constexpr int SHORTENING_ROUNDS = 2;
  static constexpr double SUFFICIENT = 1.08;   ///< a path may cost more than the bound of all others by this factor
  static constexpr double SUFFICIENT_BESIDE_WALLS = 1.5;  ///< the same at the finest level, which takes the most steps
  static constexpr double MIN_GAIN = 1e-3;     ///< metres
  static constexpr double SIDESTEP = 0.1;      ///< metres by which a path is moved away from what is near
  static constexpr std::size_t MIN_SIDESTEP_POSES = 16;  ///< of a part that is moved
  static constexpr double MAX_STRAIGHT = 3.0;  ///< metres of a move at a small angle to a wall
  static constexpr double INSIDE = 0.05;       ///< cells by which it ends in the next one
  static constexpr double NEAR = 3.0;          ///< metres to the goal within which curves bound costs

  /// A pose that a search has reached, and the arc that leads to it from its parent.
  struct Node {
    Configuration q;
    std::int64_t parent;
    Arc arc;
    double cost;
    bool may_reverse;  ///< a robot that backs out may until it drives ahead
  };

  /// Search with one pose for each cell of a lattice of a level, and each of a number of yaws.
  std::vector<Configuration> search(const Configuration& start, const Configuration& goal, Guide& guide, int level,
                                    double bound, bool backs_out = false) const {
    const Drive& drive = surroundings_.drive();
    const double side = surroundings_.map().spacing() * (1 << std::max(level, 0));
    // The finest level has yaws beside the middle of each cell of yaw, in which a robot beside a wall has to stay at first.
    const int yaws = level < 0 ? std::max(YAWS, 3 * static_cast<int>(surroundings_.map().rotations())) : YAWS >> level;
    const double yaw_step = 2.0 * M_PI / yaws;
    const std::vector<Arc> wide_moves = drive.moves(std::sqrt(2.0) * side, yaw_step, backs_out, false);
    const std::vector<Arc> narrow_moves = drive.moves(std::sqrt(2.0) * side, yaw_step, backs_out, true);
    std::vector<Node> nodes = {{start, -1, {}, 0.0, drive.reverses || backs_out}};
    std::unordered_map<std::int64_t, std::int64_t> node_of;  // by cell and yaw
    std::vector<Configuration> end;                          // of the cheapest path found
    std::int64_t last = 0;
    Queue queue;
    queue.push({0.0, 0});
    for (double wait = 0.0; !queue.empty() && !is_over_(); --wait) {
      const auto [least, number] = queue.top();
      queue.pop();
      if (least * (level < 0 ? SUFFICIENT_BESIDE_WALLS : SUFFICIENT) >= bound) break;
      const Node node = nodes[number];
      const std::int64_t key = key_of(node.q, side, yaws);
      const auto known = node_of.find(key);
      if (known != node_of.end() && nodes[known->second].cost <= node.cost) continue;
      // Only now, as most nodes are never taken from the queue.
      if (number > 0 && !move_is_free(nodes[node.parent].q, node)) continue;
      node_of[key] = number;
      if (wait <= 0.0) {
        const std::vector<Configuration> way = surroundings_.connect(node.q, goal, bound - node.cost);
        const double cost = node.cost + surroundings_.cost(way);
        if (!way.empty() && cost < bound && surroundings_.poses_are_free(way)) {
          end = way;
          last = number;
          bound = cost;
        }
        wait = guide.cost(node.q) / (4.0 * side);
      }
      const double astray = node.q[2] - yaw_step * std::round(node.q[2] / yaw_step);
      const bool is_wide = surroundings_.is_wide(node.q);
      std::vector<Arc> fine_moves;
      if (level < 0 && !is_wide) {
        fine_moves = narrow_moves;
        for (const double way : {1.0, -1.0}) fine_moves.push_back({way * length_across(node.q, way), 0.0});
      }
      for (Arc move : is_wide ? wide_moves : level < 0 ? fine_moves : narrow_moves) {
        if (move.length < 0.0 && !node.may_reverse) continue;
        // The first turn leads to a yaw of the lattice, some of which are along most walls.
        if (move.angle != 0.0) move = {move.length * (1.0 - astray / move.angle), move.angle - astray};
        const Configuration next = advance(node.q, move);
        const double cost = node.cost + cost_of(move) * surroundings_.weight(next);
        if (cost >= bound) continue;
        const std::int64_t next_key = key_of(next, side, yaws);
        const auto found = node_of.find(next_key);
        if (next_key == key || (found != node_of.end() && nodes[found->second].cost <= cost)) continue;
        double rest = guide.cost(next);
        if (cost + rest >= bound) continue;  // before a curve is computed, which takes longest
        if (std::hypot(goal[0] - next[0], goal[1] - next[1]) < NEAR) rest = std::max(rest, drive.least_cost(next, goal));
        if (cost + rest >= bound) continue;
        queue.push({cost + rest, static_cast<std::int64_t>(nodes.size())});
        nodes.push_back({next, number, move, cost, drive.reverses || (node.may_reverse && move.length <= 0.0)});
      }
    }
    return end.empty() ? end : trace(nodes, last, end);
  }

  /// Return how far it is, ahead or back, into the next column and row of cells, at most `MAX_STRAIGHT`.
  ///
  /// At small angles to a wall, shorter moves would end in cells that are also reached along the wall, and be forgotten.
  double length_across(const Configuration& q, double way) const {
    const cspace::Map& map = surroundings_.map();
    const double parts[] = {way * std::cos(q[2]), way * std::sin(q[2])};
    double length = 0.0;
    for (int axis = 0; axis < 2; ++axis) {
      const double place = (q[axis] - map.lower()[axis]) / map.spacing(), passed = place - std::floor(place);
      const double rest = (parts[axis] > 0.0 ? 1.0 - passed : passed) + INSIDE;
      length = std::max(length, map.spacing() * rest / std::abs(parts[axis]));
    }
    return std::min(length, MAX_STRAIGHT);
  }

  /// Return true if the move to a node is free: a straight one by one proof, which takes less time than those of its poses.
  bool move_is_free(const Configuration& from, const Node& node) const {
    if (node.arc.angle == 0.0) return surroundings_.motion_is_free(from, node.q);
    return surroundings_.poses_are_free(surroundings_.poses_along(from, {node.arc}));
  }

  std::int64_t key_of(const Configuration& q, double side, int yaws) const {
    const cspace::Map& map = surroundings_.map();
    const auto column = static_cast<std::int64_t>((q[0] - map.lower()[0]) / side);
    const auto row = static_cast<std::int64_t>((q[1] - map.lower()[1]) / side);
    const auto yaw = static_cast<std::int64_t>(std::floor(wrap(q[2]) / (2.0 * M_PI) * yaws + 0.5));
    return (column * (std::int64_t{1} << 31) + row) * (2 * yaws) + (yaw + yaws) % yaws;
  }

  std::vector<Configuration> trace(const std::vector<Node>& nodes, std::int64_t number,
                                   const std::vector<Configuration>& end) const {
    std::vector<std::int64_t> way;
    for (; number > 0; number = nodes[number].parent) way.push_back(number);
    std::vector<Configuration> path = {nodes[0].q};
    for (; !way.empty(); way.pop_back()) {
      const Node& node = nodes[way.back()];
      const std::vector<Configuration> poses = surroundings_.poses_along(nodes[node.parent].q, {node.arc});
      path.insert(path.end(), poses.begin() + 1, poses.end());
    }
    path.insert(path.end(), end.begin() + 1, end.end());
    return path;
  }

  /// Replace parts of a path by cheaper curves, long parts first.
  void shorten(std::vector<Configuration>& path) const {
    for (int round = 0; round < SHORTENING_ROUNDS; ++round)
      if (!shorten_once(path)) return;
  }

  bool shorten_once(std::vector<Configuration>& path) const {
    bool is_changed = false;
    std::vector<double> costs = list_costs(path);
    for (std::size_t reach = path.size(); reach >= 8; reach /= 2)
      for (std::size_t first = 0; first + 2 < path.size() && !is_over_(); first += std::max<std::size_t>(1, reach / 4)) {
        const std::size_t last = std::min(first + reach, path.size() - 1);
        const double target = costs[last] - costs[first] - MIN_GAIN;
        if (std::hypot(path[last][0] - path[first][0], path[last][1] - path[first][1]) >= target) continue;
        for (const double aside : {0.0, SIDESTEP, -SIDESTEP}) {
          if (aside != 0.0 && last - first < MIN_SIDESTEP_POSES) break;
          const std::vector<Configuration> poses = pass(path[first], path[(first + last) / 2], path[last], aside, target);
          if (poses.empty() && aside == 0.0) break;  // nor is a detour shorter
          if (poses.empty() || surroundings_.cost(poses) >= target || !surroundings_.poses_are_free(poses)) continue;
          path.erase(path.begin() + first + 1, path.begin() + last + 1);
          path.insert(path.begin() + first + 1, poses.begin() + 1, poses.end());
          costs = list_costs(path);
          is_changed = true;
          break;
        }
      }
    return is_changed;
  }

  /// Return the shortest way between two poses, or that past a middle one which is moved aside; empty if its cost without
  /// obstacles reaches a bound.
  std::vector<Configuration> pass(const Configuration& from, Configuration middle, const Configuration& to, double aside,
                                  double bound) const {
    if (aside == 0.0) return surroundings_.connect(from, to, bound);
    const double heading = std::atan2(to[1] - from[1], to[0] - from[0]);
    middle[0] -= aside * std::sin(heading);
    middle[1] += aside * std::cos(heading);
    std::vector<Configuration> poses = surroundings_.connect(from, middle, bound);
    if (poses.empty()) return poses;
    const std::vector<Configuration> rest = surroundings_.connect(middle, to, bound - surroundings_.cost(poses));
    if (rest.empty()) return rest;
    poses.insert(poses.end(), rest.begin() + 1, rest.end());
    return poses;
  }

  /// Return the costs of a path from its first pose to each one.
  std::vector<double> list_costs(const std::vector<Configuration>& path) const {
    std::vector<double> costs(path.size(), 0.0);
    for (std::size_t k = 1; k < path.size(); ++k) costs[k] = costs[k - 1] + surroundings_.cost(path[k - 1], path[k]);
    return costs;
  }

  const Surroundings& surroundings_;
  Blocks& blocks_;
  const IsOver& is_over_;
};

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_LATTICE_HPP
