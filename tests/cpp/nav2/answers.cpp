// Answers of the Nav2 package, as Nav2 would ask for them. Each line of standard input is a command, and each answer is a
// line of JSON:
//
//   set NAME VALUE             a parameter, for the next configure
//   frame NAME                 the frame of the poses that follow
//   seconds N                  the time of the node's clock
//   param NAME VALUE           sets a parameter while the node runs; prints why it is refused, or ""
//   footprint X Y              half the sides of the rectangle that the costmap has as its footprint
//   round                      the costmap's robot is a disc
//   grid FRAME COLUMNS ROWS SIDE X Y FILE  a message of the map's topic, with cells of 0, 1 and 2 for free, occupied, unknown
//   static                     the costmap becomes that grid, with lethal cells where it is occupied
//   costs X0 Y0 X1 Y1 COST     the cost of all cells of a box
//   cancel N                   the cancel checker says true from its call N on
//   configure | cleanup        of the planner
//   plan POSE ... POSE         from the first to the last pose, through the others
//
// A pose is x, y and its quaternion x, y, z, w.
#include <fstream>
#include <future>
#include <iomanip>
#include <iostream>

#include "cspace_nav2/planner.hpp"
#include <nav2_core/planner_exceptions.hpp>

std::shared_ptr<nav2_core::GlobalPlanner> stub_plugin();

namespace {

using Pose = geometry_msgs::msg::PoseStamped;

std::string frame = "map";
std::size_t cancelled_call = 1 << 30;

std::vector<Pose> read_poses(std::istream& line) {
  std::vector<Pose> poses;
  Pose pose;
  pose.header.frame_id = frame;
  auto& [p, r] = pose.pose;
  std::vector<std::string> words;
  for (std::string word; line >> word;) words.push_back(word);
  for (std::size_t k = 0; k + 6 <= words.size(); k += 6) {
    double* numbers[] = {&p.x, &p.y, &r.x, &r.y, &r.z, &r.w};
    for (std::size_t n = 0; n < 6; ++n) *numbers[n] = std::stod(words[k + n]);
    poses.push_back(pose);
  }
  return poses;
}

/// Return the error code of ComputePathToPose that planner_server gives.
int code_of(const std::exception& error) {
  if (dynamic_cast<const nav2_core::PlannerTFError*>(&error)) return 202;
  if (dynamic_cast<const nav2_core::StartOutsideMapBounds*>(&error)) return 203;
  if (dynamic_cast<const nav2_core::GoalOutsideMapBounds*>(&error)) return 204;
  if (dynamic_cast<const nav2_core::StartOccupied*>(&error)) return 205;
  if (dynamic_cast<const nav2_core::GoalOccupied*>(&error)) return 206;
  if (dynamic_cast<const nav2_core::PlannerTimedOut*>(&error)) return 207;
  if (dynamic_cast<const nav2_core::NoValidPathCouldBeFound*>(&error)) return 208;
  if (dynamic_cast<const nav2_core::PlannerCancelled*>(&error)) return -1;
  return dynamic_cast<const nav2_core::PlannerException*>(&error) ? 200 : -2;
}

void write_error(const std::exception& error, std::size_t calls = 0) {
  std::cout << "{\"code\": " << code_of(error) << ", \"text\": " << std::quoted(error.what()) << ", \"calls\": " << calls
            << "}\n";
}

/// Return true if another thread cannot lock a costmap.
bool is_locked(nav2_costmap_2d::Costmap2D& costmap) {
  return std::async(std::launch::async, [&] {
           const std::unique_lock<nav2_costmap_2d::Costmap2D::mutex_t> lock(*costmap.getMutex(), std::try_to_lock);
           return !lock.owns_lock();
         }).get();
}

void plan(nav2_core::GlobalPlanner& planner, const std::vector<Pose>& stops, nav2_costmap_2d::Costmap2D& costmap) {
  std::size_t calls = 0;
  bool was_locked = false;
  const std::function<bool()> cancel_checker = [&] {
    was_locked = was_locked || (calls == 0 && is_locked(costmap));
    return ++calls >= cancelled_call;
  };
  try {
#ifdef CSPACE_NAV2_HAS_VIAPOINTS
    const auto path = planner.createPlan(stops.front(), stops.back(), {stops.begin() + 1, stops.end() - 1}, cancel_checker);
#else
    const auto path = planner.createPlan(stops.front(), stops.back(), cancel_checker);
#endif
    std::cout << "{\"code\": 0, \"locked\": " << was_locked << ", \"calls\": " << calls << ", \"stamps\": [" << path.header.stamp.sec << ", "
              << path.poses.back().header.stamp.sec << "], \"path\": [";
    for (const Pose& pose : path.poses)
      std::cout << (&pose == &path.poses.front() ? "" : ", ") << "[" << pose.pose.position.x << ", "
                << pose.pose.position.y << ", " << cspace_nav2::yaw_of(pose.pose) << "]";
    std::cout << "]}\n";
  } catch (const std::exception& error) {
    write_error(error, calls);
  }
}

using Grid = nav_msgs::msg::OccupancyGrid;

std::shared_ptr<const Grid> send_grid(std::istream& line) {
  const auto grid = std::make_shared<Grid>();
  std::string file;
  auto& info = grid->info;
  line >> grid->header.frame_id >> info.width >> info.height >> info.resolution;
  line >> info.origin.position.x >> info.origin.position.y >> file;
  std::ifstream cells(file);
  for (char cell; cells >> cell;) grid->data.push_back(cell == '1' ? 100 : cell == '2' ? -1 : 0);
  for (const auto& [topic, callback] : rclcpp::StubTopic<Grid>::callbacks())
    if (const auto kept = callback.lock()) (*kept)(grid);
  return grid;
}

void copy_grid(const Grid& grid, nav2_costmap_2d::Costmap2D& costmap) {
  const auto& info = grid.info;
  costmap.resizeMap(info.width, info.height, info.resolution, info.origin.position.x, info.origin.position.y);
  for (std::size_t k = 0; k < grid.data.size(); ++k)
    if (grid.data[k] == 100)
      costmap.setCost(static_cast<unsigned int>(k % info.width), static_cast<unsigned int>(k / info.width),
                      nav2_costmap_2d::LETHAL_OBSTACLE);
}

}  // namespace

