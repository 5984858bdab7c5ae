/// @file map.hpp
/// A saved map of a robot's configuration space, read and queried in C++17.
///
/// Python builds and saves a map (`space.save("map.zarr", compress=False)`); this header opens it on the robot:
///
///     cspace::Map map = cspace::Map::open("map.zarr");
///     map.is_free({1.0, 2.0, 0.5});                             // x, y, yaw: a proof
///     map.motion_is_free({1.0, 2.0, 0.5}, {1.5, 2.0, 0.7});     // all along the motion
///
/// FREE is proven free, BLOCKED is proven in collision, MIXED is undecided. Answers equal Python's to the last bit, because each
/// function repeats the statements of the function of the same name there (`cspace/queries`, `cspace/rotations/lookup.py`),
/// which have the proofs. The format of the files is in `docs/reference/format.md`.
///
/// Arrays saved with `compress=False` are mapped into memory, so opening is quick and processes share them. For compressed
/// arrays, and so for tiled maps, define CSPACE_ZSTD and link libzstd. The header needs nothing else, a 64-bit POSIX
/// system, and no special flags: contraction to fused multiply-adds is switched off here, and -ffast-math is refused.
#ifndef CSPACE_MAP_HPP
#define CSPACE_MAP_HPP

#if __cplusplus < 201703L
#error "cspace/map.hpp: compile as C++17 or later; after the flags of pkg-config for OMPL, which may say C++14"
#endif

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "detail/arithmetic.hpp"
#include "detail/files.hpp"

#if defined(__FP_FAST_FMA) && !defined(__clang__)
#pragma GCC push_options
#pragma GCC optimize("fp-contract=off")
#endif

namespace cspace {

/// What is proven of a configuration.
enum State : std::uint8_t { FREE = 0, MIXED = 1, BLOCKED = 2 };

/// Numbers that are no configuration of the map: not finite, or with a wrong length, a norm that is not 1, or a huge yaw.
class InputError : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};
/// A saved map of R^2, R^3, SE(2), R^3 x yaw, SE(3) or joints, in memory or in tiles.
///
/// A configuration is an array of `size()` numbers, in the order of `axes()`: metres, radians, quaternions as x, y, z, w.
/// Any number of threads may query a map at once. Its files must stay unchanged while it is open; a save with
/// `overwrite=True` replaces them by others, so that an open map keeps the old ones.
class Map {
 public:
  /// Open a map that `space.save` or `cspace.build(..., store=)` wrote.
  ///
  /// @param path          the folder
  /// @param check_digest  compare the digest and all states: reads all files, about 4 ms a megabyte. Without it,
  ///                      a raw map opens at once and is read as it is queried; a state that is none is never FREE.
  /// @throws FileError    if a file is missing or damaged, or the map is incomplete or of another version
  ///
  /// Tiles are read, and checked, when a query first needs them, and stay open; queries of such maps may throw, too.
  static Map open(const std::string& path, bool check_digest = true) {
    Map map;
    with_file(path, [&] { map.read(path, check_digest); });
    return map;
  }

  Map(Map&&) = default;
  Map& operator=(Map&&) = default;

  /// Length of a configuration.
  std::size_t size() const { return axes_.size(); }
  /// Names of the numbers of a configuration.
  const std::vector<std::string>& axes() const { return axes_; }
  /// Number of axes of the grid, 2 or 3; the numbers of a configuration after them are its rotation.
  std::size_t dim() const { return dim_; }
  /// Lower corner of the grid, `dim()` numbers.
  std::vector<double> lower() const { return {lower_.end() - static_cast<std::ptrdiff_t>(dim_), lower_.end()}; }
  /// Upper corner of the grid, `dim()` numbers.
  std::vector<double> upper() const { return {upper_.end() - static_cast<std::ptrdiff_t>(dim_), upper_.end()}; }
  /// Side of a cell.
  double spacing() const { return spacing_; }
  /// Number of cells along each axis of the grid.
  std::vector<std::int64_t> shape() const { return {cells_.end() - static_cast<std::ptrdiff_t>(dim_), cells_.end()}; }
  /// Number of rotation cells.
  std::size_t rotations() const { return slice_of_.size(); }
  /// State of the world outside the grid: "blocked", "free" or "unknown".
  const std::string& outside() const { return outside_; }
  /// Metres by which the robot was grown to prove FREE.
  double margin() const { return margin_; }
  /// True if the map was saved with `clearance=True`.
  bool has_clearance() const { return !distances_.empty(); }

  /// Return true if all numbers are finite, a yaw is at most 2^20 and the norm of a quaternion is 1 within 1e-6.
  bool is_usable(const double* q) const {
    for (std::size_t k = 0; k < dim_; ++k)
      if (!std::isfinite(q[k])) return false;
    if (kind_ == YAW) return std::abs(q[dim_]) <= detail::MAX_ANGLE;
    if (kind_ != QUATERNION) return true;
    const detail::Quaternion r = rotation_of(q);
    return std::abs(detail::dot_product(r, r) - 1.0) <= 2.0 * detail::NORM_SLACK;
  }

