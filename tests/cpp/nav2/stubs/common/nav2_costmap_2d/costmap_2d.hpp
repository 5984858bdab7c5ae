// Stub of nav2_costmap_2d/costmap_2d.hpp.
#ifndef NAV2_COSTMAP_2D_STUB_HPP
#define NAV2_COSTMAP_2D_STUB_HPP

#include <cstddef>
#include <mutex>
#include <vector>

namespace nav2_costmap_2d {
class Costmap2D {
 public:
  using mutex_t = std::recursive_mutex;

  Costmap2D(unsigned int cells_size_x, unsigned int cells_size_y, double resolution, double origin_x, double origin_y,
            unsigned char default_value = 0)
      : columns_(cells_size_x), rows_(cells_size_y), resolution_(resolution), x_(origin_x), y_(origin_y),
        costs_(std::size_t{cells_size_x} * cells_size_y, default_value) {}
  Costmap2D(const Costmap2D& map)
      : columns_(map.columns_), rows_(map.rows_), resolution_(map.resolution_), x_(map.x_), y_(map.y_), costs_(map.costs_) {}

  unsigned int getSizeInCellsX() const { return columns_; }
  unsigned int getSizeInCellsY() const { return rows_; }
  double getResolution() const { return resolution_; }
  double getOriginX() const { return x_; }
  double getOriginY() const { return y_; }
  unsigned char getCost(unsigned int mx, unsigned int my) const { return costs_[std::size_t{my} * columns_ + mx]; }
  unsigned char* getCharMap() { return costs_.data(); }
  void setCost(unsigned int mx, unsigned int my, unsigned char cost) { costs_[std::size_t{my} * columns_ + mx] = cost; }
  bool worldToMap(double wx, double wy, unsigned int& mx, unsigned int& my) const {
    if (wx < x_ || wy < y_) return false;
    mx = static_cast<unsigned int>((wx - x_) / resolution_);
    my = static_cast<unsigned int>((wy - y_) / resolution_);
    return mx < columns_ && my < rows_;
  }
  void resizeMap(unsigned int size_x, unsigned int size_y, double resolution, double origin_x, double origin_y) {
    columns_ = size_x;
    rows_ = size_y;
    resolution_ = resolution;
    x_ = origin_x;
    y_ = origin_y;
    costs_.assign(std::size_t{size_x} * size_y, 0);
  }
  mutex_t* getMutex() { return &mutex_; }

 private:
  unsigned int columns_, rows_;
  double resolution_, x_, y_;
  std::vector<unsigned char> costs_;
  mutex_t mutex_;
};
}  // namespace nav2_costmap_2d

#endif