int main() {
  std::cout << std::setprecision(17) << std::unitbuf;
  const auto node = std::make_shared<cspace_nav2::Node>("planner_server");
  const auto costmap_ros = std::make_shared<nav2_costmap_2d::Costmap2DROS>();
  nav2_costmap_2d::Costmap2D& costmap = costmap_ros->stub_costmap;
  const auto planner = stub_plugin();
  std::shared_ptr<const Grid> grid;
  for (std::string text; std::getline(std::cin, text);) {
    std::istringstream line(text);
    std::string command, name;
    line >> command;
    if (command == "set") {
      line >> name;
      line >> rclcpp::stub_parameters()[name];
    }
    if (command == "frame") line >> std::quoted(frame);
    if (command == "seconds") {
      line >> rclcpp::stub_nanoseconds();
      rclcpp::stub_nanoseconds() *= 1000000000;
    }
    if (command == "param") {
      std::string value;
      line >> name >> value;
      std::cout << std::quoted(node->stub_set(name, value)) << "\n";
    }
    if (command == "cancel") line >> cancelled_call;
    if (command == "footprint") {
      double x, y;
      line >> x >> y;
      costmap_ros->stub_footprint = {{x, y, 0.0}, {x, -y, 0.0}, {-x, -y, 0.0}, {-x, y, 0.0}};
    }
    if (command == "round") costmap_ros->stub_is_round = true;
    if (command == "grid") grid = send_grid(line);
    if (command == "static") copy_grid(*grid, costmap);
    if (command == "costs") {
      double x0, y0, x1, y1, cost;
      line >> x0 >> y0 >> x1 >> y1 >> cost;
      unsigned int low_x = 0, low_y = 0, high_x = 0, high_y = 0;
      costmap.worldToMap(x0, y0, low_x, low_y);
      costmap.worldToMap(x1, y1, high_x, high_y);
      for (unsigned int mx = low_x; mx <= high_x; ++mx)
        for (unsigned int my = low_y; my <= high_y; ++my) costmap.setCost(mx, my, static_cast<unsigned char>(cost));
    }
    if (command == "configure") {
      try {
        planner->configure(node, "plan", nullptr, costmap_ros);
        std::cout << "{\"code\": 0}\n";
      } catch (const std::exception& error) {
        write_error(error);
      }
    }
    if (command == "cleanup") planner->cleanup();
    if (command == "plan") plan(*planner, read_poses(line), costmap);
  }
}