  /// Return the state of a configuration, inside or outside the grid.
  /// @throws InputError if it is not usable
  State state(const double* q) const {
    check_usable(q);
    return state_at(slice_of(q), position_of(q));
  }
  State state(const std::vector<double>& q) const { return state(check_size(q)); }

  /// Return true if a configuration is proven free.
  bool is_free(const double* q) const { return state(q) == FREE; }
  bool is_free(const std::vector<double>& q) const { return state(q) == FREE; }

  /// Write the states of n configurations, which follow each other.
  void classify(const double* q, std::size_t n, State* out) const {
    for (std::size_t k = 0; k < n; ++k) out[k] = state(q + k * size());
  }
  std::vector<State> classify(const std::vector<double>& q) const {
    if (q.size() % size() != 0) throw InputError("cspace: there must be " + std::to_string(size()) + " numbers a configuration");
    std::vector<State> states(q.size() / size());
    classify(q.data(), states.size(), states.data());
    return states;
  }

  /// Return true if the whole motion between two configurations is proven free.
  ///
  /// All closed cells within 2^-26 cells of it must be FREE. The position moves straight and the rotation takes the
  /// shortest arc; if two arcs are equally short up to rounding, both must be free.
  /// @throws InputError if an end is not usable
  bool motion_is_free(const double* q0, const double* q1) const {
    check_usable(q0);
    check_usable(q1);
    const detail::Row p0 = position_of(q0), p1 = position_of(q1);
    if (kind_ == QUATERNION) return quaternion_edge_is_free(p0, rotation_of(q0), p1, rotation_of(q1));
    if (state_at(slice_of(q1), p1) != FREE) return false;
    if (kind_ == FIXED) return segment_is_free(slice_of_[0], p0, p1);
    return yaw_edge_is_free(p0, q0[dim_], p1, q1[dim_]);
  }
  bool motion_is_free(const std::vector<double>& q0, const std::vector<double>& q1) const {
    return motion_is_free(check_size(q0), check_size(q1));
  }

  /// Return a lower bound of the distance, at this rotation, to the nearest position that is not FREE, in metres.
  /// @throws InputError if the configuration is not usable
  /// @throws std::logic_error if the map was saved without `clearance=True`
  double clearance(const double* q) const {
    if (!has_clearance()) throw std::logic_error("cspace: save the map with clearance=True for its clearances");
    check_usable(q);
    return clearance_at(slice_of(q), position_of(q));
  }
  double clearance(const std::vector<double>& q) const { return clearance(check_size(q)); }

 private:
  using Index = detail::Index;
  using Row = detail::Row;
  using Cell = detail::Cell;
  using Quaternion = detail::Quaternion;
  enum Kind { FIXED, YAW, QUATERNION };

  /// An open tile: the states of its cells and of a halo around them, and the first of all these cells.
  struct Tile {
    detail::Array states;
    Cell first, shape;
  };

  /// The tiles of a tiled map; the plane is one layer of tiles.
  struct Tiles {
    std::string path, stamp;
    bool check_digest;
    Cell side, halo, counts;
    std::mutex opening;
    std::unique_ptr<std::atomic<const Tile*>[]> open;
    std::vector<std::unique_ptr<const Tile>> kept;
  };

  Map() = default;

  // ---- opening -------------------------------------------------------------------------------------------------------

  /// Call a function whose errors, except those of files, are of one file.
  template <typename Function>
  static void with_file(const std::string& path, const Function& function) {
    try {
      function();
    } catch (const FileError&) {
      throw;
    } catch (const std::bad_alloc&) {
      throw FileError(path, "does not fit into memory");
    } catch (const std::exception& error) {
      throw FileError(path, std::string("is not a usable map: ") + error.what());
    }
  }

  void read(const std::string& path, bool check_digest) {
    detail::Folder folder(path, check_digest);
    const detail::Json& attributes = folder.attributes;
    read_grid(attributes, folder.is_tiled);
    const Index slices = attributes["slices"].integer(1);
    const Index rotations = attributes["rotations"].integer(1);
    const Index d = static_cast<Index>(dim_);
    kind_ = folder.has("quaternion") ? QUATERNION : folder.has("yaw") ? YAW : FIXED;
    check_names(attributes);
    if (!folder.has("exterior")) detail::refuse("it is not complete: run the same build again to finish it");
    std::map<std::string, detail::Layout> wanted = {
        {"slice_of", {"int64", 8, {rotations}}},
        {"exterior", {"int64", 8, {slices, 2 * d + 1}}},
    };
    if (kind_ == YAW) wanted["yaw_bounds"] = {"float64", 8, {rotations, 2}};
    std::vector<Index> shape = {slices};
    for (const Index count : this->shape()) shape.push_back(count);
    if (!folder.is_tiled) wanted["cell_states"] = {"uint8", 1, shape};
    if (!folder.is_tiled && folder.has("distances")) {
      wanted["distances"] = {"float32", 4, shape};
      wanted["distance_boxes"] = {"float64", 8, {slices, 2, d}};
    }
    std::map<std::string, detail::Array> arrays = folder.read(wanted);
    read_rotations(arrays, slices, rotations);
    read_exterior(arrays["exterior"]);
    slices_ = slices;
    if (folder.is_tiled) {
      read_tiles(path, attributes["tiles"], check_digest);
      return;
    }
    states_ = std::move(arrays["cell_states"]);
    if (check_digest) check_states(states_);
    distances_ = std::move(arrays["distances"]);
    distance_boxes_ = arrays["distance_boxes"].doubles();
  }

