/// @file watch.hpp
/// The watch of a gate: the newest command and scans with their ages, where the robot is, and what it may drive. It
/// needs no ROS.
///
///     cspace_nav2::Watch watch([gate] { return cspace_nav2::Ground{gate}; }, options);
///     watch.hear_command({0.5, 0.1}, now);
///     watch.hear_scan("scan", scan);
///     cspace_nav2::Decision decision = watch.decide(now, clock, look_up);  // once in each period
#ifndef CSPACE_NAV2_WATCH_HPP
#define CSPACE_NAV2_WATCH_HPP

#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <cspace/gate.hpp>

namespace cspace_nav2 {

/// Nanoseconds, of a clock that never jumps, or of the clock of stamps.
using Time = std::int64_t;

constexpr Time NEWEST = 0;  ///< the stamp that stands for the newest one

inline double to_seconds(Time time) { return 1e-9 * static_cast<double>(time); }
inline Time to_time(double seconds) { return static_cast<Time>(1e9 * seconds); }

/// A point of space, metres.
struct Spot {
  double x, y, z;
};

/// Where a frame is in another one: metres, a quaternion x, y, z, w, and when.
struct Placement {
  Spot at;
  std::array<double, 4> turn;
  Time stamp;

  /// Return a point of the frame in the other one.
  Spot place(const Spot& p) const {
    const auto [x, y, z, w] = turn;
    const Spot cross{y * p.z - z * p.y, z * p.x - x * p.z, x * p.y - y * p.x};
    return {at.x + p.x + 2.0 * (w * cross.x + y * cross.z - z * cross.y),
            at.y + p.y + 2.0 * (w * cross.y + z * cross.x - x * cross.z),
            at.z + p.z + 2.0 * (w * cross.z + x * cross.y - y * cross.x)};
  }
};

/// Says where a frame is in another one, at a time or `NEWEST`: nothing if that is not known yet; throws if it never will be.
using LookUp = std::function<std::optional<Placement>(const std::string& target, const std::string& frame, Time stamp)>;

/// A point in the frame of a sensor, and the share of the sweep at which it was seen, from 0 to 1.
struct SeenSpot {
  Spot at;
  double share;
};

/// What a sensor saw, in its own frame.
struct Scan {
  std::string frame;
  Time stamp;
  std::vector<SeenSpot> points;
  bool is_flat = false;  ///< of a laser in one plane, which must be within the heights
  Time sweep = 0;        ///< from the first point, at the stamp, to the last one
};

/// What a watch knows of its inputs.
struct WatchOptions {
  std::vector<std::string> sources = {"scan"};  ///< names of the sensors, each of which must be heard
  double max_age = 0.3;                         ///< of a command, scan, pose or cycle, seconds
  double max_jump = 0.2;                        ///< of a pose from where the commands lead, metres and radians
  double max_tilt = 0.1;                        ///< of the robot, radians
  double min_height = 0.05, max_height = 2.0;   ///< of points that count, metres above the base frame
  std::string map_frame = "map", odom_frame = "odom", base_frame = "base_link";
  bool leaving = true;                          ///< see `cspace::Gate::slow_down`
  double leaving_speed = 0.1;                   ///< of any point of a robot that leaves, m/s
  cspace::Twist max_velocity = {1.0, 2.0};      ///< a command beyond it is refused, m/s and rad/s
};

/// What a robot drives by.
struct Ground {
  std::shared_ptr<const cspace::Gate> gate;
  /// Centers of cells, no larger than the map's, of which the map proves nothing any more; null if there is none.
  std::shared_ptr<const std::vector<cspace::Point>> changed = nullptr;
};

using FindGround = std::function<Ground()>;

/// What the robot is to drive now.
struct Decision {
  cspace::Twist command;
  std::string reason;  ///< why it brakes or stands; empty if some of the wanted command passes
};

/// Decides once in each period; whatever is missing, late or wrong, the robot brakes along a way that was proven.
///
/// Points are kept in the odometry's frame, so that a correction of the place in the map moves them with the robot.
/// Calls must not overlap.
class Watch {
 public:
  /// @param find_ground  returns the gate of now; throws what says why there is none
  Watch(FindGround find_ground, const WatchOptions& options) : find_ground_(std::move(find_ground)), options_(options) {
    for (const std::string& name : options_.sources) sources_[name];
  }

  /// Go on with other options, of the same sources.
  void set_options(const WatchOptions& options) { options_ = options; }

  void hear_command(const cspace::Twist& wanted, Time now) {
    const cspace::Twist& most = options_.max_velocity;
    if (wanted.speed() > most.v || std::abs(wanted.omega) > most.omega)
      return refuse_command("a command is faster than max_velocity");
    wanted_ = wanted;
    command_heard_ = now;
    command_fault_.clear();
  }

  void hear_scan(const std::string& name, Scan scan) {
    Source& source = sources_.at(name);
    source.fault.clear();
    source.waiting.push_back(std::move(scan));
    if (source.waiting.size() > MAX_WAITING) source.waiting.pop_front();
  }

