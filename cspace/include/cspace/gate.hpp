/// @file gate.hpp
/// A gate for a robot that drives on a saved map among points that it sees, in C++17.
///
///     auto map = std::make_shared<const cspace::Map>(cspace::Map::open("map.zarr"));
///     cspace::Gate gate(map, cspace::read_robot(*map), options);
///     cspace::SlowedCommand slowed = gate.slow_down({1.0, 2.0, 0.5}, {0.8, 0.3}, twist_now, points);
///
/// Without points, it answers as `cspace.Gate.slow_down` of Python, whose statements it repeats: `cspace/_gates/gate.py`,
/// `chunks.py` and `leaving.py`, which have the proofs. Points are tested by their distances from the robot itself.
#ifndef CSPACE_GATE_HPP
#define CSPACE_GATE_HPP

#include <cspace/map.hpp>

#include <limits>

#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__FP_FAST_FMA)
#pragma GCC push_options
#pragma GCC optimize("fp-contract=off")
#endif

namespace cspace {

/// A command of a robot that drives: its speed ahead, m/s, its yaw rate, rad/s, and its speed to the left, m/s.
struct Twist {
  double v, omega;
  double side = 0.0;

  /// Return the speed along its way, m/s.
  double speed() const { return std::hypot(v, side); }

  /// Return a share of it.
  Twist scale(double share) const { return {share * v, share * omega, share * side}; }
};

/// A point of the plane, metres.
struct Point {
  double x, y;
};

/// A convex part of a robot in its own frame: corners of a polygon, counterclockwise, or a single point, grown by a
/// radius, metres. On a floor, it is the part in some layers of the workspace; without a list, in all.
struct Core {
  std::vector<Point> corners;
  double radius = 0.0;
  std::vector<std::int64_t> layers = {};
};

/// What a gate knows of a robot's drive and sensors.
struct GateOptions {
  double dt = 0.05;                                 ///< seconds of a command
  Twist max_deceleration = {1.0, 2.0};              ///< m/s^2 along its way, and rad/s^2; above zero
  std::array<double, 3> tracking = {0.0, 0.0, 0.0}; ///< how far the robot may stray: x, y and yaw, metres and radians
  double point_radius = 0.0;                        ///< of what is around each point, metres
};

/// The fastest part of a twist after which a robot can still stop; see `Gate::slow_down`.
struct SlowedCommand {
  double share;                 ///< of the twist, at most 1; 0 if the robot must brake
  std::vector<Twist> commands;  ///< the twist to drive next, then those that bring the robot to rest
  bool is_proven;               ///< false if not even braking is free, as behind something that has just come
  bool leaves;                  ///< true if the commands come no nearer to what is near, but are not proven free
};

namespace detail {

// The constants of the same names in Python.
constexpr int SHARES = 16;
constexpr double MAX_RAMP = 100000;
constexpr double MAX_ARCS = 64.0 * (1.0 + 1e-9);
constexpr double CELL_REACH = 0.7072;
constexpr double MAX_NEAR_CELLS = 1 << 20;
constexpr double FARTHEST_CELL = 0x1p31;
constexpr double PIECES = 1024;
constexpr double STRAIGHT_ROUNDING = 1e-12;
constexpr double LEVEL_ROUNDING = 1e-12;
constexpr double CORNER_ROUNDING = 1e-9;
constexpr double LOST_DEPTH = 0.5;
constexpr double FOREVER = std::numeric_limits<double>::infinity();

/// A distance, negative inside; the unit direction along which it rises fastest; the nearest side, or -1 at a corner.
struct Gap {
  double distance;
  Point direction;
  int side;
};

/// A convex part of a robot with the unit normals of its sides; a point has none.
struct Body {
  std::vector<Point> corners, normals;
  double radius;
  std::vector<std::int64_t> layers;
  double depth;  ///< of the mean of the corners below the surface, metres

  explicit Body(const Core& core) : corners(core.corners), radius(core.radius), layers(core.layers) {
    for (std::size_t k = 0; k < corners.size() && corners.size() > 1; ++k) {
      const Point edge = find_edge(k);
      const double length = std::sqrt(edge.x * edge.x + edge.y * edge.y);
      normals.push_back({edge.y / length, -edge.x / length});
    }
    Point mean{0.0, 0.0};
    for (const Point& corner : corners) {
      mean.x += corner.x / static_cast<double>(corners.size());
      mean.y += corner.y / static_cast<double>(corners.size());
    }
    depth = radius + (normals.empty() ? 0.0 : FOREVER);
    for (std::size_t k = 0; k < normals.size(); ++k) depth = std::min(depth, radius - measure_height(k, mean));
  }

