// Stub of nav2_costmap_2d/footprint_collision_checker.hpp: corners are rounded to cells, and joined by Bresenham's lines.
#ifndef NAV2_FOOTPRINT_COLLISION_CHECKER_STUB_HPP
#define NAV2_FOOTPRINT_COLLISION_CHECKER_STUB_HPP

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include <nav2_costmap_2d/cost_values.hpp>
#include <nav2_costmap_2d/costmap_2d.hpp>
#include <nav2_costmap_2d/footprint.hpp>

namespace nav2_costmap_2d {
template <typename CostmapT>
class FootprintCollisionChecker {
 public:
  explicit FootprintCollisionChecker(CostmapT costmap) : costmap_(costmap) {}

  double footprintCostAtPose(double x, double y, double theta, const Footprint& footprint) {
    std::vector<int> columns, rows;
    for (const auto& corner : footprint) {
      unsigned int column, row;
      const double corner_x = x + (corner.x * std::cos(theta) - corner.y * std::sin(theta));
      const double corner_y = y + (corner.x * std::sin(theta) + corner.y * std::cos(theta));
      if (!costmap_->worldToMap(corner_x, corner_y, column, row)) return LETHAL_OBSTACLE;
      columns.push_back(static_cast<int>(column));
      rows.push_back(static_cast<int>(row));
    }
    double highest = 0.0;
    for (std::size_t k = 0; k < columns.size(); ++k) {
      // Nav2 closes the outline from its first corner to its last one.
      const std::size_t from = k + 1 < columns.size() ? k : 0, to = k + 1 < columns.size() ? k + 1 : k;
      highest = std::max(highest, line_cost(columns[from], rows[from], columns[to], rows[to]));
    }
    return highest;
  }

 private:
  double line_cost(int column, int row, int last_column, int last_row) const {
    const int wide = std::abs(last_column - column), high = std::abs(last_row - row), count = std::max(wide, high);
    const int right = last_column >= column ? 1 : -1, up = last_row >= row ? 1 : -1;
    double highest = 0.0;
    for (int k = 0, rest = count / 2; k <= count; ++k) {
      highest = std::max<double>(highest, costmap_->getCost(column, row));
      rest += std::min(wide, high);
      const bool is_step = rest >= count;
      if (is_step) rest -= count;
      if (wide >= high || is_step) column += right;
      if (wide < high || is_step) row += up;
    }
    return highest;
  }

  CostmapT costmap_;
};
}  // namespace nav2_costmap_2d

#endif
