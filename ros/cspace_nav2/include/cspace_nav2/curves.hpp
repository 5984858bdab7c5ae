/// @file curves.hpp
/// Arcs that robots drive, and the shortest curves of cars (L. E. Dubins, 1957; J. A. Reeds and L. A. Shepp, 1990).
///
/// The curves are those of `planners/_edges/car_curves.py`, with its names.
#ifndef CSPACE_NAV2_CURVES_HPP
#define CSPACE_NAV2_CURVES_HPP

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <vector>

#include "cspace_nav2/poses.hpp"

namespace cspace_nav2 {

/// A drive at one curvature: metres, negative in reverse, and radians to the left; without length, a turn on the spot.
struct Arc {
  double length, angle;
  double aside = 0.0;  ///< radians from ahead to where a holonomic robot moves
};

/// Return an angle as at most half a turn.
inline double wrap(double angle) {
  // The library's function takes long, and most angles are small.
  return std::abs(angle) <= M_PI ? angle : std::remainder(angle, 2.0 * M_PI);
}

/// Return the pose at the end of an arc; its yaw is not wrapped.
inline Configuration advance(const Configuration& q, const Arc& arc) {
  const double half = 0.5 * arc.angle;
  const double chord = half == 0.0 ? arc.length : arc.length * std::sin(half) / half;
  const double heading = q[2] + half + arc.aside;
  return {q[0] + chord * std::cos(heading), q[1] + chord * std::sin(heading), q[2] + arc.angle};
}

/// An arc, and how far aside of its end a pose is, metres.
struct Fit {
  Arc arc;
  double gap;
};

/// Return the arc between two poses of which each lies on it: its chord, and the shorter turn.
inline Fit arc_between(const Configuration& from, const Configuration& to) {
  const double half = 0.5 * wrap(to[2] - from[2]), dx = to[0] - from[0], dy = to[1] - from[1];
  const double cosine = std::cos(from[2] + half), sine = std::sin(from[2] + half);
  const double chord = dx * cosine + dy * sine;
  return {{half == 0.0 ? chord : chord * half / std::sin(half), 2.0 * half}, std::abs(dy * cosine - dx * sine)};
}

namespace detail {

/// Largest gap between the end of a curve and its goal, in turning radii and in radians.
constexpr double MAX_GAP = 1e-6;

/// Allowance for rounding in that gap, in turning radii, for each turning radius of a curve's length.
constexpr double GAP_PER_LENGTH = 1e-12;

/// Arcs within that many radians below 2 pi are tried as 0, because rounding turns empty arcs into loops.
constexpr double SNAP_RADIANS = 1e-6;

/// Largest distance, in turning radii, between the circles of two adjoining arcs, which touch but for rounding.
constexpr double TOUCH_TOLERANCE = 1e-7;

/// Lengths of at most five segments, turning radii.
using Lengths = std::array<double, 5>;

/// A curve of a car whose turning radius is 1; unused arcs have no length.
using Word = std::array<Arc, 5>;

/// Segments of a word, 1 for left, -1 for right and 0 for straight on; `solve` gives their lengths.
struct Form {
  std::array<int, 5> steering;
  std::size_t segments;
  double closest, farthest;  ///< distances between the centers of the first and the last circle, turning radii
  bool has_way_back;         ///< whether it differs from its way back, from the end to the start
};

constexpr double FAR = std::numeric_limits<double>::infinity(), TOUCHING = 2.0 - TOUCH_TOLERANCE;
constexpr std::array<Form, 9> FORMS = {{{{1}, 1, 0.0, FAR, false},
                                        {{1, 0, 1}, 3, 0.0, FAR, false},
                                        {{1, 0, -1}, 3, TOUCHING, FAR, false},
                                        {{1, -1, 1}, 3, 0.0, 4.0 + TOUCH_TOLERANCE, true},
                                        {{1, -1, 1, -1}, 4, 0.0, 2.0 + TOUCH_TOLERANCE, false},
                                        {{1, -1, 1, -1}, 4, TOUCHING, 4.4721359549995794, false},
                                        {{1, -1, 0, 1}, 4, TOUCHING, FAR, true},
                                        {{1, -1, 0, -1}, 4, TOUCHING, FAR, true},
                                        {{1, -1, 0, 1, -1}, 5, TOUCHING, FAR, false}}};

/// Number of forms, the first ones, that a car without reverse can drive.
constexpr std::size_t DUBINS_FORMS = 4;

/// Center of the last circle of words, relative to the center of the first circle.
struct Center {
  double xi, eta, apart, bearing;

