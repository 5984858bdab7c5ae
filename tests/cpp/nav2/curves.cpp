// Curves of cars: curves DRIVE RADIUS PAIRS ANSWERS, with pairs of poses as rows of six numbers. It writes a row of numbers for
// each pair: the lengths of five arcs, zeros included, and their angles.
#include <fstream>
#include <iostream>

#include "cspace_nav2/drives.hpp"

int main(int, char** arguments) {
  const cspace_nav2::Drive drive(arguments[1], std::stod(arguments[2]));
  std::ifstream pairs(arguments[3], std::ios::binary);
  std::ofstream answers(arguments[4], std::ios::binary);
  try {
    for (std::array<cspace_nav2::Configuration, 2> ends; pairs.read(reinterpret_cast<char*>(&ends), sizeof ends);) {
      std::array<double, 10> row{};
      std::size_t k = 0;
      for (const cspace_nav2::Arc& arc : drive.curve(ends[0], ends[1])) {
        row[k] = arc.length;
        row[5 + k++] = arc.angle;
      }
      answers.write(reinterpret_cast<const char*>(&row), sizeof row);
    }
  } catch (const std::exception& error) {
    std::cerr << error.what();
    return 1;
  }
}
