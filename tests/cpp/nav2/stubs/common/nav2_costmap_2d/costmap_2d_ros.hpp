// Stub of nav2_costmap_2d/costmap_2d_ros.hpp: a costmap in the frame "map".
#ifndef NAV2_COSTMAP_2D_ROS_STUB_HPP
#define NAV2_COSTMAP_2D_ROS_STUB_HPP

#include <string>
#include <vector>

#include <geometry_msgs/msg/pose.hpp>
#include <nav2_costmap_2d/costmap_2d.hpp>

namespace nav2_costmap_2d {
class Costmap2DROS {
 public:
  Costmap2D* getCostmap() { return &stub_costmap; }
  std::string getGlobalFrameID() { return "map"; }
  std::vector<geometry_msgs::msg::Point> getRobotFootprint() { return stub_footprint; }
  std::vector<geometry_msgs::msg::Point> getUnpaddedRobotFootprint() { return stub_footprint; }
  bool getUseRadius() { return stub_is_round; }

  Costmap2D stub_costmap{60, 40, 0.1, 0.0, 0.0};
  std::vector<geometry_msgs::msg::Point> stub_footprint;
  bool stub_is_round = false;
};
}  // namespace nav2_costmap_2d

#endif
