/// @file map_maker.hpp
/// Maps of occupancy grids: the command `cspace build` makes each once, in a thread, and a folder keeps it.
#ifndef CSPACE_NAV2_MAP_MAKER_HPP
#define CSPACE_NAV2_MAP_MAKER_HPP

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iomanip>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <cspace/gate.hpp>
#include <nav_msgs/msg/occupancy_grid.hpp>
#include <rclcpp/rclcpp.hpp>

#include "cspace_nav2/parameters.hpp"
#include "cspace_nav2/poses.hpp"

extern char** environ;

namespace cspace_nav2 {

/// Return the folder in which maps are kept unless a parameter names another one; empty if the user has no home.
inline std::string default_folder() {
  const char* cache = std::getenv("XDG_CACHE_HOME");
  if (cache != nullptr && *cache == '/') return std::string(cache) + "/cspace_nav2";
  const char* home = std::getenv("HOME");
  return home != nullptr && *home == '/' ? std::string(home) + "/.cache/cspace_nav2" : "";
}

/// Return true if a folder is a kept map, or the part of one that a build has written: its name has 16 hexadecimal digits, and
/// that of a part also ends in ".part"; it holds all files of a map, a part holds some, and neither holds anything else.
inline bool is_map_folder(const std::filesystem::path& folder, bool is_part) {
  namespace fs = std::filesystem;
  const std::string name = folder.filename();
  const std::size_t digits = std::min(name.find_first_not_of("0123456789abcdef"), name.size());
  const std::string rest = name.substr(digits);
  const bool ends_in_part = rest.size() > 5 && rest.front() == '.' && rest.substr(rest.size() - 5) == ".part";
  if (digits != 16 || !(is_part ? ends_in_part : rest.empty())) return false;
  std::error_code error;
  if (fs::symlink_status(folder, error).type() != fs::file_type::directory) return false;
  const std::set<std::string> needed = {"map.pgm", "map.yaml", "robot", "options"}, others = {"log", "map.zarr"};
  std::size_t found = 0;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string file = entry.path().filename();
    const bool is_unfinished = is_part && file.rfind(".cspace-", 0) == 0;  // a map that the command was writing
    if (needed.count(file) + others.count(file) == 0 && !is_unfinished) return false;
    found += needed.count(file);
  }
  return !error && (is_part || found == needed.size());
}

/// A new folder for a build. It is removed with this object, and locked while that lives: a lock ends with its process.
class Part {
 public:
  /// @param kept  folder that the map will have
  explicit Part(const std::string& kept) {
    for (int number = 0;; ++number) {
      path_ = kept + "." + std::to_string(number) + ".part";
      if (!std::filesystem::create_directory(path_)) continue;
      folder_ = ::open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
      // Another process that finds the folder before it is locked removes it. Some disks have no locks, and keep all parts.
      const bool is_taken = ::flock(folder_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
      if (!is_taken && std::filesystem::exists(path_)) return;
      ::close(folder_);
    }
  }
  ~Part() {
    std::error_code error;
    std::filesystem::remove_all(path_, error);
    ::close(folder_);
  }
  Part(const Part&) = delete;
  Part& operator=(const Part&) = delete;

  const std::string& path() const { return path_; }

  void rename(const std::string& kept) {
    std::filesystem::rename(path_, kept);
    path_.clear();
  }

 private:
  std::string path_;
  int folder_ = -1;
};

/// What a map is made of, besides the grid.
struct Recipe {
  std::string topic;                ///< of grids
  std::string builder = "cspace";   ///< the command of the library
  std::string folder;               ///< that keeps maps
  std::string frame;                ///< that grids must have
  std::int64_t rotations = 72;      ///< cells of yaw
  bool unknown_is_free = false;     ///< else unknown cells are obstacles
  std::function<std::string()> robot;  ///< returns the robot in words of `cspace build --robot`
};

/// A map of the robot as it is now, of the newest grid or of one before.
struct KnownMap {
  std::shared_ptr<const cspace::Map> map;
  /// Centers of cells that may be taken since, where the map proves nothing.
  std::shared_ptr<const std::vector<cspace::Point>> changed;
};

/// Follows a topic of grids with maps. A build ends before that of the newest grid begins.
class MapMaker {
 public:
  /// Takes what happens, and whether it is a fault.
  using Log = std::function<void(const std::string&, bool)>;

