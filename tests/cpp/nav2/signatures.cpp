// The declarations of ROS 2 and Nav2 that the package for Nav2 relies on. It compiles over the stubs, and over installed
// headers, if both declare them alike.
#include <mutex>
#include <type_traits>

#include <nav2_core/planner_exceptions.hpp>
#include <rcl_interfaces/msg/parameter_descriptor.hpp>

#include "cspace_nav2/planner.hpp"

using cspace_nav2::Buffer;
using cspace_nav2::Node;
using geometry_msgs::msg::Point;
using geometry_msgs::msg::Pose;
using geometry_msgs::msg::PoseStamped;
using nav2_core::GlobalPlanner;
using nav2_costmap_2d::Costmap2D;
using nav2_costmap_2d::Costmap2DROS;
using nav_msgs::msg::Path;

#define HAS_TYPE(expression, ...) static_assert(std::is_same_v<decltype(expression), __VA_ARGS__>, #expression)
#define BECOMES(expression, ...) static_assert(std::is_convertible_v<decltype(expression), __VA_ARGS__>, #expression)

// ---- the costmap ----

HAS_TYPE(&Costmap2D::getSizeInCellsX, unsigned int (Costmap2D::*)() const);
HAS_TYPE(&Costmap2D::getSizeInCellsY, unsigned int (Costmap2D::*)() const);
HAS_TYPE(&Costmap2D::getResolution, double (Costmap2D::*)() const);
HAS_TYPE(&Costmap2D::getOriginX, double (Costmap2D::*)() const);
HAS_TYPE(&Costmap2D::getOriginY, double (Costmap2D::*)() const);
HAS_TYPE(&Costmap2D::getMutex, Costmap2D::mutex_t* (Costmap2D::*)());
static_assert(std::is_copy_constructible_v<Costmap2D>);
HAS_TYPE(&Costmap2D::worldToMap, bool (Costmap2D::*)(double, double, unsigned int&, unsigned int&) const);
HAS_TYPE(std::declval<const Costmap2D&>().getCost(0u, 0u), unsigned char);
HAS_TYPE(std::declval<Costmap2D&>().getCharMap(), unsigned char*);
HAS_TYPE(&Costmap2D::setCost, void (Costmap2D::*)(unsigned int, unsigned int, unsigned char));
static_assert(std::is_same_v<Costmap2D::mutex_t, std::recursive_mutex>);
static_assert(nav2_costmap_2d::NO_INFORMATION == 255 && nav2_costmap_2d::LETHAL_OBSTACLE == 254);
static_assert(nav2_costmap_2d::INSCRIBED_INFLATED_OBSTACLE == 253 && nav2_costmap_2d::MAX_NON_OBSTACLE == 252);
static_assert(nav2_costmap_2d::FREE_SPACE == 0);
HAS_TYPE(&Costmap2DROS::getCostmap, Costmap2D* (Costmap2DROS::*)());
HAS_TYPE(&Costmap2DROS::getGlobalFrameID, std::string (Costmap2DROS::*)());
HAS_TYPE(&Costmap2DROS::getRobotFootprint, std::vector<Point> (Costmap2DROS::*)());
HAS_TYPE(&Costmap2DROS::getUnpaddedRobotFootprint, std::vector<Point> (Costmap2DROS::*)());
HAS_TYPE(&Costmap2DROS::getUseRadius, bool (Costmap2DROS::*)());
HAS_TYPE(&nav2_costmap_2d::makeFootprintFromRadius, std::vector<Point> (*)(double));
static_assert(std::is_same_v<nav2_costmap_2d::Footprint, std::vector<Point>>);
using Checker = nav2_costmap_2d::FootprintCollisionChecker<Costmap2D*>;
HAS_TYPE(&Checker::footprintCostAtPose,
         double (Checker::*)(double, double, double, const nav2_costmap_2d::Footprint&));
static_assert(std::is_constructible_v<Checker, Costmap2D*>);

// ---- the planner ----

HAS_TYPE(&GlobalPlanner::configure,
         void (GlobalPlanner::*)(const Node::WeakPtr&, std::string, std::shared_ptr<Buffer>, std::shared_ptr<Costmap2DROS>));
HAS_TYPE(&GlobalPlanner::cleanup, void (GlobalPlanner::*)());
HAS_TYPE(&GlobalPlanner::activate, void (GlobalPlanner::*)());
HAS_TYPE(&GlobalPlanner::deactivate, void (GlobalPlanner::*)());
#ifdef CSPACE_NAV2_HAS_VIAPOINTS
HAS_TYPE(&GlobalPlanner::createPlan, Path (GlobalPlanner::*)(const PoseStamped&, const PoseStamped&,
                                                            const std::vector<PoseStamped>&, std::function<bool()>));
#else
HAS_TYPE(&GlobalPlanner::createPlan,
         Path (GlobalPlanner::*)(const PoseStamped&, const PoseStamped&, std::function<bool()>));
#endif
static_assert(!std::is_abstract_v<cspace_nav2::CspacePlanner> && std::has_virtual_destructor_v<GlobalPlanner>);

