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

/// Lengths of the shortest ways to a goal through blocks of cells that are free at some yaw, computed when asked.
class Guide {
 public:
  /// @param block_side  number of cells along each side of a block
  Guide(const cspace::Map& map, const Configuration& goal, int block_side, const IsOver& is_over)
      : map_(map), side_(block_side), is_over_(is_over) {
    for (std::size_t axis = 0; axis < 2; ++axis) blocks_[axis] = (map.shape()[axis] - 1) / side_ + 1;
    lengths_.assign(blocks_[0] * blocks_[1], std::numeric_limits<double>::infinity());
    is_settled_.assign(lengths_.size(), false);
    lengths_[block_of(goal)] = 0.0;
    queue_.push({0.0, block_of(goal)});
  }

  /// Return the length of the way, metres; infinity if there is none.
  double length(const Configuration& q) {
    const std::int64_t wanted = block_of(q);
    while (!is_settled_[wanted] && !queue_.empty() && !is_over_()) settle();
    return lengths_[wanted];
  }

 private:
  std::int64_t block_of(const Configuration& q) const {
    std::int64_t index[2];
    for (std::size_t axis = 0; axis < 2; ++axis) {
      const double place = std::floor((q[axis] - map_.lower()[axis]) / (map_.spacing() * side_));
      index[axis] = static_cast<std::int64_t>(std::clamp(place, 0.0, static_cast<double>(blocks_[axis] - 1)));
    }
    return index[0] * blocks_[1] + index[1];
  }

  /// Settle the nearest block of the queue, and look at its neighbours.
  void settle() {
    const std::int64_t block = queue_.top().second;
    queue_.pop();
    if (is_settled_[block]) return;
    is_settled_[block] = true;
    const std::int64_t i = block / blocks_[1], j = block % blocks_[1];
    for (std::int64_t x = std::max<std::int64_t>(i - 1, 0); x <= std::min(i + 1, blocks_[0] - 1); ++x)
      for (std::int64_t y = std::max<std::int64_t>(j - 1, 0); y <= std::min(j + 1, blocks_[1] - 1); ++y) {
        const std::int64_t next = x * blocks_[1] + y;
        const double length = lengths_[block] + std::hypot(x - i, y - j) * side_ * map_.spacing();
        if (is_settled_[next] || length >= lengths_[next]) continue;
        is_settled_[next] = !is_open(x, y);  // at infinity, and not asked again
        if (is_settled_[next]) continue;
        lengths_[next] = length;
        queue_.push({length, next});
      }
  }

  /// Return true if some cell of a block is free at some yaw.
  bool is_open(std::int64_t x, std::int64_t y) const {
    const auto turns = static_cast<double>(map_.rotations());
    for (std::int64_t cell = 0; cell < side_ * side_; ++cell)
      for (double turn = 0.5; turn < turns; ++turn) {
        const double q[] = {map_.lower()[0] + (static_cast<double>(x * side_ + cell / side_) + 0.5) * map_.spacing(),
                            map_.lower()[1] + (static_cast<double>(y * side_ + cell % side_) + 0.5) * map_.spacing(),
                            turn / turns * 2.0 * M_PI};
        if (map_.is_free(q)) return true;
      }
    return false;
  }

  const cspace::Map& map_;
  std::int64_t side_;
  IsOver is_over_;
  std::int64_t blocks_[2];
  std::vector<double> lengths_;
  std::vector<bool> is_settled_;
  Queue queue_;
};

/// Finds paths of robots that are not holonomic: poses between which they drive arcs.
class Lattice {
 public:
  Lattice(const Surroundings& surroundings, const IsOver& is_over) : surroundings_(surroundings), is_over_(is_over) {}

  /// Return the poses of a path, both ends included; empty if none is found.
  std::vector<Configuration> find_path(const Configuration& start, const Configuration& goal) const {
    const cspace::Map& map = surroundings_.map();
    Guide guide(map, goal, BLOCK_SIDE, is_over_);
    std::vector<Configuration> path;
    // From coarse to fine.
    for (int level = 2; level >= 0 && path.empty() && !is_over_(); --level)
      path = search(start, goal, guide, map.spacing() * (1 << level), FINEST_YAWS >> level);
    for (int round = 0; round < SHORTENING_ROUNDS; ++round) shorten(path);
    return path;
  }