  MapMaker(const Recipe& recipe, const Log& log) : recipe_(recipe), log_(log), worker_([this] { work(); }) {}

  /// End a build that runs, and wait for it.
  ~MapMaker() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      has_ended_ = true;
    }
    news_.notify_all();
    worker_.join();
  }

  MapMaker(const MapMaker&) = delete;
  MapMaker& operator=(const MapMaker&) = delete;

  std::shared_ptr<void> subscription;  ///< that calls `take`

  /// Take a grid; the same one again changes nothing.
  void take(const nav_msgs::msg::OccupancyGrid& grid) {
    const std::lock_guard<std::mutex> lock(mutex_);
    grid_ = std::make_shared<const nav_msgs::msg::OccupancyGrid>(grid);
    order();
  }

  /// Return the map of the newest grid and the robot as it is now.
  /// @throws std::runtime_error that says why there is none yet
  std::shared_ptr<const cspace::Map> map() {
    const std::lock_guard<std::mutex> lock(mutex_);
    follow_robot();
    if (!known_.map || !(wanted_ == made_)) throw std::runtime_error(problem_);
    return known_.map;
  }

  /// Return the map of the newest grid, or while that is built the one before, for the robot as it is now.
  /// @throws std::runtime_error that says why there is none
  KnownMap known_map() {
    const std::lock_guard<std::mutex> lock(mutex_);
    follow_robot();
    if (!known_.map) throw std::runtime_error(problem_);
    return known_;
  }

 private:
  using Grid = nav_msgs::msg::OccupancyGrid;
  static constexpr std::size_t MAX_KEPT = 8;       ///< maps in the folder
  static constexpr double MAX_OFFSET = 1e-3;       ///< between the corners of cells of two grids, cells
  static constexpr double MAX_SHIFT = 1e9;         ///< between two grids, cells
  static constexpr const char* BUILDING = "the map is being built";

  /// The input of a build, as files.
  struct Order {
    std::string image, header, robot, options;
    bool operator==(const Order& other) const {
      return image == other.image && header == other.header && robot == other.robot && options == other.options;
    }
  };

  /// Want another map if the robot has changed; hold the lock.
  void follow_robot() {
    if (grid_ && recipe_.robot() != wanted_.robot) order();
  }

  /// Want the map of the grid; hold the lock.
  void order() {
    try {
      Order wanted = write_order();
      if (wanted == wanted_) return;
      wanted_ = std::move(wanted);
      if (problem_ != BUILDING) log_(std::string(known_.map ? "a new map came" : "a map came") + " and is being built", false);
      problem_ = BUILDING;
    } catch (const std::exception& error) {
      if (problem_ != error.what()) log_(error.what(), true);
      wanted_ = {};
      problem_ = error.what();
    }
    compare();
    ++number_;
    news_.notify_all();
  }

  /// List what the newest grid has taken since the map; forget the map if it is for another robot, or cannot be compared.
  void compare() {
    if (!known_.map) return;
    known_.changed = wanted_.robot == made_.robot && wanted_.options == made_.options ? list_changed() : nullptr;
    if (!known_.changed) known_.map = nullptr;
  }

  /// Return the centers of cells of the map's grid that may be taken now; null if the cells of both grids differ.
  ///
  /// Outside of its own grid, the map proves nothing free; nor does the next one, whose grid may have left the robot.
  std::shared_ptr<const std::vector<cspace::Point>> list_changed() const {
    const auto &now = grid_->info, &before = made_grid_->info;
    const auto &from = before.origin.position, &to = now.origin.position;
    const double yaw = yaw_of(now.origin), side = now.resolution, cosine = std::cos(yaw), sine = std::sin(yaw);
    if (now.resolution != before.resolution || yaw != yaw_of(before.origin)) return nullptr;
    const double x = from.x - to.x, y = from.y - to.y;
    const double columns = (x * cosine + y * sine) / side, rows = (y * cosine - x * sine) / side;
    const double right = std::round(columns), up = std::round(rows);
    if (!(std::hypot(columns - right, rows - up) < MAX_OFFSET && std::hypot(right, up) < MAX_SHIFT)) return nullptr;
    const auto changed = std::make_shared<std::vector<cspace::Point>>();
    for (std::int64_t row = 0; row < before.height; ++row) {
      for (std::int64_t column = 0; column < before.width; ++column) {
        const int old = made_grid_->data[row * before.width + column];
        if (is_taken(old)) continue;
        const std::int64_t i = column + static_cast<std::int64_t>(right), j = row + static_cast<std::int64_t>(up);
        if (i >= 0 && j >= 0 && i < now.width && j < now.height) {
          const int value = grid_->data[j * now.width + i];
          if (value == old || is_free(value)) continue;
        }
        const double u = (static_cast<double>(column) + 0.5) * side, v = (static_cast<double>(row) + 0.5) * side;
        changed->push_back({from.x + u * cosine - v * sine, from.y + u * sine + v * cosine});
      }
    }
    return changed;
  }

  /// Return true if an occupancy is surely free, or surely taken, by the thresholds of the header.
  bool is_free(int occupancy) const { return is_unknown(occupancy) ? recipe_.unknown_is_free : occupancy < 25; }
  bool is_taken(int occupancy) const { return is_unknown(occupancy) ? !recipe_.unknown_is_free : occupancy > 65; }
  static bool is_unknown(int occupancy) { return occupancy < 0 || occupancy > 100; }

  /// Return the grid as a ROS map of occupancies in per cent, its top row first.
  /// @throws std::runtime_error if it is in another frame, tilted or without cells
  Order write_order() const {
    const auto& info = grid_->info;
    if (grid_->header.frame_id != recipe_.frame)
      throw std::runtime_error("the map is in '" + grid_->header.frame_id + "', not in '" + recipe_.frame + "'");
    try {
      check_level(info.origin);
    } catch (const std::invalid_argument& error) {
      throw std::runtime_error(std::string("the map's origin is none: ") + error.what());
    }
    const std::size_t width = info.width, height = info.height;
    const bool is_usable = std::isfinite(info.resolution) && info.resolution > 0.0F;
    if (width == 0 || height == 0 || grid_->data.size() / width != height || grid_->data.size() % width != 0 || !is_usable)
      throw std::runtime_error("the map has " + std::to_string(width) + " x " + std::to_string(height) + " cells of " +
                               write(info.resolution) + " m, and data of " + std::to_string(grid_->data.size()));
    Order order;
    order.image = "P5\n" + std::to_string(width) + " " + std::to_string(height) + "\n255\n";
    for (std::size_t row = height; row-- > 0;)
      for (std::size_t column = 0; column < width; ++column) {
        const int occupancy = grid_->data[row * width + column];
        order.image += static_cast<char>(occupancy < 0 || occupancy > 100 ? 255 : occupancy);
      }
    std::ostringstream header;
    header << std::setprecision(17) << "image: map.pgm\nmode: raw\nresolution: " << write(info.resolution) << "\norigin: ["
           << info.origin.position.x << ", " << info.origin.position.y << ", " << yaw_of(info.origin)
           << "]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n";
    order.header = header.str();
    order.robot = recipe_.robot();
    order.options = std::to_string(recipe_.rotations) + (recipe_.unknown_is_free ? " free" : " occupied");
    return order;
  }

  /// Return the shortest decimal number that a single one stands for.
  static std::string write(float number) {
    for (int digits = 1;; ++digits) {
      std::ostringstream text;
      text << std::setprecision(digits) << number;
      if (digits == 9 || std::strtof(text.str().c_str(), nullptr) == number) return text.str();
    }
  }

  void work() {
    std::unique_lock<std::mutex> lock(mutex_);
    for (std::uint64_t done = 0;;) {
      news_.wait(lock, [&] { return has_ended_ || number_ != done; });
      if (has_ended_) return;
      done = number_;
      if (wanted_.image.empty() || (known_.map && wanted_ == made_)) continue;
      const Order order = wanted_;
      const std::shared_ptr<const Grid> grid = grid_;
      lock.unlock();
      std::shared_ptr<const cspace::Map> map;
      std::string problem;
      try {
        map = make(order);
      } catch (const std::exception& error) {
        problem = error.what();
      }
      lock.lock();
      if (has_ended_ || wanted_.robot != order.robot || wanted_.options != order.options) continue;
      made_ = order;
      made_grid_ = grid;
      known_ = {map, nullptr};
      compare();
      if (!(wanted_ == order)) continue;
      problem_ = map ? "" : "there is no map: " + problem;
      log_(map ? "the map is ready" : problem_, !map);
    }
  }

  /// Return the kept map of an order, which is built if it is not there.
  std::shared_ptr<const cspace::Map> make(const Order& order) {
    namespace fs = std::filesystem;
    const std::vector<std::pair<std::string, std::string>> files = {
        {"/map.pgm", order.image}, {"/map.yaml", order.header}, {"/robot", order.robot}, {"/options", order.options}};
    std::uint64_t digest = 0xcbf29ce484222325;  // FNV-1a
    for (const auto& [name, text] : files)
      for (const char byte : text + '\n') digest = (digest ^ static_cast<unsigned char>(byte)) * 0x100000001b3;
    std::ostringstream name;
    name << recipe_.folder << "/" << std::hex << std::setw(16) << std::setfill('0') << digest;
    const std::string kept = name.str();
    const auto is_same = [&](const auto& file) { return read(kept + file.first) == file.second; };
    const auto is_kept = [&] { return std::all_of(files.begin(), files.end(), is_same); };
    const bool was_kept = is_kept();
    if (was_kept) {
      try {
        return open_plane_map(kept + "/map.zarr");
      } catch (const std::runtime_error&) {  // of another version, or damaged
      }
    }
    const auto check_kept = [&] {
      if (fs::exists(kept) && !is_map_folder(kept, false))
        throw std::runtime_error(kept + " holds more or less than a map; only a map is replaced");
    };
    check_kept();
    fs::create_directories(recipe_.folder);
    Part folder(kept);
    const std::string part = folder.path();
    for (const auto& [file, text] : files)
      if (!(std::ofstream(part + file, std::ios::binary) << text).flush()) throw std::runtime_error("cannot write " + part + file);
    const auto middle = order.options.find(' ');
    run({recipe_.builder, "build", part + "/map.yaml", "--robot", order.robot, "--rotations", order.options.substr(0, middle),
         "--unknown", order.options.substr(middle + 1), "-o", part + "/map.zarr"},
        part + "/log", order.robot);
    if (was_kept || !is_kept()) {  // else another process was faster
      check_kept();
      fs::remove_all(kept);
      folder.rename(kept);
    }
    forget_oldest();
    return open_plane_map(kept + "/map.zarr");
  }

  /// Run a command whose output goes to a file; end it if the robot changes.
  void run(const std::vector<std::string>& words, const std::string& log, const std::string& robot) {
    std::vector<char*> arguments;
    for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
    arguments.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 1, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    posix_spawn_file_actions_adddup2(&actions, 1, 2);
    pid_t child = 0;
    const int fault = posix_spawnp(&child, arguments[0], &actions, nullptr, arguments.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    if (fault != 0) throw std::runtime_error("the command '" + words[0] + "' does not start: " + std::strerror(fault));
    int status = 0;
    while (::waitpid(child, &status, WNOHANG) == 0) {
      std::unique_lock<std::mutex> lock(mutex_);
      if (!news_.wait_for(lock, std::chrono::milliseconds(50), [&] { return has_ended_ || wanted_.robot != robot; })) continue;
      ::kill(child, SIGKILL);
      ::waitpid(child, &status, 0);
      throw std::runtime_error("the robot has changed");
    }
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) throw std::runtime_error("'" + words[0] + " build' failed: " + last_line(read(log)));
  }

  static std::string last_line(const std::string& text) {
    std::istringstream lines(text);
    std::string last;
    for (std::string line; std::getline(lines, line);)
      if (!line.empty()) last = line;
    return last;
  }

  /// Remove all but the newest maps of the folder, and what killed builds have left.
  void forget_oldest() const {
    namespace fs = std::filesystem;
    std::error_code error;  // another process may remove the same
    std::vector<std::pair<fs::file_time_type, fs::path>> maps;
    std::vector<fs::path> parts;
    for (const auto& entry : fs::directory_iterator(recipe_.folder, error)) {
      if (is_map_folder(entry.path(), false)) maps.emplace_back(fs::last_write_time(entry.path(), error), entry.path());
      if (is_map_folder(entry.path(), true)) parts.push_back(entry.path());
    }
    std::sort(maps.rbegin(), maps.rend());
    for (std::size_t k = MAX_KEPT; k < maps.size(); ++k) fs::remove_all(maps[k].second, error);
    for (const fs::path& part : parts) {
      const int folder = ::open(part.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
      if (::flock(folder, LOCK_EX | LOCK_NB) == 0) fs::remove_all(part, error);
      ::close(folder);
    }
  }

  static std::string read(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }

  const Recipe recipe_;
  const Log log_;
  std::mutex mutex_;
  std::condition_variable news_;
  std::shared_ptr<const Grid> grid_;
  Order wanted_;
  std::uint64_t number_ = 0;  ///< of orders
  KnownMap known_;
  Order made_;                            ///< of the known map
  std::shared_ptr<const Grid> made_grid_;
  std::string problem_ = "no map has come";
  bool has_ended_ = false;
  std::thread worker_;  // last, as it uses all others
};

