// Stub of nav2_costmap_2d/cost_values.hpp.
#ifndef NAV2_COST_VALUES_STUB_HPP
#define NAV2_COST_VALUES_STUB_HPP

namespace nav2_costmap_2d {
static constexpr unsigned char NO_INFORMATION = 255;
static constexpr unsigned char LETHAL_OBSTACLE = 254;
static constexpr unsigned char INSCRIBED_INFLATED_OBSTACLE = 253;
static constexpr unsigned char MAX_NON_OBSTACLE = 252;
static constexpr unsigned char FREE_SPACE = 0;
}  // namespace nav2_costmap_2d

#endif
