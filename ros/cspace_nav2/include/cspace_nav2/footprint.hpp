/// @file footprint.hpp
/// A robot's footprint from texts, compared with the robot that a map was built for.
#ifndef CSPACE_NAV2_FOOTPRINT_HPP
#define CSPACE_NAV2_FOOTPRINT_HPP

#include <string>
#include <utility>
#include <vector>

#include <cspace/gate.hpp>

namespace cspace_nav2 {

/// Metres by which a footprint and the map's robot may differ.
constexpr double SAME = 1e-6;

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

/// Return the part of a segment, shares from 0 to 1, that is in a convex body grown by some metres; empty if first >= second.
inline std::pair<double, double> clip(const cspace::detail::Body& body, const cspace::Point& from, const cspace::Point& to,
                                      double growth) {
  std::pair<double, double> inside(0.0, 1.0);
  for (std::size_t side = 0; side < body.normals.size(); ++side) {
    const double begin = body.measure_height(side, from) - growth, end = body.measure_height(side, to) - growth;
    if (begin > 0.0 && end > 0.0) return {1.0, 0.0};
    if (begin > 0.0) inside.first = std::max(inside.first, begin / (begin - end));
    if (end > 0.0) inside.second = std::min(inside.second, begin / (begin - end));
  }
  return inside;
}

/// Return true if convex parts make a polygon: they cover its outline, which is inside none of them, and lie in it.
inline bool is_made_of(const std::vector<cspace::Point>& outline, const std::vector<cspace::Core>& parts) {
  std::vector<cspace::detail::Body> bodies(parts.begin(), parts.end());
  for (std::size_t k = 0; k < outline.size(); ++k) {
    const cspace::Point &from = outline[k], &to = outline[(k + 1) % outline.size()];
    std::vector<std::pair<double, double>> covered;
    for (const cspace::detail::Body& body : bodies) {
      const auto [first, last] = clip(body, from, to, -SAME);
      if (first < last) return false;
      covered.push_back(clip(body, from, to, SAME));
    }
    std::sort(covered.begin(), covered.end());
    double done = 0.0;
    for (const auto& [first, last] : covered)
      if (first <= done) done = std::max(done, last);
    if (done < 1.0) return false;
  }
  return std::all_of(parts.begin(), parts.end(), [&](const cspace::Core& part) {
    // A ray to the right from the middle of the part crosses the outline an odd number of times.
    cspace::Point middle{0.0, 0.0};
    for (const cspace::Point& corner : part.corners) {
      middle.x += corner.x / static_cast<double>(part.corners.size());
      middle.y += corner.y / static_cast<double>(part.corners.size());
    }
    bool is_inside = false;
    for (std::size_t k = 0; k < outline.size(); ++k) {
      const cspace::Point &a = outline[k], &b = outline[(k + 1) % outline.size()];
      if ((a.y > middle.y) == (b.y > middle.y)) continue;
      if (a.x + (middle.y - a.y) / (b.y - a.y) * (b.x - a.x) > middle.x) is_inside = !is_inside;
    }
    return is_inside;
  });
}

/// Return the convex parts of a map's robot; a footprint, if there is one, must be the same robot.
/// @throws cspace::InputError  if the footprint is none, or of another robot
inline std::vector<cspace::Core> read_footprint(const cspace::Map& map, const std::vector<std::string>& texts) {
  const std::vector<cspace::Core> robot = cspace::read_robot(map);
  if (texts.empty()) return robot;
  std::vector<cspace::Core> parts;
  for (const std::string& text : texts) parts.push_back(read_part(text));
  if (robot.size() > 1 || robot[0].corners.size() < 3)
    throw cspace::InputError("the map's robot has discs or several parts: leave the footprint empty");
  if (!is_made_of(robot[0].corners, parts)) throw cspace::InputError("the footprint is not the robot that the map was built for");
  return parts;
}

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_FOOTPRINT_HPP