/// Return what maps of a topic are made of, besides frame and robot.
template <typename Node>
Recipe read_recipe(Parameters<Node>& parameters) {
  Recipe recipe;
  recipe.topic = parameters.text("map_topic", "map", "grids of which maps are made");
  recipe.builder = parameters.text("builder", "cspace", "command of the library that builds maps");
  recipe.folder = parameters.text("map_folder", default_folder(), "folder that keeps maps made of map_topic");
  recipe.rotations = parameters.count("rotations", 72, 1, 1000, "cells of yaw of a map made of map_topic");
  return recipe;
}

/// Make maps of the grids of a topic, as long as the answer lives; `name` begins lines of the log.
template <typename Node>
std::shared_ptr<MapMaker> follow_topic(Node& node, const Recipe& recipe, const std::string& name) {
  if (recipe.folder.empty()) throw std::invalid_argument("the parameter 'map_folder' is empty, and there is no home");
  const auto log = [logger = node.get_logger(), name](const std::string& text, bool is_fault) {
    if (is_fault)
      RCLCPP_ERROR(logger, "%s: %s", name.c_str(), text.c_str());
    else
      RCLCPP_INFO(logger, "%s: %s", name.c_str(), text.c_str());
  };
  const auto maker = std::make_shared<MapMaker>(recipe, log);
  using Grid = nav_msgs::msg::OccupancyGrid;
  const auto take = [kept = std::weak_ptr<MapMaker>(maker)](std::shared_ptr<const Grid> grid) {
    if (const auto living = kept.lock()) living->take(*grid);
  };
  maker->subscription = rclcpp::create_subscription<Grid>(node, recipe.topic, rclcpp::QoS(1).transient_local(), take);
  return maker;
}

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_MAP_MAKER_HPP