 private:
  static constexpr int BLOCK_SIDE = 4;
  static constexpr int FINEST_YAWS = 96;
  static constexpr int SHORTENING_ROUNDS = 3;

  /// A pose that a search has reached, and the arc that leads to it from its parent.
  struct Node {
    Configuration q;
    std::int64_t parent;
    Arc arc;
    double cost;
  };

  /// Search with one pose for each cell of a lattice, with a side in metres, and each of a number of yaws.
  std::vector<Configuration> search(const Configuration& start, const Configuration& goal, Guide& guide, double side,
                                    int yaws) const {
    const Drive& drive = surroundings_.drive();
    const std::vector<Arc> moves = drive.moves(std::sqrt(2.0) * side, 2.0 * M_PI / yaws);
    std::vector<Node> nodes = {{start, -1, {}, 0.0}};
    std::unordered_map<std::int64_t, std::int64_t> node_of;  // by cell and yaw
    Queue queue;
    queue.push({0.0, 0});
    for (double wait = 0.0; !queue.empty() && !is_over_(); --wait) {
      const std::int64_t number = queue.top().second;
      queue.pop();
      const Node node = nodes[number];
      const std::int64_t key = key_of(node.q, side, yaws);
      const auto known = node_of.find(key);
      if (known != node_of.end() && known->second != number) continue;  // a cheaper node is there
      if (wait <= 0.0) {
        const std::vector<Configuration> end = surroundings_.connect(node.q, goal);
        if (surroundings_.poses_are_free(end)) return trace(nodes, number, end);
        wait = guide.length(node.q) / (4.0 * side);
      }
      for (const Arc& move : moves) {
        const Configuration next = advance(node.q, move);
        const double cost = node.cost + cost_of(move), rest = guide.length(next);
        const std::int64_t next_key = key_of(next, side, yaws);
        const auto found = node_of.find(next_key);
        if (next_key == key || std::isinf(rest) || (found != node_of.end() && nodes[found->second].cost <= cost)) continue;
        if (!surroundings_.poses_are_free(surroundings_.poses_along(node.q, {move}))) continue;
        node_of[next_key] = static_cast<std::int64_t>(nodes.size());
        const double bound = std::max(rest, Drive::total_cost(drive.curve(next, goal)));
        queue.push({cost + bound, static_cast<std::int64_t>(nodes.size())});
        nodes.push_back({next, number, move, cost});
      }
    }
    return {};
  }

  std::int64_t key_of(const Configuration& q, double side, int yaws) const {
    const cspace::Map& map = surroundings_.map();
    const auto column = static_cast<std::int64_t>((q[0] - map.lower()[0]) / side);
    const auto row = static_cast<std::int64_t>((q[1] - map.lower()[1]) / side);
    const auto yaw = static_cast<std::int64_t>(std::floor(std::remainder(q[2], 2.0 * M_PI) / (2.0 * M_PI) * yaws + 0.5));
    return ((column << 31) + row) * (2 * yaws) + (yaw + yaws) % yaws;
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

  static double length(const std::vector<Configuration>& poses, std::size_t first, std::size_t last) {
    double sum = 0.0;
    for (std::size_t k = first; k < last; ++k) sum += cost_of(arc_between(poses[k], poses[k + 1]));
    return sum;
  }

  /// Replace parts of a path by shorter curves, long parts first.
  void shorten(std::vector<Configuration>& path) const {
    for (std::size_t reach = path.size(); reach >= 4; reach = reach * 2 / 3)
      for (std::size_t first = 0; first + 2 < path.size() && !is_over_(); first += std::max<std::size_t>(1, reach / 4)) {
        const std::size_t last = std::min(first + reach, path.size() - 1);
        const std::vector<Configuration> poses = surroundings_.connect(path[first], path[last]);
        const bool is_shorter = length(poses, 0, poses.size() - 1) < length(path, first, last) - MIN_GAIN;
        if (!is_shorter || !surroundings_.poses_are_free(poses)) continue;
        path.erase(path.begin() + first + 1, path.begin() + last + 1);
        path.insert(path.begin() + first + 1, poses.begin() + 1, poses.end());
      }
  }

  static constexpr double MIN_GAIN = 1e-3;  ///< metres

  const Surroundings& surroundings_;
  IsOver is_over_;
};

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_LATTICE_HPP