  Point find_edge(std::size_t k) const {
    const Point &corner = corners[k], &next = corners[k + 1 < corners.size() ? k + 1 : 0];
    return {next.x - corner.x, next.y - corner.y};
  }

  /// Return the distance of a point from the line of a side, negative inside.
  double measure_height(std::size_t side, const Point& point) const {
    return (point.x - corners[side].x) * normals[side].x + (point.y - corners[side].y) * normals[side].y;
  }

  Gap measure_gap(const Point& point) const {
    Gap nearest{FOREVER, {0.0, 0.0}, -1};
    std::size_t highest = 0;
    for (std::size_t k = 0; k < corners.size(); ++k) {
      const Point edge = find_edge(k), offset{point.x - corners[k].x, point.y - corners[k].y};
      const double square = edge.x * edge.x + edge.y * edge.y;
      const double along = square > 0.0 ? (offset.x * edge.x + offset.y * edge.y) / square : 0.0;
      const double share = std::min(std::max(along, 0.0), 1.0);
      const Point way{offset.x - share * edge.x, offset.y - share * edge.y};
      const double length = std::hypot(way.x, way.y);
      if (!normals.empty() && measure_height(k, point) > measure_height(highest, point)) highest = k;
      if (!(length < nearest.distance)) continue;
      const Point direction = length > 0.0 ? Point{way.x / length, way.y / length} : Point{0.0, 0.0};
      nearest = {length, direction, share > 0.0 && share < 1.0 ? static_cast<int>(k) : -1};
    }
    if (normals.empty()) return nearest;
    if (measure_height(highest, point) <= CORNER_ROUNDING) nearest.side = static_cast<int>(highest);
    if (nearest.side < 0) return nearest;
    // The normal of a side has no rounding of a short distance.
    return {measure_height(nearest.side, point), normals[nearest.side], nearest.side};
  }

