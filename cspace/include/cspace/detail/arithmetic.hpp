/// @file arithmetic.hpp
/// Arcs between rotations and walks through cells, as in Python. `map.hpp` includes it; it is not for users.
#ifndef CSPACE_DETAIL_ARITHMETIC_HPP
#define CSPACE_DETAIL_ARITHMETIC_HPP

#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>
#include <cstddef>
#include <cstdint>

#if defined(__FAST_MATH__)
#error "cspace/map.hpp: proofs need IEEE arithmetic; compile without -ffast-math"
#endif
static_assert(FLT_EVAL_METHOD == 0, "cspace/map.hpp: proofs need double arithmetic without excess precision");

// A fused multiply-add rounds once where Python rounds twice. CSPACE_EXACT begins each function that multiplies and adds.
#if defined(__clang__)
#define CSPACE_EXACT _Pragma("STDC FP_CONTRACT OFF")
#else
#define CSPACE_EXACT
#if defined(__FP_FAST_FMA)
#pragma GCC push_options
#pragma GCC optimize("fp-contract=off")
#endif
#endif

namespace cspace {
namespace detail {

using Index = std::int64_t;
using Row = std::array<double, 3>;
using Cell = std::array<Index, 3>;
using Quaternion = std::array<double, 4>;


constexpr double PI = 3.141592653589793;
constexpr double TWO_PI = 2.0 * PI;
constexpr double QUARTER_PI = PI / 4.0;

// The constants of the same names in Python.
constexpr double SLACK = 0x1p-26;
constexpr double MAX_COORDINATE = 0x1p22;
constexpr double MAX_POSITION = 8.0 * MAX_COORDINATE;
constexpr double MAX_CELL = 0x1p62;
constexpr double MIN_EXTENT_CELLS = 0x1p-500;
constexpr double ROUNDING_FACTOR = 1.0 - 0x1p-22;
constexpr double MAX_ANGLE = 0x1p20;
constexpr double ANGLE_SLACK = 1e-9;
constexpr double NORM_SLACK = 1e-6;
constexpr double QUOTIENT_SLACK = 1e-9;
constexpr double OMPL_EQUALITY_SLACK = 4e-9;
constexpr Index MAX_EXTERIOR_CELL = Index(1) << 40;
constexpr Index MAX_YAW_CELLS = 1 << 16;
constexpr Index MAX_PARTS_PER_AXIS = 64;
constexpr Index MAX_TILES = 1 << 22;
constexpr int OTHER_COMPONENTS[4][3] = {{1, 2, 3}, {0, 2, 3}, {0, 1, 3}, {0, 1, 2}};

/// Round down; for coordinates in cells below 2^62, for which this is quicker than std::floor.
inline Index round_down(double x) {
  const Index truncated = static_cast<Index>(x);
  return truncated - (static_cast<double>(truncated) > x);
}

inline Index round_up(double x) { return -round_down(-x); }

inline double dot_product(const Quaternion& a, const Quaternion& b) {
  CSPACE_EXACT
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
}

inline Quaternion mix(const Quaternion& a, const Quaternion& b, double a_weight, double b_weight) {
  CSPACE_EXACT
  Quaternion sum;
  for (std::size_t k = 0; k < 4; ++k) sum[k] = a_weight * a[k] + b_weight * b[k];
  return sum;
}

inline Quaternion normalise(const Quaternion& q, double scale) {
  scale /= std::sqrt(dot_product(q, q));
  return {q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale};
}

/// A shortest arc between two unit quaternions, with its chord.
struct Arc {
  Quaternion first, second;    ///< at most a right angle apart
  double tangent, half_angle;  ///< of half the angle between the ends
  bool is_tiny;                ///< true if OMPL counts the ends as equal
};

inline Arc find_arc(const Quaternion& q0, const Quaternion& q1, int arc) {
  const Quaternion a = normalise(q0, 1.0);
  Quaternion b = normalise(q1, 1.0);
  const bool is_beyond_right_angle = dot_product(a, b) < 0.0;
  if (is_beyond_right_angle != (arc == 1)) b = normalise(b, -1.0);
  const Quaternion difference = mix(b, a, 1.0, -1.0);
  const Quaternion total = mix(b, a, 1.0, 1.0);
  const double tangent = std::sqrt(dot_product(difference, difference) / dot_product(total, total));
  return {a, b, tangent, std::atan(tangent), dot_product(a, b) > 1.0 - OMPL_EQUALITY_SLACK};
}

/// Return the signed angle of an arc between two yaws: arc 0 is the shorter one, in [-pi, pi], arc 1 the other one.
inline double signed_angle(double first, double second, int arc) {
  CSPACE_EXACT
  double angle = second - first;
  angle -= std::floor(angle / TWO_PI) * TWO_PI;
  if (angle > PI) angle -= TWO_PI;
  if (arc == 0) return angle;
  return angle > 0.0 ? angle - TWO_PI : angle + TWO_PI;
}

/// Interpolate between two numbers at t in [0, 1]; rounding does not lead beyond them.
inline double between(double first, double second, double t) {
  CSPACE_EXACT
  if (t == 0.0) return first;
  if (t == 1.0) return second;
  const double value = first + t * (second - first);
  return std::min(std::max(value, std::min(first, second)), std::max(first, second));
}

inline Row position_along(const Row& p0, const Row& p1, double t) {
  return {between(p0[0], p1[0], t), between(p0[1], p1[1], t), between(p0[2], p1[2], t)};
}

/// A segment along one axis, from `p` to `p + extent`, in cells.
struct Walk {
  double p, extent, rate;
  bool is_still;

  Walk(double from, double to)
      : p(from), extent(to - from), rate(1.0 / extent), is_still(std::abs(extent) < MIN_EXTENT_CELLS) {}

  /// Write the range of t in [0, 1] in which the segment is in a slab of cells, widened by SLACK.
  void slab_times(Index cell, double& start, double& stop) const {
    CSPACE_EXACT
    start = 0.0;
    stop = 1.0;
    if (is_still) return;
    const double enter = (static_cast<double>(cell) - SLACK - p) * rate;
    const double leave = (static_cast<double>(cell + 1) + SLACK - p) * rate;
    start = std::max(std::min(enter, leave), 0.0);
    stop = std::min(std::max(enter, leave), 1.0);
  }

  /// Write the first and the last closed cell that the segment touches for t from start to stop.
  void cells_between(double start, double stop, Index& first, Index& last) const {
    CSPACE_EXACT
    const double begin = p + start * extent;
    const double end = p + stop * extent;
    first = round_up(std::min(begin, end) - SLACK) - 1;
    last = round_down(std::max(begin, end) + SLACK);
  }
};
}  // namespace detail
}  // namespace cspace

#if defined(__FP_FAST_FMA) && !defined(__clang__)
#pragma GCC pop_options
#endif

#endif  // CSPACE_DETAIL_ARITHMETIC_HPP