  /// @param side  1 if the last arc turns left, -1 if it turns right
  Center(const Configuration& goal, double cosine, double sine, int side)
      : xi(goal[0] - side * sine),
        eta(goal[1] - 1.0 + side * cosine),
        apart(std::sqrt(xi * xi + eta * eta)),
        bearing(std::atan2(eta, xi)) {}
};

/// Return lengths of a form's word to a yaw, whose arcs are not wrapped; nothing if it does not get there.
/// @param centers  those of words whose last arc turns left and right
inline std::optional<Lengths> solve(std::size_t number, double phi, const std::array<Center, 2>& centers) {
  if (number == 0) return Lengths{phi};
  const Form& form = FORMS[number];
  const auto& [xi, eta, apart, bearing] = centers[form.steering[form.segments - 1] < 0];
  const double quarter = M_PI_2;
  if (!(form.closest <= apart && apart <= form.farthest)) return {};
  const double straight = std::sqrt(std::max(apart * apart - 4.0, 0.0));  // the tangent between the two circles
  switch (number) {
    case 1:
      return Lengths{bearing, apart, phi - bearing};
    case 2: {
      const double t = bearing + std::atan2(2.0, straight);
      return Lengths{t, straight, t - phi};
    }
    case 3: {
      const double u = -2.0 * std::asin(std::min(0.25 * apart, 1.0)), t = bearing + 0.5 * u + M_PI;
      return Lengths{t, u, phi - t + u};
    }
    case 6: {
      const double t = bearing + std::atan2(straight, -2.0);
      return Lengths{t, -quarter, 2.0 - straight, phi - quarter - t};
    }
    case 7: {
      const double t = std::atan2(xi, -eta);
      return Lengths{t, -quarter, 2.0 - apart, t + quarter - phi};
    }
    case 8: {
      const double u = 4.0 - straight, t = std::atan2((4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta);
      return Lengths{t, -quarter, u, -quarter, t - phi};
    }
  }
  const double u = number == 4 ? std::acos(std::min(0.25 * (2.0 + apart), 1.0))
                               : -std::acos(std::min((20.0 - apart * apart) / 16.0, 1.0));
  const double v = number == 4 ? -u : u;
  const double a = std::sin(u) - std::sin(u - v), b = std::cos(u) - std::cos(u - v) - 1.0;
  double t = std::atan2(eta * a - xi * b, xi * a + eta * b);
  if (2.0 * (std::cos(u - v) - std::cos(v) - std::cos(u)) + 3.0 < 0.0) t += M_PI;
  return Lengths{t, u, v, t - u + v - phi};
}

/// Return true if a word ends at its goal, up to rounding.
inline bool reaches(const Word& word, const Configuration& goal) {
  Configuration end{};
  double length = 0.0;
  for (const Arc& arc : word) {
    if (arc.length != 0.0) end = cspace_nav2::advance(end, arc);
    length += std::abs(arc.length);
  }
  const double gap = std::hypot(end[0] - goal[0], end[1] - goal[1]), turn = wrap(end[2] - goal[2]);
  return gap <= MAX_GAP + GAP_PER_LENGTH * length && std::abs(turn) <= MAX_GAP;
}

/// Return the shortest word from the origin; one that, but for rounding, gets to its goal, unless words are driven.
///
/// Each form gives words by symmetry: mirrored (left for right), reversed (ahead for back) and backwards (from the end to the
/// start). Words of Dubins are neither reversed nor backwards; their arcs just below 2 pi are tried as 0 and as given.
inline std::optional<Word> find_word(const Configuration& goal, bool reverses, bool is_driven) {
  std::optional<Word> shortest;
  double least = FAR;
  const auto offer = [&](const Form& form, const Lengths& lengths, int mirror, int sign, bool goes_back, double longest) {
    Word word{};
    double total = 0.0;
    for (std::size_t k = 0; k < form.segments; ++k) {
      const std::size_t source = goes_back ? form.segments - 1 - k : k;
      const int steering = form.steering[source];
      double length = lengths[source];
      // A straight segment has one length, an arc is the same after a whole turn.
      if (steering != 0) length -= 2.0 * M_PI * std::floor((length + (reverses ? M_PI : 0.0)) / (2.0 * M_PI));
      if (steering != 0 && length > longest) length = 0.0;
      word[k] = {sign * length, sign * mirror * steering * length};
      total += std::abs(length);
      if (!(total < least)) return;
    }
    // One arc gets there only by chance.
    if ((is_driven || form.segments == 1) && !reaches(word, goal)) return;
    least = total;
    shortest = word;
  };
  for (const int mirror : {1, -1})
    for (const int sign : {1, -1}) {
      if (sign < 0 && !reverses) continue;
      // The goal of the word that, mirrored or reversed, reaches the given goal; and the start, seen from there.
      const Configuration seen = {sign * goal[0], mirror * goal[1], sign * mirror * goal[2]};
      const double cosine = std::cos(seen[2]), sine = std::sin(seen[2]);
      const Configuration back = {seen[0] * cosine + seen[1] * sine, seen[0] * sine - seen[1] * cosine, seen[2]};
      const auto find_centers = [&](const Configuration& q) {
        return std::array<Center, 2>{Center(q, cosine, sine, 1), Center(q, cosine, sine, -1)};
      };
      const std::array<Center, 2> centers = find_centers(seen), back_centers = reverses ? find_centers(back) : centers;
      for (std::size_t number = 0; number < (reverses ? FORMS.size() : DUBINS_FORMS); ++number) {
        const Form& form = FORMS[number];
        const auto ahead = solve(number, seen[2], centers);
        if (ahead && !reverses) offer(form, *ahead, mirror, sign, false, 2.0 * M_PI - SNAP_RADIANS);
        if (ahead) offer(form, *ahead, mirror, sign, false, FAR);
        if (!reverses || !form.has_way_back) continue;
        if (const auto lengths = solve(number, back[2], back_centers)) offer(form, *lengths, mirror, sign, true, FAR);
      }
    }
  return shortest;
}

/// Return the shortest word from the origin that gets to its goal.
inline std::optional<Word> find_shortest_word(const Configuration& goal, bool reverses) {
  if (reaches({}, goal)) return Word{};
  // Driving a word takes longer than making it, so all are driven only if the shortest one does not get there.
  const std::optional<Word> word = find_word(goal, reverses, false);
  return word && reaches(*word, goal) ? word : find_word(goal, reverses, true);
}

}  // namespace detail

/// Return the shortest curve of a car between two poses.
inline std::vector<Arc> find_shortest_curve(double radius, bool reverses, const Configuration& from, const Configuration& to) {
  // The goal as seen from the start, in turning radii.
  const double dx = (to[0] - from[0]) / radius, dy = (to[1] - from[1]) / radius;
  const double cosine = std::cos(from[2]), sine = std::sin(from[2]);
  const auto word =
      detail::find_shortest_word({dx * cosine + dy * sine, dy * cosine - dx * sine, to[2] - from[2]}, reverses);
  if (!word) throw std::runtime_error("cspace_nav2: no curve joins two poses; they must be finite");
  std::vector<Arc> arcs(word->begin(), word->end());
  for (Arc& arc : arcs) arc.length *= radius;
  return arcs;
}

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_CURVES_HPP