  /// Read the grid, with one layer of cells in the plane, and all that needs no array.
  void read_grid(const detail::Json& attributes, bool is_tiled) {
    const std::vector<Index> shape = (is_tiled ? attributes["tiles"] : attributes)["shape"].integers(1);
    const std::vector<detail::Json>& corner = attributes["lower"].list();
    dim_ = shape.size();
    spacing_ = attributes["spacing"].number();
    if ((dim_ != 2 && dim_ != 3) || corner.size() != dim_ || !(spacing_ > 0.0)) detail::refuse("its grid is none");
    cells_ = {1, 1, 1};
    lower_ = {0.0, 0.0, 0.0};
    upper_ = {spacing_, spacing_, spacing_};
    for (std::size_t axis = 3 - dim_; axis < 3; ++axis) {
      cells_[axis] = shape[axis + dim_ - 3];
      lower_[axis] = corner[axis + dim_ - 3].number();
      upper_[axis] = shift(lower_[axis], cells_[axis]);
      if (!(std::max(std::abs(lower_[axis]), std::abs(upper_[axis])) / spacing_ <= detail::MAX_COORDINATE))
        detail::refuse("its grid is too far from the origin");
    }
    outside_ = attributes["outside"].text();
    margin_ = attributes["margin_m"].number();
    if (!(margin_ >= 0.0)) detail::refuse("its margin is negative");
    axes_ = detail::split(attributes["axes"].text());
  }

  /// Return a coordinate of the corner of a cell.
  double shift(double lower, Index cells) const {
    CSPACE_EXACT
    return lower + spacing_ * static_cast<double>(cells);
  }

  void check_names(const detail::Json& attributes) const {
    const std::vector<std::string> turns[] = {{}, {"yaw"}, {"qx", "qy", "qz", "qw"}};
    const std::vector<std::string>& expected = turns[kind_];
    if (axes_.size() != dim_ + expected.size() ||
        !std::equal(expected.begin(), expected.end(), axes_.begin() + static_cast<std::ptrdiff_t>(dim_)))
      detail::refuse("its axes do not match its rotation cells");
    for (const std::string& unit : detail::split(attributes["units"].text()))
      if (unit != "m" && unit != "rad") detail::refuse("its units are others than m and rad");
  }

  void read_rotations(std::map<std::string, detail::Array>& arrays, Index slices, Index rotations) {
    for (const Index slice : arrays["slice_of"].integers()) {
      if (slice < 0 || slice >= slices) detail::refuse("it has a rotation cell without a slice");
      slice_of_.push_back(slice);
    }
    if (kind_ == FIXED && rotations != 1) detail::refuse("it has too many rotation cells");
    if (kind_ == YAW) {
      const std::vector<double> bounds = arrays["yaw_bounds"].doubles();
      for (Index k = 0; k < rotations; ++k) borders_.push_back(bounds[static_cast<std::size_t>(2 * k)]);
      borders_.push_back(borders_[0] + detail::TWO_PI);
      bool is_turn = rotations <= detail::MAX_YAW_CELLS && std::abs(borders_[0]) <= detail::TWO_PI;
      is_turn = is_turn && std::abs(bounds.back() - borders_.back()) <= 2.0 * detail::ANGLE_SLACK;
      for (std::size_t k = 1; k < borders_.size(); ++k) is_turn = is_turn && borders_[k - 1] < borders_[k];
      if (!is_turn) detail::refuse("its yaw cells do not ascend over one turn");
    }
    if (kind_ == QUATERNION) make_quaternion_borders(rotations);
  }

  /// Make the borders of the quotients of quaternions: tangents of equal angles.
  void make_quaternion_borders(Index rotations) {
    CSPACE_EXACT
    Index n = 1;
    while (n < detail::MAX_PARTS_PER_AXIS && 4 * n * n * n < rotations) ++n;
    if (4 * n * n * n != rotations) detail::refuse("its number of rotation cells is not four times a cube");
    const double step = 2.0 / static_cast<double>(n);
    std::vector<double> tangents;
    for (Index k = 0; k <= n; ++k) {
      const double share = k == n ? 1.0 : static_cast<double>(k) * step + -1.0;
      tangents.push_back(std::tan(detail::QUARTER_PI * share));
    }
    borders_ = tangents;
    for (std::size_t k = 0; k < borders_.size(); ++k) borders_[k] = (tangents[k] - tangents[tangents.size() - 1 - k]) / 2.0;
    borders_.front() = -1.0;
    borders_.back() = 1.0;
  }