  /// Brake because of a message without use, until the next good one of the same source.
  void refuse_scan(const std::string& name, const std::string& fault) { sources_.at(name).fault = fault; }
  void refuse_command(const std::string& fault) { command_fault_ = fault; }

  /// Return what to drive for a period.
  /// @param now    of a clock that never jumps
  /// @param clock  of the clock of stamps
  Decision decide(Time now, Time clock, const LookUp& look_up) {
    Decision decision{};
    try {
      decision.reason = slow_down(now, clock, look_up);
    } catch (const std::exception& error) {
      decision.reason = error.what();
      brake();
    }
    decision.command = ramp_.front();
    cycle_ = now;
    driven_.push_back({now, decision.command});
    while (driven_.size() > 2 && now - driven_[1].begin > 2 * to_time(options_.max_age)) driven_.pop_front();
    return decision;
  }

  /// Go on to the next command of the way to rest, and return it.
  cspace::Twist brake() {
    if (ramp_.size() > 1) {
      ramp_.erase(ramp_.begin());
    } else {
      ramp_ = {{0.0, 0.0}};
    }
    return ramp_.front();
  }

  static bool is_rest(const cspace::Twist& twist) { return twist.speed() == 0.0 && twist.omega == 0.0; }

 private:
  static constexpr std::size_t MAX_WAITING = 10;
  static constexpr Time NEVER = std::numeric_limits<Time>::min() / 4;
  static constexpr double NORM_SLACK = 1e-2;
  static constexpr double MAX_WAY = 1e7;  ///< metres between two frames

  struct Pose {
    double x, y, yaw;
  };

  /// A sensor: scans whose place is not known yet, newest last, and the points of the last one that was placed.
  struct Source {
    std::deque<Scan> waiting;
    std::vector<Spot> points;
    Time heard = NEVER;
    std::string fault;
  };

  struct Driven {
    Time begin;
    cspace::Twist twist;
  };

  /// Take what the gate lets through as the new way; return why it stands, if it does.
  std::string slow_down(Time now, Time clock, const LookUp& look_up) {
    const Time max_age = to_time(options_.max_age);
    const auto [gate, changed] = find_ground_();
    for (auto& [name, source] : sources_) place_scans(name, source, now, clock, look_up);
    const Placement found = find(options_.base_frame, NEWEST, look_up);
    const Time seen = now - (clock - found.stamp);
    check_age(clock - found.stamp, "the pose of " + options_.base_frame);
    const Pose pose = read_pose(found);
    check_jump(pose, seen, now);
    if (now - cycle_ > max_age) throw std::runtime_error("there was no cycle " + within());
    if (!command_fault_.empty()) throw std::runtime_error(command_fault_);
    if (now - command_heard_ > max_age) throw std::runtime_error("there was no command " + within());
    const Placement corrected = find(options_.odom_frame, found.stamp, look_up);
    std::vector<cspace::Point> points;
    for (const auto& [name, source] : sources_) {
      if (!source.fault.empty()) throw std::runtime_error(source.fault);
      if (now - source.heard > max_age)
        throw std::runtime_error("there was no scan of '" + name + "' " + within() + " whose place tf knew");
      for (const Spot& spot : source.points) {
        const Spot placed = corrected.place(spot);
        points.push_back({placed.x, placed.y});
      }
    }
    const Pose here = move(pose, seen, now);
    const double q[] = {here.x, here.y, here.yaw};
    if (changed && (gate->reaches(q, wanted_, *changed) || gate->reaches(q, ramp_.front(), *changed)))
      throw std::runtime_error("the map has changed near the robot, and is being built");
    const bool stood = is_rest(ramp_.front());
    cspace::SlowedCommand slowed = gate->slow_down(q, wanted_, ramp_.front(), points, options_.leaving);
    if (slowed.leaves && slowed.share > 0.0 && gate->is_near(q, points)) {
      const double speed = wanted_.speed() + std::abs(wanted_.omega) * gate->size();
      slowed = gate->slow_down(q, slow(wanted_, options_.leaving_speed / speed), ramp_.front(), points, true);
    }
    ramp_ = slowed.commands;
    if (!slowed.is_proven && gate->is_lost(q)) return "the robot is lost: it is deep inside what the map has taken";
    if (!slowed.is_proven && !slowed.leaves) return "something is too near to stop before it";
    const bool stands = stood && is_rest(ramp_.front()) && !is_rest(wanted_);
    return stands ? "no part of the command is proven free" : "";
  }

  /// Return a share of a twist, or all of it if the share is above 1 or no number.
  static cspace::Twist slow(const cspace::Twist& twist, double share) {
    return share < 1.0 ? twist.scale(share) : twist;
  }

  std::string within() const {
    std::ostringstream text;
    text << "within " << options_.max_age << " s";
    return text.str();
  }

  void check_age(Time age, const std::string& name) const {
    if (std::abs(age) > to_time(options_.max_age))
      throw std::runtime_error("the stamp of " + name + " is not " + within() + " of the clock");
  }

