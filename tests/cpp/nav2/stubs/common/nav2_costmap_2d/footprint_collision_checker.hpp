// Stub of nav2_costmap_2d/footprint_collision_checker.hpp. A line of cells that meets a lethal one costs 254; otherwise, and
// over the lines of a footprint, the greatest cost counts, so that 255 (unknown) hides 254.
#ifndef NAV2_FOOTPRINT_CHECKER_STUB_HPP
#define NAV2_FOOTPRINT_CHECKER_STUB_HPP

#include <algorithm>
#include <cmath>
#include <vector>

#include <geometry_msgs/msg/pose.hpp>
#include <nav2_costmap_2d/cost_values.hpp>
#include <nav2_costmap_2d/costmap_2d.hpp>

namespace nav2_costmap_2d {

typedef std::vector<geometry_msgs::msg::Point> Footprint;

template <typename CostmapT>
class FootprintCollisionChecker {
 public:
  explicit FootprintCollisionChecker(CostmapT costmap) : costmap_(costmap) {}

  double footprintCostAtPose(double x, double y, double theta, const Footprint& footprint) {
    double greatest = 0.0;
    for (std::size_t k = 0; k < footprint.size(); ++k) {
      const auto &a = footprint[k], &b = footprint[(k + 1) % footprint.size()];
      const double c = std::cos(theta), s = std::sin(theta);
      unsigned int x0, y0, x1, y1;
      if (!costmap_->worldToMap(x + a.x * c - a.y * s, y + a.x * s + a.y * c, x0, y0)) return LETHAL_OBSTACLE;
      if (!costmap_->worldToMap(x + b.x * c - b.y * s, y + b.x * s + b.y * c, x1, y1)) return LETHAL_OBSTACLE;
      greatest = std::max(greatest, lineCost(x0, x1, y0, y1));
      if (greatest == LETHAL_OBSTACLE) return greatest;
    }
    return greatest;
  }

  double lineCost(int x0, int x1, int y0, int y1) const {
    const int count = std::max({1, std::abs(x1 - x0), std::abs(y1 - y0)});
    double greatest = 0.0;
    for (int k = 0; k <= count; ++k) {
      const double cost = costmap_->getCost(x0 + std::lround(k * (x1 - x0) / static_cast<double>(count)),
                                            y0 + std::lround(k * (y1 - y0) / static_cast<double>(count)));
      if (cost == LETHAL_OBSTACLE) return cost;
      greatest = std::max(greatest, cost);
    }
    return greatest;
  }

 private:
  CostmapT costmap_;
};

}  // namespace nav2_costmap_2d

#endif