  /// Return the smallest distance of points beside each side, at most `needed`.
  std::vector<double> find_levels(const std::vector<Point>& points, double needed) const {
    std::vector<double> levels(normals.size(), needed);
    for (const Point& point : points) {
      const Gap gap = measure_gap(point);
      if (gap.side >= 0) levels[gap.side] = std::min(levels[gap.side], gap.distance);
    }
    return levels;
  }
};

/// Return a vector that is turned by an angle.
inline Point turn(const Point& vector, double angle) {
  const double cosine = std::cos(angle), sine = std::sin(angle);
  return {vector.x * cosine - vector.y * sine, vector.x * sine + vector.y * cosine};
}

/// Return the velocity of a point as a robot sees it.
inline Point find_flow(const Twist& twist, const Point& point) {
  return {twist.omega * point.y - twist.v, -twist.omega * point.x - twist.side};
}

/// Return a point as a robot sees it that has driven for some seconds.
inline Point see_from(const Twist& twist, double seconds, const Point& point) {
  const double half = 0.5 * twist.omega * seconds;
  const double ratio = half == 0.0 ? 1.0 : std::sin(half) / half;
  const Point way = turn({twist.v * seconds * ratio, twist.side * seconds * ratio}, half);
  const double x = point.x - way.x, y = point.y - way.y;
  const double cosine = std::cos(twist.omega * seconds), sine = std::sin(twist.omega * seconds);
  return {cosine * x + sine * y, cosine * y - sine * x};
}

/// Return for how long, at most `seconds`, no point comes nearer to a body than it may.
///
/// Points stay beyond `needed`, and those that are nearer come no nearer if the body leaves. A piece shorter than
/// `least` seconds ends the proof.
inline double follow(const Body& body, const std::vector<Point>& points, double needed, const Twist& twist,
                     double seconds, double least, bool leaves) {
  const double rounding = twist.omega == 0.0 ? STRAIGHT_ROUNDING : 0.0;
  std::vector<double> levels;
  if (leaves && twist.omega == 0.0) levels = body.find_levels(points, needed);
  for (const Point& point : points) {
    for (double time = 0.0; time < seconds;) {
      const Point place = see_from(twist, time, point);
      const Gap gap = body.measure_gap(place);
      const Point flow = find_flow(twist, place);
      const double speed = std::hypot(flow.x, flow.y);
      // Normals turn with the point around a single corner, which moves slower than the point.
      const Point moving = body.normals.empty() ? find_flow(twist, body.corners[0]) : flow;
      double above = gap.distance - needed;
      double rate = gap.direction.x * moving.x + gap.direction.y * moving.y;
      for (std::size_t k = 0; k < levels.size(); ++k) {
        // Behind the level of a side, the distance is that from the side.
        const double over = body.measure_height(k, place) - levels[k];
        above = std::max(above, over);
        if (over >= -LEVEL_ROUNDING)
          rate = std::max(rate, flow.x * body.normals[k].x + flow.y * body.normals[k].y);
      }
      double step = above > 0.0 ? above / speed : 0.0;
      rate += rounding * speed;
      const double bend = std::abs(twist.omega) * std::hypot(moving.x, moving.y);
      if (leaves && rate >= 0.0) step = std::max(step, bend > 0.0 ? rate / bend : FOREVER);
      if (speed == 0.0 && (leaves || above >= 0.0)) step = FOREVER;
      if (!(step >= least && step > 0.0)) {
        seconds = time;
        break;
      }
      time += step;
    }
  }
  return seconds;
}

/// Return the text of a list that follows a name in JSON, without brackets.
inline std::string find_list(const std::string& text, const std::string& name) {
  const std::size_t found = text.find('"' + name + "\": [");
  if (found == std::string::npos) throw InputError("cspace: the map's robot has no " + name);
  std::string list;
  int depth = 0;
  for (std::size_t k = text.find('[', found); k < text.size(); ++k) {
    depth += text[k] == '[' ? 1 : text[k] == ']' ? -1 : 0;
    if (depth == 0) break;
    list += text[k] == '[' || text[k] == ']' || text[k] == ',' ? ' ' : text[k];
  }
  return list;
}

inline std::vector<double> read_numbers(const std::string& text) {
  std::istringstream items(text);
  items.imbue(std::locale::classic());
  std::vector<double> list;
  for (double number; items >> number;) list.push_back(number);
  return list;
}

/// Return the bytes of a text in base64.
inline std::string decode(const std::string& text) {
  static const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string bytes;
  std::uint32_t bits = 0;
  int count = 0;
  for (const char letter : text) {
    const std::size_t digit = digits.find(letter);
    if (digit == std::string::npos) continue;  // a quote, or "=" at the end
    bits = (bits << 6) | static_cast<std::uint32_t>(digit);
    count += 6;
    if (count < 8) continue;
    count -= 8;
    bytes += static_cast<char>((bits >> count) & 255);
  }
  return bytes;
}

/// Order the corners of a polygon counterclockwise.
inline void turn_left(std::vector<Point>& corners) {
  double area = 0.0;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const Point &a = corners[k], &b = corners[(k + 1) % corners.size()];
    area += a.x * b.y - b.x * a.y;
  }
  if (area < 0.0) std::reverse(corners.begin(), corners.end());
}

/// Return the corners, counterclockwise, of a polygon in well-known binary: little-endian, of two axes, without holes.
inline std::vector<Point> read_polygon(const std::string& bytes) {
  constexpr std::size_t HEADER = 13;
  std::uint32_t type = 0, rings = 0, count = 0;
  if (bytes.size() >= HEADER) {
    std::memcpy(&type, &bytes[1], 4);
    std::memcpy(&rings, &bytes[5], 4);
    std::memcpy(&count, &bytes[9], 4);
  }
  if (type != 3 || rings != 1 || count < 4 || bytes.size() != HEADER + count * sizeof(Point))
    throw InputError("cspace: the map's robot has a part that is no polygon, or has holes");
  std::vector<Point> corners(count);
  std::memcpy(corners.data(), &bytes[HEADER], count * sizeof(Point));
  corners.pop_back();  // the first one again
  turn_left(corners);
  return corners;
}

/// Return the parts of a robot on a floor: of each a number of layers, the layers, its radius, and x and y of its corners.
inline std::vector<Core> read_floor_parts(const std::string& text) {
  std::vector<Core> robot;
  std::istringstream lists(text);
  for (std::string list; std::getline(lists, list, ']');) {
    std::replace_if(list.begin(), list.end(), [](char letter) { return letter == '[' || letter == ','; }, ' ');
    const std::vector<double> numbers = read_numbers(list);
    if (numbers.empty()) continue;  // at the end
    const auto first = numbers.begin() + 1;
    const auto left = static_cast<double>(numbers.end() - first);
    if (!(numbers[0] >= 1.0 && numbers[0] < left)) throw InputError("cspace: the map's floor_parts are none");
    const auto radius = first + static_cast<std::ptrdiff_t>(numbers[0]);
    robot.push_back({{}, *radius, {first, radius}});
    for (auto corner = radius + 1; numbers.end() - corner > 1; corner += 2) robot.back().corners.push_back({corner[0], corner[1]});
  }
  if (robot.empty()) throw InputError("cspace: the map's robot has no convex parts at the heights of its layers");
  return robot;
}
}  // namespace detail

