// Answers of the C++ header for tests, which compare them with Python's.
//
//   answers query MAP QUERIES ANSWERS [unchecked]   rows of two configurations: states of the first, motions, clearances
//   answers prefix MAP ROWS N TRACKING...           proven rows of chunks of N rows, a line a chunk
//   answers slow MAP ROWS LEAVING CORES DT V OMEGA TRACKING... RADIUS
//                                                   shares, proofs and commands of slowed twists, a line each;
//                                                   cores of a robot are "radius x y x y ...;radius x y ...", or "map"
//                                                   for those of the map
//   answers drive MAP LEAVING CORES DT V OMEGA TRACKING... RADIUS
//                                                   the same of lines of a pose, two twists with sides and points from the input
//   answers cycles MAP ROWS CORES DT V OMEGA TRACKING... RADIUS
//                                                   microseconds of CPU time a cycle that leaves, without points and with 360
//   answers robot MAP                               frame of a map; then the parts of its robot, a line each: radius and corners
//   answers open MAP...                             one line a map: "opened", or the text of the error
//   answers time MAP QUERIES                        nanoseconds of CPU time a state at random, a state in cache, and a motion
#include <ctime>
#include <fstream>
#include <iostream>
#include <iterator>
#include <thread>

#include <cspace/gate.hpp>

namespace {

std::vector<double> read_numbers(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  std::vector<double> numbers(bytes.size() / sizeof(double));
  std::memcpy(numbers.data(), bytes.data(), numbers.size() * sizeof(double));
  return numbers;
}

/// Answer rows [begin, end) of queries.
void answer(const cspace::Map& map, const std::vector<double>& rows, std::size_t begin, std::size_t end, char* states,
            char* motions, double* clearances) {
  const std::size_t size = map.size();
  for (std::size_t k = begin; k < end; ++k) {
    const double* q0 = &rows[2 * size * k];
    const double* q1 = q0 + size;
    if (!map.is_usable(q0) || !map.is_usable(q1)) {
      states[k] = motions[k] = 9;
      continue;
    }
    states[k] = static_cast<char>(map.state(q0));
    motions[k] = map.motion_is_free(q0, q1);
    if (map.has_clearance()) clearances[k] = map.clearance(q0);
  }
}

void query(const cspace::Map& map, const std::vector<double>& rows, const std::string& answers) {
  const std::size_t n = rows.size() / (2 * map.size());
  std::vector<char> states(n), motions(n);
  std::vector<double> clearances(n);
  // Two threads share the map.
  std::thread other([&] { answer(map, rows, n / 2, n, states.data(), motions.data(), clearances.data()); });
  answer(map, rows, 0, n / 2, states.data(), motions.data(), clearances.data());
  other.join();
  std::ofstream file(answers, std::ios::binary);
  file.write(states.data(), static_cast<std::streamsize>(n)).write(motions.data(), static_cast<std::streamsize>(n));
  file.write(reinterpret_cast<const char*>(clearances.data()), static_cast<std::streamsize>(n * sizeof(double)));
}

/// Print how many rows of each chunk of `n` rows are proven, or the text of an error.
void count_proven(const cspace::Map& map, const std::vector<double>& rows, std::size_t n,
                  const std::vector<std::string>& numbers) {
  std::vector<double> tracking;
  for (const std::string& number : numbers) tracking.push_back(std::stod(number));
  try {
    for (std::size_t k = 0; k < rows.size(); k += n * map.size())
      std::cout << map.proven_prefix(&rows[k], n, tracking) << "\n";
  } catch (const cspace::InputError& error) {
    std::cout << error.what() << "\n";
  }
}

/// Make a gate of texts: cores, seconds, brakes, tracking, and the radius of points.
cspace::Gate make_gate(const std::string& path, const std::vector<std::string>& words) {
  const auto map = std::make_shared<const cspace::Map>(cspace::Map::open(path));
  std::vector<cspace::Core> robot;
  if (words[0] == "map") robot = cspace::read_robot(*map);
  std::istringstream parts(robot.empty() ? words[0] : "");
  for (std::string part; std::getline(parts, part, ';');) {
    std::istringstream numbers(part);
    robot.emplace_back();
    numbers >> robot.back().radius;
    for (cspace::Point corner; numbers >> corner.x >> corner.y;) robot.back().corners.push_back(corner);
  }
  std::vector<double> n;
  for (auto word = words.begin() + 1; word != words.end(); ++word) n.push_back(std::stod(*word));
  const cspace::GateOptions options{n[0], {n[1], n[2]}, {n[3], n[4], n[5]}, n[6]};
  return cspace::Gate(map, robot, options);
}

void print_robot(const cspace::Map& map) {
  std::cout << map.frame_id() << "\n";
  try {
    for (const cspace::Core& core : cspace::read_robot(map)) {
      std::cout << core.radius;
      for (const cspace::Point& corner : core.corners) std::cout << " " << corner.x << " " << corner.y;
      std::cout << "\n";
    }
  } catch (const cspace::InputError& error) {
    std::cout << error.what() << "\n";
  }
}

/// Print what a gate lets through of a twist, beside that of now and points.
void slow_down(const cspace::Gate& gate, const double* q, const cspace::Twist& wanted, const cspace::Twist& now,
               const std::vector<cspace::Point>& points, bool leaving) {
  try {
    const cspace::SlowedCommand slowed = gate.slow_down(q, wanted, now, points, leaving);
    std::cout << slowed.share << " " << slowed.is_proven << " " << slowed.leaves;
    for (const cspace::Twist& twist : slowed.commands) std::cout << " " << twist.v << " " << twist.omega << " " << twist.side;
    std::cout << std::endl;
  } catch (const cspace::InputError& error) {
    std::cout << error.what() << std::endl;
  }
}

double nanoseconds(std::clock_t start, std::size_t n) {
  const double spent = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  return 1e9 * spent / static_cast<double>(n);
}

/// Time the cycles of a gate, without points and with those of a scan of 360 rays.
void time_cycles(const cspace::Gate& gate, const std::vector<double>& rows) {
  for (const int rays : {0, 360}) {
    const auto start = std::clock();
    for (std::size_t k = 0; k + 7 <= rows.size(); k += 7) {
      const double* row = &rows[k];
      std::vector<cspace::Point> points;
      for (int ray = 0; ray < rays; ++ray) {
        const double angle = 2.0 * M_PI * ray / rays, range = 0.3 + 3.0 * std::fmod(0.618 * ray, 1.0);
        points.push_back({row[0] + range * std::cos(angle), row[1] + range * std::sin(angle)});
      }
      gate.slow_down(row, {row[3], row[4]}, {row[5], row[6]}, points, true);
    }
    std::cout << 1e-3 * nanoseconds(start, rows.size() / 7) << " ";
  }
  std::cout << "\n";
}

/// Answer lines of numbers as they come.
void drive(const cspace::Gate& gate, bool leaving) {
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream numbers(line);
    double row[9];
    for (double& number : row) numbers >> number;
    std::vector<cspace::Point> points;
    for (cspace::Point point; numbers >> point.x >> point.y;) points.push_back(point);
    slow_down(gate, row, {row[3], row[4], row[5]}, {row[6], row[7], row[8]}, points, leaving);
  }
}