  void read_exterior(const detail::Array& array) {
    exterior_ = array.integers();
    const std::size_t width = 2 * dim_ + 1;
    for (std::size_t k = 0; k < exterior_.size(); ++k) {
      const Index value = exterior_[k];
      bool is_valid = std::max(value, -value) <= detail::MAX_EXTERIOR_CELL;
      if (k % width == width - 1) {
        is_valid = outside_ == "free" ? value == FREE : value == MIXED || (outside_ == "blocked" && value == BLOCKED);
        is_valid = is_valid && (outside_ == "free" || outside_ == "blocked" || outside_ == "unknown");
      }
      if (!is_valid) detail::refuse("its exterior contradicts the space outside");
    }
  }

  static void check_states(const detail::Array& states) {
    const Index row = states.shape().back();
    for (Index entry = 0; entry < states.size(); entry += row) {
      const unsigned char* cells = states.at(entry);
      unsigned char largest = 0;
      for (Index k = 0; k < row; ++k) largest = std::max(largest, cells[k]);
      if (largest > BLOCKED) detail::refuse("it holds states above 2");
    }
  }

  // ---- tiles ---------------------------------------------------------------------------------------------------------

  void read_tiles(const std::string& path, const detail::Json& layout, bool check_digest) {
    const std::vector<Index> side = layout["side"].integers(1);
    if (side.size() != dim_) detail::refuse("its tiles are none");
    tiles_ = std::make_unique<Tiles>();
    tiles_->path = path;
    tiles_->stamp = layout["stamp"].text();
    tiles_->check_digest = check_digest;
    tiles_->side = tiles_->counts = {1, 1, 1};
    tiles_->halo = {0, 0, 0};
    const Index halo = std::min<Index>(64, std::max<Index>(4, *std::min_element(side.begin(), side.end()) / 16));
    Index total = 1;
    for (std::size_t axis = 3 - dim_; axis < 3; ++axis) {
      tiles_->side[axis] = side[axis + dim_ - 3];
      tiles_->halo[axis] = halo;
      tiles_->counts[axis] = (cells_[axis] - 1) / tiles_->side[axis] + 1;
      total = detail::multiply(total, tiles_->counts[axis]);
    }
    if (total > detail::MAX_TILES) detail::refuse("it has more than 2^22 tiles");
    tiles_->open = std::make_unique<std::atomic<const Tile*>[]>(static_cast<std::size_t>(total));
    for (Index k = 0; k < total; ++k) tiles_->open[static_cast<std::size_t>(k)] = nullptr;
  }

  /// Return the tile with an index along each axis, and open it if this is the first query of it.
  const Tile& find_tile(const Cell& index) const {
    const Index number = (index[0] * tiles_->counts[1] + index[1]) * tiles_->counts[2] + index[2];
    std::atomic<const Tile*>& place = tiles_->open[static_cast<std::size_t>(number)];
    const Tile* tile = place.load(std::memory_order_acquire);
    if (tile != nullptr) return *tile;
    const std::lock_guard<std::mutex> guard(tiles_->opening);
    tile = place.load(std::memory_order_acquire);
    if (tile == nullptr) {
      tiles_->kept.push_back(open_tile(index));
      tile = tiles_->kept.back().get();
      place.store(tile, std::memory_order_release);
    }
    return *tile;
  }