/// Return the parts of the robot that a map of the plane was built for: discs, or polygons without holes; on a floor, those
/// at the heights of its layers.
/// @throws InputError  if it has others
inline std::vector<Core> read_robot(const Map& map) {
  if (map.has_floor()) return detail::read_floor_parts(map.floor_parts());
  // A shape that is only bounded lies in the outer one of its bounds.
  const std::size_t outer = map.robot().rfind("\"outer\": {");
  const std::string text = outer == std::string::npos ? map.robot() : map.robot().substr(outer);
  std::vector<Core> robot;
  if (map.dim() == 2 && text.find("\"kind\": \"balls\"") != std::string::npos) {
    const std::vector<double> centers = detail::read_numbers(detail::find_list(text, "centers"));
    const std::vector<double> radii = detail::read_numbers(detail::find_list(text, "radii"));
    if (radii.empty() || centers.size() != 2 * radii.size()) throw InputError("cspace: the map's robot has no discs");
    for (std::size_t k = 0; k < radii.size(); ++k) robot.push_back({{{centers[2 * k], centers[2 * k + 1]}}, radii[k]});
  } else if (map.dim() == 2 && text.find("\"kind\": \"polygon\"") != std::string::npos) {
    std::istringstream words(detail::find_list(text, "wkb"));
    for (std::string word; words >> word;) robot.push_back({detail::read_polygon(detail::decode(word))});
  } else {
    throw InputError("cspace: the map's robot is not made of discs or polygons");
  }
  return robot;
}

/// A gate between a controller and a robot on a map of x, y and yaw: what it lets through is proven, with a stop.
///
/// Any number of threads may use it at once.
class Gate {
 public:
  /// Keep the map, and the convex parts of the robot that it was built for, as `read_robot` has them.
  /// @throws InputError  if the map has other axes, a part is none, or an option is out of range
  Gate(std::shared_ptr<const Map> map, const std::vector<Core>& robot, const GateOptions& options)
      : map_(std::move(map)), options_(options) {
    const GateOptions& o = options_;
    const double sum = o.tracking[0] + o.tracking[1] + o.tracking[2] + o.point_radius;
    const double least = std::min({o.tracking[0], o.tracking[1], o.tracking[2], o.point_radius});
    if (!map_ || map_->dim() != 2 || map_->size() != 3)
      throw InputError("cspace: a gate needs a map of x, y and yaw");
    most_ = {o.dt * o.max_deceleration.v, o.dt * o.max_deceleration.omega};
    if (!(o.dt > 0.0 && most_.v > 0.0 && most_.omega > 0.0 && std::isfinite(o.dt + most_.v + most_.omega)))
      throw InputError("cspace: dt and max_deceleration must be finite and above zero");
    if (!(least >= 0.0) || !(sum <= std::numeric_limits<double>::max()))
      throw InputError("cspace: tracking and point_radius must be finite, and zero or above");
    if (robot.empty()) throw InputError("cspace: a robot has at least one part");
    for (const Core& core : robot) {
      check_core(core);
      robot_.emplace_back(core);
      lost_depth_ = std::max(lost_depth_, detail::LOST_DEPTH * robot_.back().depth);
      for (const Point& corner : core.corners) size_ = std::max(size_, std::hypot(corner.x, corner.y) + core.radius);
    }
    // A point of the robot moves by at most its distance from the origin for each radian.
    margin_ = map_->margin() + std::hypot(o.tracking[0], o.tracking[1]) + size_ * std::min(o.tracking[2], 2.0);
  }