/// Open a map with and without its digest, and query it around its grid.
std::string open(const std::string& path) {
  std::string text;
  for (const bool check_digest : {true, false}) {
    try {
      const cspace::Map map = cspace::Map::open(path, check_digest);
      if (check_digest) text = "opened";
      std::vector<double> q0(map.size(), 0.0), q1(map.size(), 0.0);
      q0.back() = q1.back() = 1.0;
      for (std::size_t k = 0; k < 500; ++k) {
        for (std::size_t axis = 0; axis < map.dim(); ++axis) {
          const double width = map.upper()[axis] - map.lower()[axis];
          q0[axis] = q1[axis];
          q1[axis] = map.lower()[axis] + width * (1.4 * std::fmod(0.618 * static_cast<double>(k * (axis + 1)), 1.0) - 0.2);
        }
        if (map.state(q0) == cspace::FREE && map.has_clearance()) map.clearance(q0);
        map.motion_is_free(q0, q1);
      }
    } catch (const cspace::FileError& error) {
      if (check_digest) text = error.what();
    }
  }
  return text;
}

/// Time the states of the first configurations in their order, then 32 of them again and again, then the motions.
void time(const cspace::Map& map, const std::vector<double>& rows) {
  const std::size_t size = map.size(), n = rows.size() / (2 * size);
  std::size_t sum = 0;
  auto start = std::clock();
  for (std::size_t k = 0; k < n; ++k) sum += map.state(&rows[2 * size * k]);
  const double at_random = nanoseconds(start, n);
  start = std::clock();
  for (std::size_t k = 0; k < n; ++k) sum += map.state(&rows[2 * size * (k & 31)]);
  const double in_cache = nanoseconds(start, n);
  start = std::clock();
  for (std::size_t k = 0; k < n; ++k) sum += map.motion_is_free(&rows[2 * size * k], &rows[2 * size * k + size]);
  std::cout << at_random << " " << in_cache << " " << nanoseconds(start, n) << " " << sum << "\n";
}

}  // namespace

int main(int count, char** arguments) {
  const std::vector<std::string> words(arguments + 1, arguments + count);
  if (words.size() >= 4 && words[0] == "query")
    query(cspace::Map::open(words[1], words.size() == 4), read_numbers(words[2]), words[3]);
  else if (words.size() >= 4 && words[0] == "prefix")
    count_proven(cspace::Map::open(words[1]), read_numbers(words[2]), std::stoul(words[3]),
                 {words.begin() + 4, words.end()});
  else if (words.size() == 12 && words[0] == "slow") {
    try {
      const cspace::Gate gate = make_gate(words[1], {words.begin() + 4, words.end()});
      const std::vector<double> rows = read_numbers(words[2]);
      std::cout.precision(17);
      for (auto row = rows.data(); row + 7 <= rows.data() + rows.size(); row += 7)
        slow_down(gate, row, {row[3], row[4]}, {row[5], row[6]}, {}, words[3] == "1");
    } catch (const cspace::InputError& error) {
      std::cout << error.what() << "\n";
    }
  } else if (words.size() == 11 && words[0] == "cycles") {
    time_cycles(make_gate(words[1], {words.begin() + 3, words.end()}), read_numbers(words[2]));
  } else if (words.size() == 11 && words[0] == "drive") {
    std::cout.precision(17);
    drive(make_gate(words[1], {words.begin() + 3, words.end()}), words[2] == "1");
  }
  else if (words.size() == 2 && words[0] == "robot") {
    std::cout.precision(17);
    print_robot(cspace::Map::open(words[1]));
  } else if (words.size() == 3 && words[0] == "time")
    time(cspace::Map::open(words[1]), read_numbers(words[2]));
  else if (words.size() >= 2 && words[0] == "open")
    for (std::size_t k = 1; k < words.size(); ++k) std::cout << open(words[k]) << "\n";
  else
    return 1;
}