  std::unique_ptr<const Tile> open_tile(const Cell& index) const {
    std::unique_ptr<Tile> tile = std::make_unique<Tile>();
    std::string name;
    std::vector<Index> shape = {slices_};
    std::vector<double> lower;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const Index begin = index[axis] * tiles_->side[axis];
      const Index end = std::min(begin + tiles_->side[axis], cells_[axis]);
      tile->first[axis] = std::max<Index>(begin - tiles_->halo[axis], 0);
      tile->shape[axis] = std::min(end + tiles_->halo[axis], cells_[axis]) - tile->first[axis];
      if (axis < 3 - dim_) continue;
      name += (name.empty() ? "" : ".") + std::to_string(index[axis]);
      shape.push_back(tile->shape[axis]);
      lower.push_back(shift(lower_[axis], tile->first[axis]));
    }
    const std::string path = tiles_->path + "/" + name;
    with_file(path, [&] {
      detail::Folder folder(path, tiles_->check_digest);
      if (folder.is_tiled || folder.attributes["stamp"].text() != tiles_->stamp) detail::refuse("it is a tile of another map");
      std::vector<double> corner;
      for (const detail::Json& number : folder.attributes["lower"].list()) corner.push_back(number.number());
      if (corner != lower || folder.attributes["spacing"].number() != spacing_) detail::refuse("it is a tile of another place");
      tile->states = std::move(folder.read({{"cell_states", {"uint8", 1, shape}}})["cell_states"]);
      if (tiles_->check_digest) check_states(tile->states);
    });
    return tile;
  }

  /// Return the states of a run of cells along the last axis; lower `count` to the number of cells that are there.
  const unsigned char* run_of(Index s, Index i, Index j, Index k, Index& count) const {
    if (!tiles_) return states_.at(s, (i * cells_[1] + j) * cells_[2] + k);
    const Cell index = {i / tiles_->side[0], j / tiles_->side[1], k / tiles_->side[2]};
    const Tile& tile = find_tile(index);
    count = std::min(count, (index[2] + 1) * tiles_->side[2] - k);
    const Index row = (i - tile.first[0]) * tile.shape[1] + j - tile.first[1];
    return tile.states.at(s, row * tile.shape[2] + k - tile.first[2]);
  }

  // ---- configurations ------------------------------------------------------------------------------------------------

  void check_usable(const double* q) const {
    if (!is_usable(q)) throw InputError("cspace: numbers must be finite, a yaw at most 2^20, and the norm of a quaternion 1");
  }

  const double* check_size(const std::vector<double>& q) const {
    if (q.size() != size()) throw InputError("cspace: a configuration has " + std::to_string(size()) + " numbers");
    return q.data();
  }

  Row position_of(const double* q) const {
    if (dim_ == 2) return {0.5 * spacing_, q[0], q[1]};  // in the middle of the layer
    return {q[0], q[1], q[2]};
  }

  Quaternion rotation_of(const double* q) const { return {q[dim_], q[dim_ + 1], q[dim_ + 2], q[dim_ + 3]}; }

  Row in_cells(const Row& position) const {
    Row cells;
    for (std::size_t axis = 0; axis < 3; ++axis) cells[axis] = (position[axis] - lower_[axis]) / spacing_;
    return cells;
  }

  // ---- states --------------------------------------------------------------------------------------------------------

  State cell_state(Index s, Index i, Index j, Index k) const {
    Index count = 1;
    const unsigned char state = *run_of(s, i, j, k, count);
    return state <= BLOCKED ? static_cast<State>(state) : MIXED;
  }

  State state_at(Index s, const Row& position) const {
    const Row c = in_cells(position);
    const double nx = static_cast<double>(cells_[0]), ny = static_cast<double>(cells_[1]), nz = static_cast<double>(cells_[2]);
    if (c[0] >= 0.0 && c[1] >= 0.0 && c[2] >= 0.0 && c[0] < nx && c[1] < ny && c[2] < nz)
      return cell_state(s, static_cast<Index>(c[0]), static_cast<Index>(c[1]), static_cast<Index>(c[2]));
    return state_outside(s, position);
  }

  /// Return the state of a position outside the grid, or on its upper border.
  State state_outside(Index s, const Row& position) const {
    const Row c = in_cells(position);
    Cell cell;
    bool is_in_grid = true;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      cell[axis] = static_cast<Index>(std::floor(std::min(std::max(c[axis], -detail::MAX_CELL), detail::MAX_CELL)));
      if (cell[axis] == cells_[axis] && position[axis] <= upper_[axis]) --cell[axis];
      is_in_grid = is_in_grid && cell[axis] >= 0 && cell[axis] < cells_[axis];
    }
    if (is_in_grid) return cell_state(s, cell[0], cell[1], cell[2]);
    Cell first, last;
    exterior_box(s, first, last);
    bool is_in_box = true;
    for (std::size_t axis = 0; axis < 3; ++axis) is_in_box = is_in_box && first[axis] <= cell[axis] && cell[axis] <= last[axis];
    return is_in_box ? MIXED : exterior_state(s);
  }

  State exterior_state(Index s) const {
    return static_cast<State>(exterior_[static_cast<std::size_t>(s) * (2 * dim_ + 1) + 2 * dim_]);
  }

  /// Write the first and the last cell of the box of MIXED cells outside the grid.
  void exterior_box(Index s, Cell& first, Cell& last) const {
    const Index* row = &exterior_[static_cast<std::size_t>(s) * (2 * dim_ + 1)];
    first = last = {0, 0, 0};
    std::copy(row, row + dim_, first.end() - static_cast<std::ptrdiff_t>(dim_));
    std::copy(row + dim_, row + 2 * dim_, last.end() - static_cast<std::ptrdiff_t>(dim_));
  }

  // ---- rotation cells ------------------------------------------------------------------------------------------------

  Index slice_of(const double* q) const {
    if (kind_ == FIXED) return slice_of_[0];
    if (kind_ == YAW) return slice_of_[static_cast<std::size_t>(find_cell(q[dim_]))];
    std::size_t chart;
    Cell parts;
    find_parts(rotation_of(q), chart, parts);
    return slice_of_[cell_index(chart, parts)];
  }

  double wrap_to_cells(double yaw) const {
    CSPACE_EXACT
    return yaw - std::floor((yaw - borders_[0]) / detail::TWO_PI) * detail::TWO_PI;
  }

  Index find_cell(double yaw) const {
    CSPACE_EXACT
    yaw = wrap_to_cells(yaw);
    const Index count = static_cast<Index>(borders_.size()) - 1;
    const double guess = (yaw - borders_[0]) * (static_cast<double>(count) / detail::TWO_PI);
    Index low = 0.0 <= guess && guess < static_cast<double>(count) ? static_cast<Index>(guess) : 0;
    if (border(low) <= yaw && yaw < border(low + 1)) return low;
    low = 0;
    Index high = count;
    while (high - low > 1) {
      const Index center = (low + high) / 2;
      (yaw >= border(center) ? low : high) = center;
    }
    return low;
  }

  double border(Index k) const { return borders_[static_cast<std::size_t>(k)]; }

  Index first_widened_cell(double angle) const {
    CSPACE_EXACT
    const double revolutions = std::floor((angle - borders_[0]) / detail::TWO_PI);
    const Index count = static_cast<Index>(borders_.size()) - 1;
    const Index k = find_cell(angle);
    const Index cell = k + static_cast<Index>(revolutions) * count;
    const double boundary = border(k) + revolutions * detail::TWO_PI;
    return angle - boundary <= detail::ANGLE_SLACK ? cell - 1 : cell;
  }

  Index widened_bounds(Index cell, double& low, double& high) const {
    CSPACE_EXACT
    const Index count = static_cast<Index>(borders_.size()) - 1;
    const double revolutions = std::floor(static_cast<double>(cell) / static_cast<double>(count));
    const Index k = cell - static_cast<Index>(revolutions) * count;
    low = border(k) + revolutions * detail::TWO_PI - detail::ANGLE_SLACK;
    high = border(k + 1) + revolutions * detail::TWO_PI + detail::ANGLE_SLACK;
    return k;
  }

  Index find_part(double quotient) const {
    CSPACE_EXACT
    const Index parts = static_cast<Index>(borders_.size()) - 1;
    const double angle = quotient * (detail::QUARTER_PI + 0.273 * (1.0 - std::abs(quotient)));
    const double guess = (angle + detail::QUARTER_PI) * (static_cast<double>(parts) / (2.0 * detail::QUARTER_PI));
    Index part = static_cast<Index>(std::min(std::max(guess, 0.0), static_cast<double>(parts) - 1.0));
    while (part > 0 && quotient < border(part)) --part;
    while (part < parts - 1 && quotient >= border(part + 1)) ++part;
    return part;
  }

  void find_parts(const Quaternion& q, std::size_t& chart, Cell& parts) const {
    chart = 0;
    for (std::size_t component = 1; component < 4; ++component)
      if (std::abs(q[component]) > std::abs(q[chart])) chart = component;
    for (std::size_t n = 0; n < 3; ++n) {
      const std::size_t other = static_cast<std::size_t>(detail::OTHER_COMPONENTS[chart][n]);
      parts[n] = find_part(q[other] / q[chart]);
    }
  }

  std::size_t cell_index(std::size_t chart, const Cell& parts) const {
    const Index n = static_cast<Index>(borders_.size()) - 1;
    return static_cast<std::size_t>(((static_cast<Index>(chart) * n + parts[0]) * n + parts[1]) * n + parts[2]);
  }

  /// Find where the chord of an arc leaves its current cell; `done` is the fraction of the chord before the point.
  std::size_t next_part(const detail::Arc& arc, double& done, double& time, bool& has_next) const {
    CSPACE_EXACT
    const Quaternion& end = arc.second;
    const Quaternion point = detail::mix(arc.first, detail::mix(end, arc.first, 1.0, -1.0), 1.0, done);
    std::size_t chart;
    Cell parts;
    find_parts(point, chart, parts);
    const double sign = std::copysign(1.0, point[chart]);
    const double largest = sign * point[chart];
    const double largest_at_end = sign * end[chart];
    double share = 1.0;
    for (std::size_t n = 0; n < 3; ++n) {
      const std::size_t component = static_cast<std::size_t>(detail::OTHER_COMPONENTS[chart][n]);
      const double other = sign * point[component];
      const double other_at_end = sign * end[component];
      const double low = border(parts[n]) - detail::QUOTIENT_SLACK;
      const double high = border(parts[n] + 1) + detail::QUOTIENT_SLACK;
      const double above = other - high * largest;
      const double above_at_end = other_at_end - high * largest_at_end;
      const double below = low * largest - other;
      const double below_at_end = low * largest_at_end - other_at_end;
      if (above_at_end > 0.0) share = std::min(share, above / (above - above_at_end));
      if (below_at_end > 0.0) share = std::min(share, below / (below - below_at_end));
    }
    done += (1.0 - done) * share;
    const double along_chord = 2.0 * done - 1.0;
    time = std::min(0.5 + 0.5 * std::atan(along_chord * arc.tangent) / arc.half_angle, 1.0);
    has_next = share < 1.0;
    return cell_index(chart, parts);
  }

  // ---- motions -------------------------------------------------------------------------------------------------------

  bool yaw_edge_is_free(const Row& p0, double yaw0, const Row& p1, double yaw1) const {
    const double start = wrap_to_cells(yaw0);
    const int arcs = detail::PI - std::abs(detail::signed_angle(yaw0, yaw1, 0)) <= detail::ANGLE_SLACK ? 2 : 1;
    for (int arc = 0; arc < arcs; ++arc) {
      const double angle = detail::signed_angle(yaw0, yaw1, arc);
      const double end = start + angle;
      Index cell = first_widened_cell(std::min(start, end));
      double low, high;
      Index index = widened_bounds(cell, low, high);
      while (!(low > std::max(start, end))) {
        double enter = 0.0, leave = 1.0;
        if (angle != 0.0) {
          const double at_low = std::min(std::max((low - start) / angle, 0.0), 1.0);
          const double at_high = std::min(std::max((high - start) / angle, 0.0), 1.0);
          enter = std::min(at_low, at_high);
          leave = std::max(at_low, at_high);
        }
        const Row first = detail::position_along(p0, p1, enter), last = detail::position_along(p0, p1, leave);
        if (!segment_is_free(slice_of_[static_cast<std::size_t>(index)], first, last)) return false;
        index = widened_bounds(++cell, low, high);
      }
    }
    return true;
  }

  bool quaternion_edge_is_free(const Row& p0, const Quaternion& r0, const Row& p1, const Quaternion& r1) const {
    const double cosine = detail::dot_product(detail::normalise(r0, 1.0), detail::normalise(r1, 1.0));
    const int arcs = std::abs(cosine) <= detail::QUOTIENT_SLACK ? 2 : 1;
    for (int number = 0; number < arcs; ++number) {
      const detail::Arc arc = detail::find_arc(r0, r1, number);
      if (!(arc.tangent < 2.0)) return false;
      double chord_share = 0.0, enter = 0.0;
      bool has_next = true;
      while (has_next) {
        double time;
        const std::size_t cell = next_part(arc, chord_share, time, has_next);
        const double leave = has_next ? std::max(time, enter) : 1.0;
        // OMPL's rotation may jump along a tiny arc, so each part must be FREE everywhere.
        const Row first = arc.is_tiny ? p0 : detail::position_along(p0, p1, enter);
        const Row last = arc.is_tiny ? p1 : detail::position_along(p0, p1, leave);
        if (!segment_is_free(slice_of_[cell], first, last)) return false;
        enter = leave;
      }
    }
    return true;
  }

  bool segment_is_free(Index s, const Row& first, const Row& last) const {
    const Row p = in_cells(first), q = in_cells(last);
    bool inside = true;
    double total = 0.0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      inside = inside && std::min(first[axis], last[axis]) >= lower_[axis];
      inside = inside && std::max(first[axis], last[axis]) <= upper_[axis];
      total += std::abs(p[axis]) + std::abs(q[axis]);
    }
    if (!(total <= detail::MAX_POSITION)) return false;
    // The closed cells of the grid contain all of a segment inside. Any other segment is proven only if all cells outside
    // both grid and exterior box are FREE.
    if (!inside && exterior_state(s) != FREE) return false;
    Cell low = {0, 0, 0}, high = {cells_[0] - 1, cells_[1] - 1, cells_[2] - 1};
    if (!inside) {
      Cell box_first, box_last;
      exterior_box(s, box_first, box_last);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        low[axis] = std::min<Index>(box_first[axis], 0);
        high[axis] = std::max(box_last[axis], cells_[axis] - 1);
      }
    }
    const unsigned char* cells = states_.whole_slice(s);
    // Cut the segment into slabs along x, and each slab along y. Each piece touches one run of cells along z.
    const detail::Walk x(p[0], q[0]), y(p[1], q[1]), z(p[2], q[2]);
    Index west, east, left, right, bottom, top;
    double start, stop, enter, leave;
    x.cells_between(0.0, 1.0, west, east);
    for (Index i = std::max(low[0], west); i <= std::min(high[0], east); ++i) {
      x.slab_times(i, start, stop);
      if (start > stop) continue;
      y.cells_between(start, stop, left, right);
      for (Index j = std::max(low[1], left); j <= std::min(high[1], right); ++j) {
        y.slab_times(j, enter, leave);
        enter = std::max(enter, start);
        leave = std::min(leave, stop);
        if (enter > leave) continue;
        z.cells_between(enter, leave, bottom, top);
        const Index first_cell = std::max(low[2], bottom), last_cell = std::min(high[2], top);
        if (inside && cells != nullptr) {
          const unsigned char* run = cells + (i * cells_[1] + j) * cells_[2] + first_cell;
          if (first_cell <= last_cell && !are_free(run, last_cell - first_cell + 1)) return false;
        } else if (!run_is_free(s, i, j, first_cell, last_cell)) {
          return false;
        }
      }
    }
    return true;
  }

  static bool are_free(const unsigned char* states, Index count) {
    // Most runs have one or two cells, which no loop tests: processors guess wrong when it ends.
    for (Index k = 1; k < count - 1; ++k)
      if (states[k] != FREE) return false;
    return (states[0] | states[count - 1]) == FREE;
  }

  /// Return true if cells `start` to `stop` of the grid, along the last axis, are FREE.
  bool cells_are_free(Index s, Index i, Index j, Index start, Index stop) const {
    while (start <= stop) {
      Index count = stop - start + 1;
      const unsigned char* states = run_of(s, i, j, start, count);
      if (!are_free(states, count)) return false;
      start += count;
    }
    return true;
  }

  /// Return true if cells `first` to `last` along the last axis are FREE; outside the grid, those in the box are MIXED.
  bool run_is_free(Index s, Index i, Index j, Index first, Index last) const {
    const bool in_grid = 0 <= i && i < cells_[0] && 0 <= j && j < cells_[1];
    if (in_grid) {
      const Index start = std::max<Index>(first, 0);
      const Index stop = std::min(last, cells_[2] - 1);
      if (start <= stop && !cells_are_free(s, i, j, start, stop)) return false;
      if (first >= 0 && last < cells_[2]) return true;
    }
    Cell low, high;
    exterior_box(s, low, high);
    if (!(low[0] <= i && i <= high[0] && low[1] <= j && j <= high[1])) return true;
    const Index begin = std::max(first, low[2]);
    const Index end = std::min(last, high[2]);
    return begin > end || (in_grid && begin >= 0 && end < cells_[2]);
  }

  // ---- clearance -----------------------------------------------------------------------------------------------------

  double clearance_at(Index s, const Row& position) const {
    CSPACE_EXACT
    if (state_at(s, position) != FREE) return 0.0;
    const std::size_t first_axis = 3 - dim_;
    Row place, nearest;
    double box_square = 0.0, beyond_square = 0.0, spread = 0.0;
    for (std::size_t axis = first_axis; axis < 3; ++axis) {
      const double cells = (position[axis] - lower_[axis]) / spacing_;
      place[axis] = std::min(std::max(cells, -detail::MAX_CELL), detail::MAX_CELL) - 0.5;
      nearest[axis] = std::min(std::max(place[axis], 0.0), static_cast<double>(cells_[axis] - 1));
      const double cell_place = place[axis] + 0.5;
      const double* corners = &distance_boxes_[static_cast<std::size_t>(s) * 2 * dim_ + axis - first_axis];
      const double box_gap = std::max(std::max(0.0, corners[0] - cell_place), cell_place - corners[dim_]);
      box_square += box_gap * box_gap;
      const double beyond = place[axis] - nearest[axis];
      beyond_square += beyond * beyond;
      const double share = nearest[axis] - std::floor(nearest[axis]);
      spread += share * (1.0 - share);
    }
    double best = std::sqrt(box_square) * detail::ROUNDING_FACTOR;
    double mean_square = 0.0;
    for (std::size_t corner = 0; corner < (std::size_t(1) << dim_); ++corner) {
      Index cell = 0;
      double weight = 1.0, gap_square = 0.0;
      for (std::size_t axis = first_axis; axis < 3; ++axis) {
        Index k = static_cast<Index>(std::floor(nearest[axis]));
        double share = nearest[axis] - static_cast<double>(k);
        // Each bit of the corner selects the lower or the upper center along an axis.
        if ((corner >> (axis - first_axis)) & 1) k = std::min(k + 1, cells_[axis] - 1);
        else share = 1.0 - share;
        weight *= share;
        const double gap = place[axis] - static_cast<double>(k);
        gap_square += gap * gap;
        cell = cell * cells_[axis] + k;
      }
      float stored;
      std::memcpy(&stored, distances_.at(s, cell), sizeof stored);
      const double distance = static_cast<double>(stored) * detail::ROUNDING_FACTOR;
      best = std::max(best, distance - std::sqrt(gap_square));
      mean_square += weight * distance * distance;
    }
    if (mean_square > spread) best = std::max(best, std::sqrt(mean_square - spread) - std::sqrt(beyond_square));
    return std::max(0.0, best - 4.0 * detail::SLACK) * spacing_;
  }

  Kind kind_ = FIXED;
  std::size_t dim_ = 0;
  std::vector<std::string> axes_;
  Cell cells_{};  ///< number of cells along each axis; 1 along the first one in the plane
  Row lower_{}, upper_{};
  double spacing_ = 0.0, margin_ = 0.0;
  std::string outside_;
  Index slices_ = 0;
  std::vector<double> borders_;   ///< of yaw cells, or of the quotients of quaternions
  std::vector<Index> slice_of_;   ///< of each rotation cell
  std::vector<Index> exterior_;   ///< of each slice: first and last cell of the box, and the state beyond it
  detail::Array states_;          ///< unless the map has tiles
  std::unique_ptr<Tiles> tiles_;
  detail::Array distances_;
  std::vector<double> distance_boxes_;
};

}  // namespace cspace

#if defined(__FP_FAST_FMA) && !defined(__clang__)
#pragma GCC pop_options
#endif
#undef CSPACE_EXACT

#endif  // CSPACE_MAP_HPP