  /// Check a part of a robot.
  /// @throws InputError  if it is neither a point nor a convex polygon, counterclockwise, grown by a radius
  static void check_core(const Core& core) {
    const std::size_t count = core.corners.size();
    bool is_valid = (count == 1 || count > 2) && std::isfinite(core.radius) && core.radius >= 0.0;
    double turned = 0.0;
    for (std::size_t k = 0; k < count; ++k) {
      const Point &a = core.corners[k], &b = core.corners[(k + 1) % count], &c = core.corners[(k + 2) % count];
      is_valid = is_valid && std::isfinite(a.x + a.y);
      if (count < 3) continue;
      const Point ab{b.x - a.x, b.y - a.y}, bc{c.x - b.x, c.y - b.y};
      const double cross = ab.x * bc.y - ab.y * bc.x, dot = ab.x * bc.x + ab.y * bc.y;
      is_valid = is_valid && std::hypot(ab.x, ab.y) > 0.0 && cross >= -1e-9 * std::hypot(ab.x, ab.y) * std::hypot(bc.x, bc.y);
      turned += std::atan2(cross, dot);
    }
    // Corners of a star turn twice.
    if (!is_valid || (count > 2 && !(std::abs(turned - detail::TWO_PI) < 1e-6)))
      throw InputError("cspace: a part has one corner, or those of a convex polygon, counterclockwise, once each");
  }

  /// Return the largest distance from the robot, metres, below which a point is near.
  double margin() const { return margin_ + options_.point_radius; }

  /// Return the distance of the robot's farthest point from its origin, metres.
  double size() const { return size_; }

  /// Return true if a taken cell is deeper inside the robot than half of its depth: it is not where it believes.
  bool is_lost(const double* q) const {
    return can_list(q, size_) && has_within(list_taken(q, size_), -lost_depth_);
  }

  /// Return true if one of some cells, given by their centers, is within reach of a robot that drives a twist and stops.
  bool reaches(const double* q, const Twist& twist, const std::vector<Point>& centers) const {
    double reach = size_ + margin_ + detail::CELL_REACH * map_->spacing();
    for (const Twist& command : brake(twist)) reach += command.speed() * options_.dt;
    const auto is_within = [&](const Point& center) { return !(std::hypot(center.x - q[0], center.y - q[1]) > reach); };
    return std::any_of(centers.begin(), centers.end(), is_within);
  }

  /// Return true if a point or taken cell is nearer than the margin.
  bool is_near(const double* q, const std::vector<Point>& points) const {
    std::vector<Point> seen;
    for (const Point& point : points) seen.push_back(see(q, point));
    const double reach = margin_ + detail::CELL_REACH * map_->spacing();
    return has_within({robot_.size(), seen}, margin()) || !can_list(q, size_ + reach) ||
           has_within(list_taken(q, size_ + reach), reach);
  }

