/// @file footprint.hpp
/// A robot's footprint from texts, compared with the robot that a map was built for.
#ifndef CSPACE_NAV2_FOOTPRINT_HPP
#define CSPACE_NAV2_FOOTPRINT_HPP

#include <string>
#include <vector>

#include <cspace/gate.hpp>

namespace cspace_nav2 {

/// Metres by which a footprint and the map's robot may differ.
constexpr double SAME = 1e-6;

/// Largest distance of a robot's points from its origin, metres.
constexpr double MAX_SIZE = 100.0;

/// Return a convex part from a text as Nav2 has it: "[[0.3, 0.2], [-0.3, 0.2], ...]", metres.
/// @throws cspace::InputError  if it is none
inline cspace::Core read_part(const std::string& text) {
  std::string numbers = text;
  for (char& letter : numbers)
    if (letter == '[' || letter == ']' || letter == ',') letter = ' ';
  std::istringstream items(numbers);
  items.imbue(std::locale::classic());
  cspace::Core part;
  for (cspace::Point corner; items >> corner.x >> corner.y;) part.corners.push_back(corner);
  // All is read if no item is left, nor the first half of a pair.
  const bool is_whole = items.eof() && std::count(text.begin(), text.end(), ',') + 1 ==
                                           2 * static_cast<std::ptrdiff_t>(part.corners.size());
  if (!is_whole || part.corners.size() < 3)
    throw cspace::InputError("the footprint '" + text + "' is no list of pairs such as [[0.3, 0.2], [-0.3, 0.2], [0, -0.2]]");
  cspace::detail::turn_left(part.corners);
  return part;
}

/// Check the parameter `robot`: a disc or a footprint, in words of `cspace build --robot`.
/// @throws std::invalid_argument  if it is none
inline void check_shape(const std::string& text) {
  const std::string kind = text.substr(0, text.find(':') + 1), rest = text.substr(kind.size());
  double size = 0.0;
  try {
    if (kind == "footprint:") {
      const cspace::Core part = read_part(rest);
      cspace::Gate::check_core(part);
      for (const cspace::Point& corner : part.corners) size = std::max(size, std::hypot(corner.x, corner.y));
    }
    std::istringstream number(rest);
    number.imbue(std::locale::classic());
    if (kind == "disc:" && !((number >> size) && number.eof())) size = 0.0;
  } catch (const cspace::InputError&) {
    size = 0.0;
  }
  if (!(size > 0.0 && size <= MAX_SIZE))
    throw std::invalid_argument("the parameter 'robot' is '" + text + "'; it must be disc:RADIUS, or footprint:[[x, y], [x, y], [x, y]] " +
                                "with the corners of a convex polygon, metres, at most 100 from the origin");
}

/// Return true if two convex parts are the same polygon, whatever its first corner.
inline bool are_same(const cspace::Core& part, const cspace::Core& other) {
  const std::size_t count = part.corners.size();
  for (std::size_t shift = 0; count == other.corners.size() && shift < count; ++shift) {
    double most = 0.0;
    for (std::size_t k = 0; k < count; ++k) {
      const cspace::Point &a = part.corners[k], &b = other.corners[(k + shift) % count];
      most = std::max(most, std::hypot(a.x - b.x, a.y - b.y));
    }
    if (most <= SAME) return true;
  }
  return false;
}

/// Return true if a point is in a convex part, or hardly outside.
inline bool contains(const cspace::Core& part, const cspace::Point& point) {
  const std::size_t count = part.corners.size();
  const cspace::Point &first = part.corners[0];
  if (count == 1) return std::hypot(point.x - first.x, point.y - first.y) <= part.radius + SAME;
  for (std::size_t k = 0; k < count; ++k) {
    const cspace::Point &a = part.corners[k], &b = part.corners[(k + 1) % count];
    const double area = (b.x - a.x) * (point.y - a.y) - (b.y - a.y) * (point.x - a.x);
    if (!(area >= -(part.radius + SAME) * std::hypot(b.x - a.x, b.y - a.y))) return false;
  }
  return true;
}

/// Write a part as Nav2 has footprints, and its radius if it has one.
inline void write_part(std::ostream& text, const cspace::Core& part) {
  for (const cspace::Point& corner : part.corners)
    text << (&corner == &part.corners.front() ? " [[" : ", [") << corner.x << ", " << corner.y << "]";
  text << "]";
  if (part.radius > 0.0) text << " grown by " << part.radius << " m";
}

/// Return the convex parts of a map's robot; a footprint, if there is one, must have the same.
/// @throws cspace::InputError  if the footprint is none, or of another robot
inline std::vector<cspace::Core> read_footprint(const cspace::Map& map, const std::vector<std::string>& texts) {
  const std::vector<cspace::Core> robot = cspace::read_robot(map);
  std::vector<cspace::Core> parts;
  for (const std::string& text : texts) parts.push_back(read_part(text));
  const auto is_given = [&](const cspace::Core& part) {
    return std::any_of(parts.begin(), parts.end(), [&](const cspace::Core& given) { return are_same(part, given); });
  };
  const bool is_same = parts.size() == robot.size() && std::all_of(robot.begin(), robot.end(), is_given);
  if (!texts.empty() && !is_same) throw cspace::InputError("the footprint is not the robot that the map was built for");
  return robot;
}

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_FOOTPRINT_HPP