template <typename... Errors>
constexpr bool are_planner_exceptions() {
  return (... && (std::is_base_of_v<nav2_core::PlannerException, Errors> && std::is_constructible_v<Errors, std::string>));
}
static_assert(std::is_base_of_v<std::runtime_error, nav2_core::PlannerException>);
static_assert(are_planner_exceptions<nav2_core::PlannerTFError, nav2_core::StartOutsideMapBounds, nav2_core::StartOccupied,
                                     nav2_core::GoalOutsideMapBounds, nav2_core::GoalOccupied, nav2_core::PlannerTimedOut,
                                     nav2_core::NoValidPathCouldBeFound, nav2_core::PlannerCancelled>());

// ---- messages ----

HAS_TYPE(std::declval<Point>().x, double);
HAS_TYPE(std::declval<Pose>().position, Point);
HAS_TYPE(std::declval<Pose>().orientation.w, double);
HAS_TYPE(std::declval<PoseStamped>().header.frame_id, std::string);
HAS_TYPE(std::declval<PoseStamped>().header.stamp.sec, std::int32_t);
HAS_TYPE(std::declval<PoseStamped>().pose, Pose);
HAS_TYPE(std::declval<Path>().header.frame_id, std::string);
HAS_TYPE(std::declval<Path>().poses, std::vector<PoseStamped>);
using nav_msgs::msg::OccupancyGrid;
HAS_TYPE(std::declval<OccupancyGrid>().header.frame_id, std::string);
HAS_TYPE(std::declval<OccupancyGrid>().info.resolution, float);
HAS_TYPE(std::declval<OccupancyGrid>().info.width, std::uint32_t);
HAS_TYPE(std::declval<OccupancyGrid>().info.height, std::uint32_t);
HAS_TYPE(std::declval<OccupancyGrid>().info.origin, Pose);
HAS_TYPE(std::declval<OccupancyGrid>().data, std::vector<std::int8_t>);

// ---- nodes ----

HAS_TYPE(std::declval<const rclcpp::Node&>().get_name(), const char*);
HAS_TYPE(std::declval<const rclcpp::Node&>().get_namespace(), const char*);
HAS_TYPE(std::declval<const rclcpp::Node&>().get_publishers_info_by_topic(""), std::vector<rclcpp::TopicEndpointInfo>);
HAS_TYPE(std::declval<const rclcpp::TopicEndpointInfo&>().node_name(), const std::string&);
HAS_TYPE(std::declval<const rclcpp::TopicEndpointInfo&>().node_namespace(), const std::string&);
using rcl_interfaces::msg::ParameterDescriptor;
using rcl_interfaces::msg::SetParametersResult;
HAS_TYPE(std::declval<SetParametersResult>().successful, bool);
HAS_TYPE(std::declval<SetParametersResult>().reason, std::string);
HAS_TYPE(std::declval<const rclcpp::Parameter&>().get_name(), const std::string&);
using Check = std::function<SetParametersResult(const std::vector<rclcpp::Parameter>&)>;
BECOMES(std::declval<Node&>().add_on_set_parameters_callback(Check()), std::shared_ptr<void>);
BECOMES(std::declval<Node&>().get_node_topics_interface()->resolve_topic_name(""), std::string);
HAS_TYPE(std::declval<ParameterDescriptor>().description, std::string);
BECOMES(std::declval<ParameterDescriptor>().floating_point_range[0].from_value, double);
BECOMES(std::declval<ParameterDescriptor>().floating_point_range[0].to_value, double);
BECOMES(std::declval<ParameterDescriptor>().integer_range[0].from_value, std::int64_t);
BECOMES(std::declval<ParameterDescriptor>().integer_range[0].to_value, std::int64_t);
BECOMES(std::declval<ParameterDescriptor>().integer_range[0].step, std::uint64_t);
using Callback = std::function<void(std::shared_ptr<const OccupancyGrid>)>;
BECOMES(rclcpp::create_subscription<OccupancyGrid>(std::declval<Node&>(), std::string(), rclcpp::QoS(1).transient_local(),
                                                   Callback()),
        std::shared_ptr<void>);
BECOMES(std::declval<Node&>().get_clock(), rclcpp::Clock::SharedPtr);
BECOMES(std::declval<rclcpp::Clock&>().now(), builtin_interfaces::msg::Time);
HAS_TYPE(std::declval<const Node&>().has_parameter(std::string()), bool);
BECOMES(std::declval<Node&>().declare_parameter<double>(std::string(), 0.0, ParameterDescriptor()), double);
BECOMES(std::declval<Node&>().declare_parameter<bool>(std::string(), true, ParameterDescriptor()), bool);
BECOMES(std::declval<Node&>().declare_parameter<std::string>(std::string(), "", ParameterDescriptor()), std::string);
BECOMES(std::declval<rclcpp::Node&>().declare_parameter<std::string>(std::string(), ""), std::string);
BECOMES(std::declval<const Node&>().get_parameter(std::string()).get_value<double>(), double);