  /// Return the fastest share of a twist after which the robot can still stop.
  ///
  /// The twist is driven for `dt`, then the robot brakes along the same arc. If no share is proven, it brakes at once.
  /// With `leaving`, it may also drive if no point or taken cell comes nearer than the margin or than it is, and,
  /// straight on, than what is nearest beside the same side of the robot: the smallest proven distance never falls.
  /// It does not leave if it is lost: if a taken cell is deeper inside than half of its own depth.
  /// @param q            where the robot is: x, y and yaw
  /// @param twist_now    what it drives now: the first command of the call before
  /// @param points       what it sees, in the frame of the map
  /// @throws InputError  if a number is not finite, or a twist needs more than 100000 commands to come to rest; with
  ///                     `leaving`, if the map is in tiles
  SlowedCommand slow_down(const double* q, Twist twist, Twist twist_now, const std::vector<Point>& points = {},
                          bool leaving = false) const {
    if (!map_->is_usable(q) || !std::isfinite(twist.speed() + twist.omega + twist_now.speed() + twist_now.omega))
      throw InputError("cspace: configurations and twists must be finite, and a yaw at most 2^20");
    for (const Point& point : points)
      if (!std::isfinite(point.x + point.y)) throw InputError("cspace: points must be finite");
    if (leaving && !map_->has_taken_cells()) throw InputError("cspace: leaving needs a map in memory, not in tiles");
    std::vector<Ramp> ramps;
    for (int part = detail::SHARES; part > 0; --part) {
      const double share = static_cast<double>(part) / detail::SHARES;
      const Twist first = twist.scale(share);
      // A share may not be slower than what the brakes can reach.
      const double slowed = std::hypot(find_loss(twist_now.v, first.v), find_loss(twist_now.side, first.side));
      if (slowed > most_.v || find_loss(twist_now.omega, first.omega) > most_.omega) continue;
      ramps.push_back({share, brake(first), 0.0});
      const std::size_t count = ramps.back().commands.size();
      // A ramp drives as far as its first twist in half the time, and half a command more.
      if (count > 0) ramps.back().seconds = 0.5 * options_.dt * share * static_cast<double>(count + 1);
    }
    Ramp rest{0.0, brake(twist_now), 0.0};
    if (!rest.commands.empty()) {
      rest.seconds = 0.5 * options_.dt * static_cast<double>(rest.commands.size() - 1);
      rest.commands.erase(rest.commands.begin());
    }
    std::size_t rows = std::max<std::size_t>(rest.commands.size(), 1);
    for (const Ramp& ramp : ramps) rows = std::max(rows, ramp.commands.size());
    double seconds = 0.0, pieces = 1.0, bend = 0.0;
    for (const Ramp& ramp : ramps) {
      seconds = std::max(seconds, ramp.seconds);
      cut(ramp.commands, pieces, bend);
    }
    cut(rest.commands, pieces, bend);
    const Reach reach = find_reach(q, twist, seconds, points, leaving);
    for (const Ramp& ramp : ramps) {
      const bool is_free = ramp_is_free(q, ramp.commands);
      const bool is_free_twice = is_free && arcs_are_free(q, ramp.commands, rows, pieces, bend);
      const bool is_proven = is_free && ramp.seconds <= reach.free;
      const bool leaves = leaving && ramp.seconds <= reach.points && (is_free_twice || ramp.seconds <= reach.cells);
      if ((is_free_twice && is_proven) || leaves) return {ramp.share, at_rest(ramp.commands), is_proven, !is_proven};
    }
    const Reach at_once = find_reach(q, twist_now, rest.seconds, points, leaving);
    const bool is_free = ramp_is_free(q, rest.commands);
    const bool is_proven = is_free && rest.seconds <= at_once.free;
    const bool leaves = leaving && rest.seconds <= at_once.points && (is_free || rest.seconds <= at_once.cells);
    return {0.0, at_rest(rest.commands), is_proven, leaves && !is_proven};
  }
  SlowedCommand slow_down(const std::vector<double>& q, Twist twist, Twist twist_now,
                          const std::vector<Point>& points = {}, bool leaving = false) const {
    if (q.size() != 3) throw InputError("cspace: a configuration has 3 numbers");
    return slow_down(q.data(), twist, twist_now, points, leaving);
  }

 private:
  /// A share of a twist, its commands until the robot rests, and the seconds in which the twist drives as far.
  struct Ramp {
    double share;
    std::vector<Twist> commands;
    double seconds;
  };

  /// For how long a twist is proven, seconds: points stay beyond the margin; points, or cells, come no nearer.
  struct Reach {
    double free, points, cells;
  };

  /// Return the speed that a command loses against that of now; 0 if none.
  static double find_loss(double now, double first) {
    return now == 0.0 ? 0.0 : std::max(std::copysign(1.0, now) * (now - first), 0.0);
  }

  /// Return the twists that bring a robot to rest along an arc, the first one included.
  std::vector<Twist> brake(Twist twist) const {
    // Rounded down, so that what is left of a ramp never gets longer.
    const double ratio = std::max(twist.speed() / most_.v, std::abs(twist.omega) / most_.omega);
    if (!(ratio <= detail::MAX_RAMP)) throw InputError("cspace: a twist must come to rest within at most 100000 commands");
    const int steps = static_cast<int>(std::ceil(ratio * (1.0 - 1e-9)));
    std::vector<Twist> ramp;
    for (int k = 0; k < steps; ++k) {
      const double share = 1.0 - static_cast<double>(k) / steps;
      ramp.push_back(twist.scale(share));
    }
    return ramp;
  }