  static Placement normalise(Placement placement, const std::string& frame) {
    double square = 0.0;
    for (const double part : placement.turn) square += part * part;
    const double way = std::hypot(placement.at.x, placement.at.y, placement.at.z);
    if (!(way <= MAX_WAY) || !(std::abs(square - 1.0) <= NORM_SLACK))
      throw std::runtime_error("the transform of " + frame + " is none");
    for (double& part : placement.turn) part /= std::sqrt(square);
    return placement;
  }

  /// Place the newest scan of a source whose place is known; those before it are gone.
  void place_scans(const std::string& name, Source& source, Time now, Time clock, const LookUp& look_up) {
    for (std::size_t k = source.waiting.size(); k-- > 0;) {
      const Scan& scan = source.waiting[k];
      check_age(clock - scan.stamp, name);
      const auto first = look_up(options_.odom_frame, scan.frame, scan.stamp);
      const auto last = look_up(options_.odom_frame, scan.frame, scan.stamp + scan.sweep);
      const auto base = look_up(options_.odom_frame, options_.base_frame, scan.stamp);
      if (!first || !last || !base) continue;
      source.points = place_points(name, scan, normalise(*first, scan.frame), normalise(*last, scan.frame), base->at.z);
      source.heard = now - std::max<Time>(clock - scan.stamp, 0);
      source.waiting.erase(source.waiting.begin(), source.waiting.begin() + static_cast<std::ptrdiff_t>(k) + 1);
      return;
    }
  }

  /// Return the points of a scan that are neither floor nor above the robot, in the odometry's frame.
  std::vector<Spot> place_points(const std::string& name, const Scan& scan, const Placement& first, const Placement& last,
                                 double floor) const {
    const auto is_between = [&](double z) { return z - floor >= options_.min_height && z - floor <= options_.max_height; };
    if (scan.is_flat && !is_between(first.at.z))
      throw std::runtime_error("the laser of '" + name + "' is not between min_height and max_height");
    std::vector<Spot> points;
    for (const auto& [seen, share] : scan.points) {
      // The sensor moves on during the sweep.
      const Spot a = first.place(seen), b = last.place(seen);
      const Spot placed{a.x + share * (b.x - a.x), a.y + share * (b.y - a.y), a.z + share * (b.z - a.z)};
      if (is_between(placed.z)) points.push_back(placed);
    }
    return points;
  }

  /// Return where a frame is in the map.
  Placement find(const std::string& frame, Time stamp, const LookUp& look_up) const {
    const auto found = look_up(options_.map_frame, frame, stamp);
    if (!found) throw std::runtime_error("tf does not know where " + frame + " is in " + options_.map_frame);
    return normalise(*found, frame);
  }

  Pose read_pose(const Placement& placement) const {
    const auto [x, y, z, w] = placement.turn;
    if (!(std::hypot(x, y) <= std::sin(0.5 * options_.max_tilt))) throw std::runtime_error("the robot is tilted");
    return {placement.at.x, placement.at.y, std::atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)};
  }

  /// Remember a pose; throw for a while after it was not where the commands lead from the last one.
  void check_jump(const Pose& pose, Time seen, Time now) {
    if (last_) {
      const Pose expected = move(*last_, last_seen_, seen);
      const double way = std::hypot(pose.x - expected.x, pose.y - expected.y);
      const double angle = std::abs(std::remainder(pose.yaw - expected.yaw, cspace::detail::TWO_PI));
      if (std::max(way, angle) > options_.max_jump) jumped_ = now;
    }
    last_ = pose;
    last_seen_ = seen;
    if (now - jumped_ <= to_time(options_.max_age)) throw std::runtime_error("the pose jumped");
  }

  /// Return where the commands lead from a pose between two times.
  Pose move(Pose pose, Time from, Time to) const {
    for (std::size_t k = 0; k < driven_.size(); ++k) {
      const Time begin = std::max(driven_[k].begin, from);
      const Time end = k + 1 < driven_.size() ? std::min(driven_[k + 1].begin, to) : to;
      if (begin >= end) continue;
      const auto [v, omega, side] = driven_[k].twist;
      const double seconds = to_seconds(end - begin), half = 0.5 * omega * seconds;
      const double ratio = half == 0.0 ? 1.0 : std::sin(half) / half;
      const cspace::Point way = cspace::detail::turn({v * seconds * ratio, side * seconds * ratio}, pose.yaw + half);
      pose.x += way.x;
      pose.y += way.y;
      pose.yaw += omega * seconds;
    }
    return pose;
  }

  FindGround find_ground_;
  WatchOptions options_;
  cspace::Twist wanted_{};
  Time command_heard_ = NEVER, cycle_ = NEVER, jumped_ = NEVER, last_seen_ = NEVER;
  std::string command_fault_;
  std::map<std::string, Source> sources_;
  std::vector<cspace::Twist> ramp_ = {{0.0, 0.0}};  ///< what it drives now, then the proven way to rest
  std::deque<Driven> driven_;                       ///< the last commands
  std::optional<Pose> last_;
};

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_WATCH_HPP
