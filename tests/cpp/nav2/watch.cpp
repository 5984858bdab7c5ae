// A watch of a gate in a process, which answers lines of its input and asks for places; its times are nanoseconds.
//
//   watch MAP DT V OMEGA TRACKING... RADIUS SOURCES   starts it; sources are "scan,cloud"; MAP may be "none"
//
//   watch MAP footprint PARTS...                      prints the parts of the robot, or why they are refused
//
//   new                                        forgets all
//   command NOW V OMEGA [SIDE]
//   scan NAME FRAME STAMP ANGLE STEP LEAST MOST SECONDS RANGES...   SECONDS from a ray to the next one
//   cloud NAME FRAME STAMP NUMBERS...          x, y and z of points
//   bytes NAME FRAME STAMP HEIGHT WIDTH STEP ROW LENGTH  a cloud of zeros, which may contradict itself
//         [BIG FIELD OFFSET TYPE ...]          or of other bytes, big-endian or not, with fields
//   decide NOW CLOCK                           prints "look TARGET FRAME STAMP" as often as it asks, and reads a place, "later"
//                                              or "never FRAME"; then prints V, OMEGA, SIDE, microseconds and the reason
#include <ctime>
#include <iostream>

#include "cspace_nav2/footprint.hpp"
#include "cspace_nav2/scans.hpp"

namespace {

using cspace_nav2::Placement;
using cspace_nav2::Time;
using sensor_msgs::msg::PointField;

std::vector<std::string> split(const std::string& text, char at) {
  std::vector<std::string> words;
  std::istringstream stream(text);
  for (std::string word; std::getline(stream, word, at);) words.push_back(word);
  return words;
}

std::optional<Placement> ask(const std::string& target, const std::string& frame, Time stamp) {
  std::cout << "look " << target << " " << frame << " " << stamp << std::endl;
  std::string line;
  std::getline(std::cin, line);
  if (line == "later") return std::nullopt;
  if (line.rfind("never ", 0) == 0) throw std::runtime_error("tf has no frame " + line.substr(6));
  const std::vector<std::string> words = split(line, ' ');
  std::vector<double> n;
  for (std::size_t k = 0; k < 7; ++k) n.push_back(std::stod(words[k]));
  return Placement{{n[0], n[1], n[2]}, {n[3], n[4], n[5], n[6]}, std::stoll(words[7])};
}

std::int32_t seconds_of(Time time) { return static_cast<std::int32_t>(time / 1000000000); }

std_msgs::msg::Header write_header(const std::vector<std::string>& words) {
  const Time stamp = std::stoll(words[3]);
  std_msgs::msg::Header header;
  header.frame_id = words[2];
  header.stamp.sec = seconds_of(stamp);
  header.stamp.nanosec = static_cast<std::uint32_t>(stamp - 1000000000 * Time{header.stamp.sec});
  return header;
}

sensor_msgs::msg::PointCloud2 write_cloud(const std::vector<std::string>& words, std::uint8_t type, std::uint32_t size) {
  sensor_msgs::msg::PointCloud2 msg;
  msg.header = write_header(words);
  for (std::uint32_t axis = 0; axis < 3; ++axis) {
    msg.fields.emplace_back();
    msg.fields.back().name = std::string(1, "xyz"[axis]);
    msg.fields.back().offset = axis * size;
    msg.fields.back().datatype = type;
  }
  msg.point_step = 3 * size;
  return msg;
}

class Session {
 public:
  Session(std::shared_ptr<const cspace::Gate> gate, const cspace_nav2::WatchOptions& options)
      : gate_(std::move(gate)), options_(options), watch_(make_watch()) {}

  void answer(const std::string& line) {
    const std::vector<std::string> words = split(line, ' ');
    if (words[0] == "new") watch_ = make_watch();
    if (words[0] == "command")
      watch_.hear_command({std::stod(words[2]), std::stod(words[3]), words.size() > 4 ? std::stod(words[4]) : 0.0},
                          std::stoll(words[1]));
    if (words[0] == "decide") decide(std::stoll(words[1]), std::stoll(words[2]));
    try {
      if (words[0] == "scan") hear_scan(words);
      if (words[0] == "cloud") hear_cloud(words);
      if (words[0] == "bytes") hear_bytes(words);
    } catch (const std::exception& error) {
      watch_.refuse_scan(words[1], error.what());
    }
  }