  static std::vector<Twist> at_rest(std::vector<Twist> commands) {
    if (commands.empty()) commands.push_back({0.0, 0.0});
    return commands;
  }

  double count_arcs(const Twist& twist) const {
    const double length = twist.speed() * options_.dt, angle = std::abs(twist.omega) * options_.dt;
    return std::ceil(std::max(std::sqrt(length * angle / (0.5 * map_->spacing())), angle));
  }

  /// Raise the number of arcs that each command is cut into, and the largest product of a length and an angle.
  void cut(const std::vector<Twist>& commands, double& pieces, double& bend) const {
    if (commands.empty() || !(count_arcs(commands[0]) <= detail::MAX_ARCS)) return;
    for (const Twist& twist : commands) {
      pieces = std::max(pieces, count_arcs(twist));
      bend = std::max(bend, twist.speed() * options_.dt * (std::abs(twist.omega) * options_.dt));
    }
  }

  /// Return true if a ramp is FREE on the map, cut by itself.
  bool ramp_is_free(const double* q, const std::vector<Twist>& commands) const {
    double pieces = 1.0, bend = 0.0;
    cut(commands, pieces, bend);
    return arcs_are_free(q, commands, std::max<std::size_t>(commands.size(), 1), pieces, bend);
  }

  /// Return true if the arcs of twists, cut into pieces, are FREE, with all near motions, and the robot then rests.
  ///
  /// A piece of length L that turns by angle a lies within L a / 8 of even motion along its chord.
  bool arcs_are_free(const double* q, const std::vector<Twist>& commands, std::size_t rows, double pieces,
                     double bend) const {
    if (!commands.empty() && !(count_arcs(commands[0]) <= detail::MAX_ARCS)) return false;
    const double sag = bend / (8.0 * (pieces * pieces)) + 0x1p-30 * map_->spacing() * (static_cast<double>(rows) * pieces);
    const std::vector<double> radii = {options_.tracking[0] + sag, options_.tracking[1] + sag, options_.tracking[2]};
    const double start = q[2] - std::floor((q[2] + detail::PI) / detail::TWO_PI) * detail::TWO_PI;
    double x = 0.0, y = 0.0, yaw = 0.0;
    double pair[] = {q[0], q[1], q[2], q[0], q[1], q[2]};
    for (const Twist& twist : commands) {
      const double angle = twist.omega * options_.dt / pieces, half = detail::PI * (angle / detail::TWO_PI);
      const double ratio = half == 0.0 ? 1.0 : std::sin(half) / half;
      const Point chord{twist.v * options_.dt / pieces * ratio, twist.side * options_.dt / pieces * ratio};
      for (int k = 0; k < static_cast<int>(pieces); ++k) {
        yaw += angle;
        const Point way = detail::turn(chord, start + yaw - 0.5 * angle);
        x += way.x;
        y += way.y;
        std::copy(pair + 3, pair + 6, pair);
        pair[3] = q[0] + x;
        pair[4] = q[1] + y;
        pair[5] = start + yaw;
        if (map_->proven_prefix(pair, 2, radii) < 1) return false;
      }
    }
    if (commands.size() == rows) return true;
    std::copy(pair + 3, pair + 6, pair);
    return map_->proven_prefix(pair, 2, radii) == 1;
  }

  /// Return for how long, at most `seconds`, a twist is proven by distances.
  Reach find_reach(const double* q, const Twist& twist, double seconds, const std::vector<Point>& points,
                   bool leaving) const {
    Reach reach{seconds, seconds, seconds};
    const double least = seconds / detail::PIECES;
    const double range = size_ + margin() + twist.speed() * seconds;
    std::vector<Point> near;
    for (const Point& point : points) {
      const Point seen = see(q, point);
      if (std::hypot(seen.x, seen.y) <= range) near.push_back(seen);
    }
    for (const detail::Body& body : robot_) {
      const double needed = margin() + body.radius;
      for (const Point& seen : near)
        if (body.measure_gap(seen).distance < needed) reach.free = -1.0;
      reach.free = detail::follow(body, near, needed, twist, reach.free, least, false);
      if (leaving) reach.points = detail::follow(body, near, needed, twist, reach.points, least, true);
    }
    if (leaving) reach.cells = find_cell_reach(q, twist, seconds);
    return reach;
  }

  /// Return a point in the frame of a robot.
  static Point see(const double* q, const Point& point) {
    const double x = point.x - q[0], y = point.y - q[1], cosine = std::cos(q[2]), sine = std::sin(q[2]);
    return {cosine * x + sine * y, cosine * y - sine * x};
  }

  /// Return true if a part of the robot has one of its points, in its frame, nearer than a distance.
  bool has_within(const std::vector<std::vector<Point>>& points, double distance) const {
    for (std::size_t k = 0; k < robot_.size(); ++k)
      for (const Point& point : points[k])
        if (robot_[k].measure_gap(point).distance - robot_[k].radius < distance) return true;
    return false;
  }

  /// Return the centers of taken cells within a range of the robot, in its frame, for each of its parts.
  std::vector<std::vector<Point>> list_taken(const double* q, double range) const {
    const double spacing = map_->spacing();
    const std::vector<double> lower = map_->lower();
    const auto find_cell = [&](int axis, double offset) {
      return static_cast<std::int64_t>(std::floor((q[axis] + offset - lower[axis]) / spacing));
    };
    const std::int64_t last_x = find_cell(0, range), last_y = find_cell(1, range);
    std::vector<std::vector<Point>> taken(robot_.size());
    for (std::size_t k = 0; k < robot_.size(); ++k) {
      if (k > 0 && robot_[k].layers == robot_[k - 1].layers) {
        taken[k] = taken[k - 1];
        continue;
      }
      for (std::int64_t i = find_cell(0, -range); i <= last_x; ++i) {
        for (std::int64_t j = find_cell(1, -range); j <= last_y; ++j) {
          if (!map_->is_taken(i, j, robot_[k].layers)) continue;
          const double x = static_cast<double>(i) + 0.5, y = static_cast<double>(j) + 0.5;
          const Point seen = see(q, {lower[0] + x * spacing, lower[1] + y * spacing});
          if (std::hypot(seen.x, seen.y) <= range) taken[k].push_back(seen);
        }
      }
    }
    return taken;
  }

  /// Return true if the cells within a range of the robot are few, and near enough to the grid for exact places.
  bool can_list(const double* q, double range) const {
    const double spacing = map_->spacing();
    const std::vector<double> lower = map_->lower();
    return 2.0 * range / spacing + 2.0 <= std::sqrt(detail::MAX_NEAR_CELLS) &&
           std::abs(q[0] - lower[0]) / spacing <= detail::FARTHEST_CELL && std::abs(q[1] - lower[1]) / spacing <= detail::FARTHEST_CELL;
  }

  /// Return for how long, at most `seconds`, a twist comes no nearer to any taken cell.
  double find_cell_reach(const double* q, const Twist& twist, double seconds) const {
    const double margin = margin_ + detail::CELL_REACH * map_->spacing();
    const double range = size_ + margin + twist.speed() * seconds, least = seconds / detail::PIECES;
    if (!can_list(q, range)) return 0.0;
    const auto taken = list_taken(q, range);
    if (has_within(taken, -lost_depth_)) return 0.0;
    for (std::size_t k = 0; k < robot_.size(); ++k)
      seconds = detail::follow(robot_[k], taken[k], margin + robot_[k].radius, twist, seconds, least, true);
    return seconds;
  }

  std::shared_ptr<const Map> map_;
  std::vector<detail::Body> robot_;
  GateOptions options_;
  Twist most_{};         ///< a braking twist's largest change in `dt`
  double size_ = 0.0;    ///< distance of the robot's farthest point from its origin, metres
  double lost_depth_ = 0.0;  ///< of the center of a taken cell inside a robot, from which on it is lost, metres
  double margin_ = 0.0;  ///< distance of what the robot may not touch, even if it strays, metres
};

}  // namespace cspace

#if defined(__clang__)
#pragma STDC FP_CONTRACT DEFAULT
#elif defined(__FP_FAST_FMA)
#pragma GCC pop_options
#endif

#endif  // CSPACE_GATE_HPP