 private:
  cspace_nav2::Watch make_watch() const {
    const auto find_ground = [gate = gate_] {
      if (!gate) throw std::runtime_error("there is no map");
      return cspace_nav2::Ground{gate};
    };
    return {find_ground, options_};
  }

  void decide(Time now, Time clock) {
    const auto start = std::clock();
    const cspace_nav2::Decision decision = watch_.decide(now, clock, ask);
    const double spent = 1e6 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
    const auto [v, omega, side] = decision.command;
    std::cout << v << " " << omega << " " << side << " " << spent << " " << decision.reason << std::endl;
  }

  void hear_scan(const std::vector<std::string>& words) {
    sensor_msgs::msg::LaserScan msg;
    msg.header = write_header(words);
    msg.angle_min = std::stof(words[4]);
    msg.angle_increment = std::stof(words[5]);
    msg.range_min = std::stof(words[6]);
    msg.range_max = std::stof(words[7]);
    msg.time_increment = std::stof(words[8]);
    for (std::size_t k = 9; k < words.size(); ++k) msg.ranges.push_back(std::stof(words[k]));
    watch_.hear_scan(words[1], cspace_nav2::read_scan(msg));
  }

  void hear_cloud(const std::vector<std::string>& words) {
    auto msg = write_cloud(words, PointField::FLOAT64, 8);
    msg.height = 1;
    for (std::size_t k = 4; k < words.size(); ++k) {
      const double number = std::stod(words[k]);
      const auto* bytes = reinterpret_cast<const std::uint8_t*>(&number);
      msg.data.insert(msg.data.end(), bytes, bytes + sizeof number);
    }
    msg.row_step = static_cast<std::uint32_t>(msg.data.size());
    msg.width = msg.row_step / msg.point_step;
    watch_.hear_scan(words[1], cspace_nav2::read_cloud(msg));
  }

  void hear_bytes(const std::vector<std::string>& words) {
    auto msg = write_cloud(words, PointField::FLOAT32, 4);
    std::vector<std::uint32_t> n;
    for (std::size_t k = 4; k < 9; ++k) n.push_back(static_cast<std::uint32_t>(std::stoul(words[k])));
    msg.height = n[0];
    msg.width = n[1];
    msg.point_step = n[2];
    msg.row_step = n[3];
    msg.data.resize(n[4]);
    if (words.size() > 9) {
      msg.is_bigendian = words[9] == "1";
      msg.fields.clear();
      for (std::size_t k = 0; k < msg.data.size(); ++k) msg.data[k] = static_cast<std::uint8_t>(37 * k * k + n[4]);
    }
    for (std::size_t k = 10; k + 2 < words.size(); k += 3) {
      msg.fields.emplace_back();
      msg.fields.back().name = words[k];
      msg.fields.back().offset = static_cast<std::uint32_t>(std::stoul(words[k + 1]));
      msg.fields.back().datatype = static_cast<std::uint8_t>(std::stoul(words[k + 2]));
    }
    watch_.hear_scan(words[1], cspace_nav2::read_cloud(msg));
  }

  std::shared_ptr<const cspace::Gate> gate_;
  cspace_nav2::WatchOptions options_;
  cspace_nav2::Watch watch_;
};

void print_footprint(const std::string& path, const std::vector<std::string>& texts) {
  try {
    const cspace::Map map = cspace::Map::open(path);
    std::cout << cspace_nav2::read_footprint(map, texts).size() << " parts\n";
  } catch (const cspace::InputError& error) {
    std::cout << error.what() << "\n";
  }
}

}  // namespace

int main(int count, char** arguments) {
  if (count > 2 && std::string(arguments[2]) == "footprint") {
    print_footprint(arguments[1], {arguments + 3, arguments + count});
    return 0;
  }
  std::vector<double> n;
  for (int k = 2; k < 9; ++k) n.push_back(std::stod(arguments[k]));
  std::shared_ptr<const cspace::Gate> gate;
  std::cout.precision(17);
  if (const std::string path = arguments[1]; path != "none") {
    const auto map = std::make_shared<const cspace::Map>(cspace::Map::open(path));
    const cspace::GateOptions options{n[0], {n[1], n[2]}, {n[3], n[4], n[5]}, n[6]};
    gate = std::make_shared<const cspace::Gate>(map, cspace::read_robot(*map), options);
  }
  cspace_nav2::WatchOptions options;
  options.max_velocity = {5.0, 5.0};
  options.sources = split(arguments[9], ',');
  Session session(gate, options);
  for (std::string line; std::getline(std::cin, line);) session.answer(line);
}
