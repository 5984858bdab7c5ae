/// @file map.hpp
/// A saved map of a robot's configuration space, read and queried in C++17.
///
/// Python builds and saves a map (`space.save("map.zarr", compress=False)`); this header opens it on the robot:
///
///     cspace::Map map = cspace::Map::open("map.zarr");
///     map.is_free({1.0, 2.0, 0.5});                             // x, y, yaw: a proof
///     map.motion_is_free({1.0, 2.0, 0.5}, {1.5, 2.0, 0.7});     // all along the motion
///
/// Answers equal Python's to the last bit, because each function repeats the statements of the function of the same
/// name there (`cspace/queries`, `cspace/rotations/lookup.py`), which have the proofs. `docs/reference/format.md`
/// describes the files. For compressed arrays, and so for tiled maps, define CSPACE_ZSTD and link libzstd. The header
/// needs nothing else but a 64-bit POSIX system, and no special flags: fused multiply-adds are switched off here.
#ifndef CSPACE_MAP_HPP
#define CSPACE_MAP_HPP

#if __cplusplus < 201703L
#error "cspace/map.hpp: compile as C++17 or later; after the flags of pkg-config for OMPL, which may say C++14"
#elif defined(__FAST_MATH__)
#error "cspace/map.hpp: proofs need IEEE arithmetic; compile without -ffast-math"
#endif

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cfloat>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>
#include <stdexcept>
#include <string>
#include <tuple>
#include <type_traits>
#include <vector>

#ifdef CSPACE_ZSTD
#include <zstd.h>
#endif

static_assert(FLT_EVAL_METHOD == 0, "cspace/map.hpp: proofs need double arithmetic without excess precision");
static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "cspace/map.hpp: saved maps are little-endian");

// A fused multiply-add rounds once where Python rounds twice.
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__FP_FAST_FMA)
#pragma GCC push_options
#pragma GCC optimize("fp-contract=off")
#endif

namespace cspace {

/// What is proven of a configuration: free, undecided, or in collision.
enum State : std::uint8_t { FREE = 0, MIXED = 1, BLOCKED = 2 };

/// A saved map that is missing, damaged, incomplete or of another version; the text begins with the name of the file.
class FileError : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Numbers that are no configuration of the map: not finite, or with a wrong length, norm or yaw.
class InputError : public std::invalid_argument {
  using std::invalid_argument::invalid_argument;
};

namespace detail {

using Index = std::int64_t;
using Row = std::array<double, 3>;
using Cell = std::array<Index, 3>;
using Quaternion = std::array<double, 4>;

// The constants of the same names in Python.
constexpr Index WRITTEN_CHUNK_BYTES = 1 << 24;
constexpr Index MAX_TILES = 1 << 22;
constexpr double PI = 3.141592653589793;
constexpr double TWO_PI = 2.0 * PI;
constexpr double QUARTER_PI = PI / 4.0;
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
constexpr int OTHER_COMPONENTS[4][3] = {{1, 2, 3}, {0, 2, 3}, {0, 1, 3}, {0, 1, 2}};

/// Throw the error for content that is no map; `Map::open` adds the name of the folder.
[[noreturn]] inline void refuse(const std::string& problem) { throw std::runtime_error(problem); }

/// The content of a file, mapped into memory, or of an unpacked chunk.
struct Bytes {
  std::shared_ptr<const unsigned char> data;
  std::size_t size;
  std::string_view text() const { return {reinterpret_cast<const char*>(data.get()), size}; }
};

inline Bytes map_file(const std::string& path) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (file < 0) throw FileError(path + ": " + std::strerror(errno));
  struct stat status;
  const bool is_plain = ::fstat(file, &status) == 0 && S_ISREG(status.st_mode) && status.st_size > 0;
  const std::size_t size = is_plain ? static_cast<std::size_t>(status.st_size) : 0;
  void* mapped = is_plain ? ::mmap(nullptr, size, PROT_READ, MAP_PRIVATE, file, 0) : MAP_FAILED;
  ::close(file);
  if (mapped == MAP_FAILED) throw FileError(path + ": is empty, no plain file, or does not fit into memory");
  return {{static_cast<unsigned char*>(mapped), [=](const unsigned char*) { ::munmap(mapped, size); }}, size};
}

/// Unpack a chunk that was compressed by zstd.
inline Bytes unpack([[maybe_unused]] const Bytes& packed, [[maybe_unused]] std::size_t size) {
#ifdef CSPACE_ZSTD
  // Memory is taken for a declared size only if it is the right one.
  if (ZSTD_getFrameContentSize(packed.data.get(), packed.size) != size) refuse("it has a chunk of another size");
  const std::shared_ptr<unsigned char> data(new unsigned char[size], std::default_delete<unsigned char[]>());
  if (ZSTD_decompress(data.get(), size, packed.data.get(), packed.size) != size) refuse("a chunk does not unpack");
  return {data, size};
#else
  refuse("it is compressed: define CSPACE_ZSTD and link libzstd, or save it with compress=False");
#endif
}

/// Add a block of 64 bytes to a SHA-256, as in FIPS 180-4.
inline void add_block(const char* block, std::array<std::uint32_t, 8>& words) {
  static constexpr std::uint32_t CONSTANTS[64] = {
      0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
      0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
      0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
      0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
      0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
      0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
      0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
      0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2};
  const auto rotate = [](std::uint32_t word, int by) { return (word >> by) | (word << (32 - by)); };
  std::uint32_t w[64];
  std::memcpy(w, block, 64);
  for (int t = 0; t < 16; ++t) w[t] = __builtin_bswap32(w[t]);
  for (int t = 16; t < 64; ++t) {
    const std::uint32_t s0 = rotate(w[t - 15], 7) ^ rotate(w[t - 15], 18) ^ (w[t - 15] >> 3);
    const std::uint32_t s1 = rotate(w[t - 2], 17) ^ rotate(w[t - 2], 19) ^ (w[t - 2] >> 10);
    w[t] = w[t - 16] + s0 + w[t - 7] + s1;
  }
  std::array<std::uint32_t, 8> h = words;
  for (int t = 0; t < 64; ++t) {
    const std::uint32_t s1 = rotate(h[4], 6) ^ rotate(h[4], 11) ^ rotate(h[4], 25);
    const std::uint32_t t1 = h[7] + s1 + ((h[4] & h[5]) ^ (~h[4] & h[6])) + CONSTANTS[t] + w[t];
    const std::uint32_t s0 = rotate(h[0], 2) ^ rotate(h[0], 13) ^ rotate(h[0], 22);
    const std::uint32_t t2 = s0 + ((h[0] & h[1]) ^ (h[0] & h[2]) ^ (h[1] & h[2]));
    h = {t1 + t2, h[0], h[1], h[2], h[3] + t1, h[4], h[5], h[6]};
  }
  for (int k = 0; k < 8; ++k) words[k] += h[k];
}

/// Return the SHA-256 of texts that follow each other, as hexadecimal digits.
inline std::string sha256(std::vector<std::string_view> texts) {
  std::uint64_t bits = 0;
  for (const std::string_view text : texts) bits += 8 * text.size();
  std::string padding(1 + (119 - bits / 8 % 64) % 64, '\0');
  padding[0] = '\x80';
  for (int shift = 56; shift >= 0; shift -= 8) padding += static_cast<char>(bits >> shift);
  texts.push_back(padding);
  std::array<std::uint32_t, 8> words = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                        0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
  char block[64];
  std::size_t filled = 0;
  for (std::string_view text : texts) {
    while (!text.empty()) {
      const std::size_t taken = text.copy(block + filled, 64 - filled);
      text.remove_prefix(taken);
      filled = (filled + taken) % 64;
      if (filled == 0) add_block(block, words);
    }
  }
  std::string digits;
  for (const std::uint32_t word : words)
    for (int shift = 28; shift >= 0; shift -= 4) digits += "0123456789abcdef"[(word >> shift) & 15];
  return digits;
}

/// A value in JSON with one value a line and two spaces a level, as the format writes it.
class Json {
 public:
  explicit Json(std::string_view text, const std::string& line = "\n  ") : text_(text), line_(line) {}

  /// Return the member of an object.
  Json operator[](const std::string& name) const {
    const std::string key = line_ + '"' + name + "\": ";
    const std::size_t found = text_.find(key);
    if (found == std::string::npos) refuse("it has no '" + name + "'");
    const std::string_view rest = std::string_view(text_).substr(found + key.size());
    return Json(rest.substr(0, rest.find(line_ + '"')), line_ + "  ");  // up to the next member
  }

  bool has(const std::string& name) const { return text_.find(line_ + '"' + name + "\": ") != std::string::npos; }

  /// Return a value as it is written.
  std::string word() const {
    const std::string line = text_.substr(0, text_.find('\n'));
    return line.substr(0, line.find_last_not_of(',') + 1);
  }

  std::string text() const {
    const std::string quoted = word();
    if (quoted.size() < 2 || quoted[0] != '"') refuse("it has " + quoted.substr(0, 40) + " instead of a text");
    return quoted.substr(1, quoted.size() - 2);
  }

  std::vector<std::string> words() const {
    std::istringstream stream(text());
    std::vector<std::string> list;
    for (std::string word; stream >> word;) list.push_back(word);
    return list;
  }

  /// Return a number, or the numbers of a list; whole numbers are counts, so they are positive.
  template <typename Number>
  std::vector<Number> numbers() const {
    std::istringstream items(text_[0] == '[' ? text_.substr(1, text_.find(']') - 1) : word());
    items.imbue(std::locale::classic());  // the program's locale may have a decimal comma
    std::vector<Number> list;
    Number number;
    for (char comma = ','; comma == ',' && items >> number; items >> comma) list.push_back(number);
    const bool is_valid = !list.empty() && items.eof();
    if (!is_valid || (std::is_integral_v<Number> && *std::min_element(list.begin(), list.end()) < 1))
      refuse("it has " + word().substr(0, 40) + " instead of numbers");
    return list;
  }

 private:
  std::string text_, line_;
};

/// An array in the order of C, in chunks of whole rows of at most 16 MiB, which divide one axis.
/// A block has all entries of an index along this axis and the axes before.
class Array {
 public:
  Array() = default;
  Array(std::vector<Index> shape, Index item) : chunk_shape(shape), item_(item), block_bytes_(item) {
    for (const Index count : shape)
      if (__builtin_mul_overflow(block_bytes_, count, &block_bytes_)) refuse("its arrays are too large");
    for (std::size_t axis = 0; axis == 0 || block_bytes_ > WRITTEN_CHUNK_BYTES; ++axis) {
      length_ = shape[axis];
      if (axis > 0) blocks_per_slice_ *= length_;
      block_bytes_ /= length_;
      chunk_shape[axis] = std::max<Index>(1, std::min(length_, WRITTEN_CHUNK_BYTES / block_bytes_));
      blocks_per_chunk_ = chunk_shape[axis];
    }
  }

  std::size_t chunk_bytes() const { return blocks_per_chunk_ * block_bytes_; }

  void add(const Bytes& chunk) {
    chunks_.push_back(chunk);
    for (Index k = 0; k < blocks_per_chunk_; ++k) {
      blocks_.push_back(chunk.data.get() + k * block_bytes_);
      if (static_cast<Index>(blocks_.size()) % length_ == 0) return;  // the rest of the chunk is padding
    }
  }

  /// Return the address of an entry of a slice, an index along the first axis; the other entries of its row follow.
  const unsigned char* at(Index s, Index entry) const {
    if (blocks_per_slice_ == 1) return blocks_[s] + entry * item_;
    const Index byte = entry * item_;
    return blocks_[s * blocks_per_slice_ + byte / block_bytes_] + byte % block_bytes_;
  }

  template <typename Number>
  std::vector<Number> numbers() const {
    std::vector<Number> list;
    for (const unsigned char* block : blocks_) {
      const Number* first = reinterpret_cast<const Number*>(block);
      list.insert(list.end(), first, first + block_bytes_ / static_cast<Index>(sizeof(Number)));
    }
    return list;
  }

  void check_states() const {
    for (const unsigned char* block : blocks_)
      if (*std::max_element(block, block + block_bytes_) > BLOCKED) refuse("it holds states above 2");
  }

  std::vector<Index> chunk_shape;

 private:
  Index item_ = 1, block_bytes_ = 1;  ///< sizes of an entry and a block
  Index length_ = 0;                  ///< of the axis that chunks divide
  Index blocks_per_chunk_ = 0, blocks_per_slice_ = 1;
  std::vector<const unsigned char*> blocks_;
  std::vector<Bytes> chunks_;
};

/// The attributes and arrays of a folder.
class Folder {
 public:
  Json about;  ///< the attributes

  /// Map all files, those of unknown arrays included, because the digest covers them.
  Folder(const std::string& path, bool check_digest) : about(Json(map_file(path + "/zarr.json").text())["attributes"]) {
    const std::string version = about["format_version"].word(), digest = about["digest"].text();
    if (!is_tiled() && about["format"].text() != "cspace-map") refuse("its attributes name another format");
    if (version != "7") refuse("it has format version " + version + ", and this header reads version 7 alone");
    std::string root(map_file(path + "/zarr.json").text());
    if (digest.size() == 64) root.replace(root.find(digest), 64, std::string(64, '0'));
    std::vector<std::string_view> digested = {root};
    std::list<std::string> headers;
    const auto read_file = [&](const std::string& name) {
      const Bytes file = map_file(path + "/" + name);
      headers.push_back("\n" + name + " " + std::to_string(file.size) + "\n");
      digested.insert(digested.end(), {headers.back(), file.text()});
      return file;
    };
    for (const std::string& name : about["arrays"].words()) {
      if (name.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789_") != std::string::npos || has(name))
        refuse("it has an array '" + name.substr(0, 40) + "'");
      std::vector<Bytes>& files = files_[name];
      files.push_back(read_file(name + "/zarr.json"));
      // Files declare any number of chunks, so nothing is allocated before a chunk is there.
      const Json metadata(files[0].text());
      const std::vector<Index> shape = metadata["shape"].numbers<Index>();
      const std::vector<Index> side = metadata["chunk_grid"]["configuration"]["chunk_shape"].numbers<Index>();
      if (shape.size() != side.size()) refuse("its array '" + name + "' has other chunks");
      for (std::string chunk; !(chunk = chunk_name(shape, side, files.size() - 1)).empty();)
        files.push_back(read_file(name + chunk));
    }
    if (check_digest && sha256(digested) != digest) refuse("its files differ from their digest");
  }

  bool is_tiled() const { return about["format"].text() == "cspace-tiles"; }
  bool has(const std::string& name) const { return files_.count(name) > 0; }

  /// Return an array, which must have a type and shape.
  Array array(const std::string& name, const std::string& type, const std::vector<Index>& shape) const {
    if (!has(name)) refuse("it lacks the array '" + name + "'");
    const std::vector<Bytes>& files = files_.at(name);
    const Json metadata(files[0].text());
    Array array(shape, type == "uint8" || type == "bool" ? 1 : type == "float32" ? 4 : 8);
    const bool is_compressed = about["compressed"].word() == "true";
    const bool has_codec = (files[0].text().find("\"name\": \"zstd\"") != std::string::npos) == is_compressed;
    if (metadata["data_type"].text() != type || metadata["shape"].numbers<Index>() != shape || !has_codec ||
        metadata["chunk_grid"]["configuration"]["chunk_shape"].numbers<Index>() != array.chunk_shape)
      refuse("its array '" + name + "' has another shape, type, chunks or codec");
    for (std::size_t k = 1; k < files.size(); ++k) {
      const Bytes chunk = is_compressed ? unpack(files[k], array.chunk_bytes()) : files[k];
      if (chunk.size != array.chunk_bytes()) refuse("its array '" + name + "' has a chunk of another size");
      array.add(chunk);
    }
    return array;
  }

 private:
  /// Return the name of a chunk by its place in the order of C; empty after the last one.
  static std::string chunk_name(const std::vector<Index>& shape, const std::vector<Index>& side, Index place) {
    std::string name;
    for (std::size_t axis = shape.size(); axis-- > 0;) {
      const Index count = (shape[axis] - 1) / side[axis] + 1;
      name = "." + std::to_string(place % count) + name;
      place /= count;
    }
    return place == 0 ? "/c" + name : "";
  }

  std::map<std::string, std::vector<Bytes>> files_;  ///< of each array: its metadata, then its chunks
};

inline double dot_product(const Quaternion& a, const Quaternion& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
}
inline Quaternion mix(const Quaternion& a, const Quaternion& b, double a_weight, double b_weight) {
  Quaternion sum;
  for (int k = 0; k < 4; ++k) sum[k] = a_weight * a[k] + b_weight * b[k];
  return sum;
}
inline Quaternion normalise(const Quaternion& q, double scale) {
  scale /= std::sqrt(dot_product(q, q));
  return {q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale};
}

/// Return the position at t in [0, 1] between two positions; rounding does not lead beyond them.
inline Row position_along(const Row& p0, const Row& p1, double t) {
  if (t == 0.0) return p0;
  if (t == 1.0) return p1;
  const auto between = [t](double a, double b) {
    return std::min(std::max(a + t * (b - a), std::min(a, b)), std::max(a, b));
  };
  return {between(p0[0], p1[0]), between(p0[1], p1[1]), between(p0[2], p1[2])};
}

/// A segment along one axis, from `p` to `p + extent`, and all within `reach`, at least SLACK, of it; in cells.
struct Walk {
  double p, extent, rate, reach;
  bool is_still;

  Walk(double from, double to, double around)
      : p(from),
        extent(to - from),
        rate(1.0 / extent),
        reach(around),
        is_still(std::abs(extent) < MIN_EXTENT_CELLS) {}

  /// Narrow a range of t in [0, 1] to where the segment is in a slab of cells, widened by the reach.
  void narrow(Index cell, double& start, double& stop) const {
    if (is_still) return;
    const double enter = (static_cast<double>(cell) - reach - p) * rate;
    const double leave = (static_cast<double>(cell + 1) + reach - p) * rate;
    start = std::max(std::min(enter, leave), start);
    stop = std::min(std::max(enter, leave), stop);
  }

  /// Write the first and the last closed cell, from `lowest` to `highest`, near the segment from start to stop.
  void cells_between(double start, double stop, Index lowest, Index highest, Index& first, Index& last) const {
    const double begin = p + start * extent, end = p + stop * extent;
    const double low = std::min(begin, end) - reach, high = std::max(begin, end) + reach;
    // Casts drop fractions, which is quicker than std::floor.
    first = static_cast<Index>(low);
    last = static_cast<Index>(high);
    first = std::max(first - (static_cast<double>(first) >= low), lowest);
    last = std::min(last - (static_cast<double>(last) > high), highest);
  }
};
}  // namespace detail

/// A saved map of R^2, R^3, SE(2), R^3 x yaw, SE(3) or joints, in memory or in tiles.
///
/// A configuration has `size()` numbers, in the order of `axes()`: metres, radians, quaternions as x, y, z, w. Any
/// number of threads may query a map at once. Its files must stay unchanged while it is open; a save with
/// `overwrite=True` replaces them by others, so that an open map keeps the old ones.
class Map {
 public:
  /// Open a map that `space.save` or `cspace.build(..., store=)` wrote.
  ///
  /// Tiles are read, and checked, when a query first needs them, and stay open; queries of such maps may throw, too.
  /// @param check_digest  compare the digest and all states: reads all files, about 4 ms a megabyte. Without it,
  ///                      a raw map opens at once and is read as it is queried; a state that is none is never FREE.
  /// @throws FileError    if a file is missing or damaged, or the map is incomplete or of another version
  static Map open(const std::string& path, bool check_digest = true) { return open(path, check_digest, ""); }

  std::size_t size() const { return axes_.size(); }                ///< length of a configuration
  const std::vector<std::string>& axes() const { return axes_; }   ///< names of the numbers of a configuration
  std::size_t dim() const { return dim_; }                         ///< number of axes of the grid, 2 or 3
  std::size_t rotations() const { return slice_of_.size(); }       ///< number of rotation cells
  double spacing() const { return spacing_; }                      ///< side of a cell, metres
  double margin() const { return margin_; }                        ///< by which the robot was grown, metres
  const std::string& outside() const { return outside_; }          ///< of the grid: "blocked", "free" or "unknown"
  const std::string& frame_id() const { return frame_id_; }        ///< of the grid in ROS; empty if it is not known
  const std::string& robot() const { return robot_; }              ///< the robot's shape in JSON
  bool has_clearance() const { return !distance_boxes_.empty(); }  ///< true if it was saved with `clearance=True`
  std::vector<double> lower() const { return {lower_.end() - dim_, lower_.end()}; }        ///< lower corner of the grid
  std::vector<double> upper() const { return {upper_.end() - dim_, upper_.end()}; }        ///< upper corner of the grid
  std::vector<std::int64_t> shape() const { return {cells_.end() - dim_, cells_.end()}; }  ///< number of cells

  bool has_taken_cells() const { return has_taken_cells_; }        ///< true for x, y and yaw, unless in tiles
  bool has_floor() const { return has_floor_; }                    ///< true if the workspace has layers of cells
  const std::string& floor_parts() const { return floor_parts_; }  ///< of a robot on a floor, as JSON; empty if not convex

  /// Return true if a cell may meet an obstacle in one of some layers, or in any; outside the grid, unless the outside
  /// is free. The map must have taken cells.
  bool is_taken(std::int64_t i, std::int64_t j, const std::vector<std::int64_t>& layers = {}) const {
    if (i < 0 || j < 0 || i >= cells_[1] || j >= cells_[2]) return outside_ != "free";
    const unsigned char* column = taken_.at(i, j * layers_);
    const auto is_in = [&](std::int64_t k) { return k < 0 || k >= layers_ || column[k] != 0; };
    if (!layers.empty()) return std::any_of(layers.begin(), layers.end(), is_in);
    return std::any_of(column, column + layers_, [](unsigned char cell) { return cell != 0; });
  }

  /// Return true if all numbers are finite, a yaw is at most 2^20 and the norm of a quaternion is 1 within 1e-6.
  bool is_usable(const double* q) const {
    if (!std::all_of(q, q + dim_, [](double x) { return std::isfinite(x); })) return false;
    if (kind_ == FIXED) return true;
    if (kind_ == YAW) return std::abs(q[dim_]) <= detail::MAX_ANGLE;
    const Quaternion r = rotation_of(q);
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

  /// Return true if the whole motion between two configurations is proven free.
  ///
  /// All closed cells within 2^-26 cells of it must be FREE. The position moves straight and the rotation takes the
  /// shortest arc; if two arcs are equally short up to rounding, both must be free.
  /// @throws InputError if an end is not usable
  bool motion_is_free(const double* q0, const double* q1) const {
    check_usable(q0);
    check_usable(q1);
    return tube_is_free(q0, q1, {}, 0.0);
  }
  bool motion_is_free(const std::vector<double>& q0, const std::vector<double>& q1) const {
    return motion_is_free(check_size(q0), check_size(q1));
  }

  /// Return how many of n rows after the first one are proven: the motions that lead to them, with all near motions.
  ///
  /// The rows follow each other, and the first one is where the robot is. Rows that are not usable are not proven.
  /// Joints move as their numbers do: a continuous one that changes by more than half a turn goes the long way.
  /// @param tracking      largest error of the controller, zero or above: one number along each axis of the grid,
  ///                      metres, and one for the rotation, radians, if there is one
  /// @throws InputError   if the tracking has another size or is negative; or if the rotation of a quaternion strays,
  ///                      which Python alone proves
  std::size_t proven_prefix(const double* rows, std::size_t n, const std::vector<double>& tracking) const {
    const bool is_negative = !std::all_of(tracking.begin(), tracking.end(), [](double x) { return x >= 0.0; });
    if (tracking.size() != dim() + (kind_ != FIXED) || is_negative)
      throw InputError("cspace: tracking has one number along each axis and one for a rotation, zero or above");
    Row radii{};
    std::copy(tracking.begin(), tracking.begin() + dim_, radii.end() - dim_);
    const double turn = kind_ == FIXED ? 0.0 : std::min(tracking.back(), detail::PI);  // half a turn leads to all rotations
    if (kind_ == QUATERNION && turn > 0.0)
      throw InputError("cspace: the rotation of a quaternion may not stray; use cspace.Gate in Python");
    std::size_t proven = 0;
    if (n == 0 || !is_usable(rows)) return proven;
    for (const double* q = rows; proven < n - 1; ++proven, q += size())
      if (!is_usable(q + size()) || !tube_is_free(q, q + size(), radii, turn)) break;
    return proven;
  }

  /// Return a lower bound of the distance, at this rotation, to the nearest position that is not FREE, in metres.
  /// @throws InputError if the configuration is not usable; std::logic_error without `clearance=True` in Python
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
  enum Kind : std::size_t { FIXED = 0, YAW = 1, QUATERNION = 4 };  // numbers of a rotation

  /// What is outside the grid: a box of MIXED cells, from the first to the last, and a state beyond it.
  struct Exterior {
    Cell first{}, last{};
    State beyond;
  };

  /// The tiles of a map. A tile is a map of its cells and a halo around them; the plane is one layer of tiles.
  struct Tiles {
    std::string path, stamp;
    bool check_digest;
    Index halo;
    Cell side = {1, 1, 1}, counts = {1, 1, 1};
    std::mutex opening{};
    std::list<Map> kept{};
    std::unique_ptr<std::atomic<const Map*>[]> open {};
  };

  Map() = default;

  /// Open a map, which must have a stamp if it is a tile.
  static Map open(const std::string& path, bool check_digest, const std::string& stamp) {
    try {
      Map map;
      map.read(path, check_digest, stamp);
      return map;
    } catch (const FileError&) {
      throw;
    } catch (const std::exception& error) {
      throw FileError(path + ": is not a usable map: " + error.what());
    }
  }

  void read(const std::string& path, bool check_digest, const std::string& stamp) {
    const detail::Folder folder(path, check_digest);
    const detail::Json& about = folder.about;
    if (!stamp.empty() && about["stamp"].text() != stamp) detail::refuse("it is a tile of another map or place");
    read_grid(about, (folder.is_tiled() ? about["tiles"] : about)["shape"].numbers<Index>());
    slices_ = about["slices"].numbers<Index>()[0];
    if (stamp.empty()) read_rotations(folder, about["rotations"].numbers<Index>()[0]);
    if (stamp.empty()) read_exterior(path, folder, check_digest);
    if (stamp.empty()) read_robot(about);
    if (folder.is_tiled()) return read_tiles(path, about["tiles"], check_digest);
    std::vector<Index> shape = this->shape();
    shape.insert(shape.begin(), slices_);
    states_ = folder.array("cell_states", "uint8", shape);
    if (check_digest) states_.check_states();
    has_floor_ = about.has("floor_m");
    if (about.has("floor_parts")) floor_parts_ = about["floor_parts"].text();
    has_taken_cells_ = kind_ == YAW && dim_ == 2 && stamp.empty();
    if (has_taken_cells_) {
      // On a floor, the cells seen from above are not those that the robot may touch.
      std::vector<Index> cells = this->shape();
      if (has_floor_) cells.push_back(layers_ = about["scene_layers"].numbers<Index>()[0]);
      taken_ = folder.array(has_floor_ ? "scene_outer" : "outer", "bool", cells);
    }
    if (!folder.has("distances")) return;
    distances_ = folder.array("distances", "float32", shape);
    distance_boxes_ = folder.array("distance_boxes", "float64", {slices_, 2, dim_}).numbers<double>();
  }

  /// Read the grid, which has one layer of cells in the plane.
  void read_grid(const detail::Json& about, const std::vector<Index>& shape) {
    const std::vector<double> corner = about["lower"].numbers<double>();
    dim_ = static_cast<int>(corner.size());
    spacing_ = about["spacing"].numbers<double>()[0];
    margin_ = about["margin_m"].numbers<double>()[0];
    if ((dim_ != 2 && dim_ != 3) || shape.size() != dim() || !(spacing_ > 0.0)) detail::refuse("its grid is none");
    if (!(margin_ >= 0.0)) detail::refuse("its margin is negative");
    upper_[0] = spacing_;
    for (int axis = 3 - dim_; axis < 3; ++axis) {
      cells_[axis] = shape[axis + dim_ - 3];
      lower_[axis] = corner[axis + dim_ - 3];
      upper_[axis] = lower_[axis] + spacing_ * static_cast<double>(cells_[axis]);
      const double farthest = std::max(std::abs(lower_[axis]), std::abs(upper_[axis])) / spacing_;
      if (!(farthest <= detail::MAX_COORDINATE)) detail::refuse("its grid is too far from the origin");
    }
  }

  void read_rotations(const detail::Folder& folder, Index rotations) {
    axes_ = folder.about["axes"].words();
    kind_ = static_cast<Kind>(axes_.size() - dim());
    if (kind_ != FIXED && kind_ != YAW && kind_ != QUATERNION) detail::refuse("its axes do not match its grid");
    for (const std::string& unit : folder.about["units"].words())
      if (unit != "m" && unit != "rad") detail::refuse("its units are others than m and rad");
    slice_of_ = folder.array("slice_of", "int64", {rotations}).numbers<Index>();
    const auto is_lost = [&](Index slice) { return slice < 0 || slice >= slices_; };
    if (std::any_of(slice_of_.begin(), slice_of_.end(), is_lost)) detail::refuse("a rotation cell has no slice");
    if (kind_ == FIXED && rotations != 1) detail::refuse("it has too many rotation cells");
    if (kind_ == QUATERNION) make_quaternion_borders(rotations);
    if (kind_ != YAW) return;
    const std::vector<double> bounds = folder.array("yaw_bounds", "float64", {rotations, 2}).numbers<double>();
    for (Index k = 0; k < rotations; ++k) borders_.push_back(bounds[2 * k]);
    borders_.push_back(borders_[0] + detail::TWO_PI);
    const auto does_not_ascend = [](double low, double high) { return !(low < high); };  // NaN does not
    if (std::adjacent_find(borders_.begin(), borders_.end(), does_not_ascend) != borders_.end() ||
        !(std::abs(borders_[0]) <= detail::TWO_PI) ||
        !(std::abs(bounds.back() - borders_.back()) <= 2.0 * detail::ANGLE_SLACK))
      detail::refuse("its yaw cells do not ascend over one turn");
  }

  /// Make the borders of the quotients of quaternions: tangents of equal angles.
  void make_quaternion_borders(Index rotations) {
    Index n = 1;
    while (4 * n * n * n < rotations) ++n;
    if (4 * n * n * n != rotations) detail::refuse("its number of rotation cells is not four times a cube");
    const double step = 2.0 / static_cast<double>(n);
    const auto tangent = [&](Index k) { return std::tan(detail::QUARTER_PI * (static_cast<double>(k) * step - 1.0)); };
    borders_ = {-1.0};
    for (Index k = 1; k < n; ++k) borders_.push_back((tangent(k) - tangent(n - k)) / 2.0);
    borders_.push_back(1.0);
  }

  void read_exterior(const std::string& path, const detail::Folder& folder, bool check_digest) {
    outside_ = folder.about["outside"].text();
    if (!folder.is_tiled()) return read_exterior(folder);
    if (::access((path + "/whole").c_str(), F_OK) != 0)
      detail::refuse("it is not complete: run the same build again to finish it");
    const detail::Folder whole(path + "/whole", check_digest);
    const bool is_same = whole.is_tiled() && whole.about["tiles"]["stamp"].text() == folder.about["tiles"]["stamp"].text();
    if (!is_same) detail::refuse("its folder 'whole' is of another map");
    read_exterior(whole);
  }

  void read_exterior(const detail::Folder& folder) {
    const std::vector<Index> numbers = folder.array("exterior", "int64", {slices_, 2 * dim_ + 1}).numbers<Index>();
    for (auto row = numbers.begin(); row != numbers.end(); row += 2 * dim_ + 1) {
      Exterior exterior;
      std::copy(row, row + dim_, exterior.first.end() - dim_);
      std::copy(row + dim_, row + 2 * dim_, exterior.last.end() - dim_);
      const Index beyond = row[2 * dim_];
      const bool is_possible =
          beyond == (outside_ == "free" ? FREE : MIXED) || (beyond == BLOCKED && outside_ == "blocked");
      if (!is_possible) detail::refuse("its exterior contradicts the space outside");
      exterior.beyond = static_cast<State>(beyond);
      exterior_.push_back(exterior);
    }
  }

  /// Read the robot's shape, a text of JSON within a text, and the frame.
  void read_robot(const detail::Json& about) {
    if (about.has("frame_id")) frame_id_ = about["frame_id"].text();
    const std::string quoted = about["robot"].text();
    for (std::size_t k = 0; k < quoted.size(); ++k) {
      if (quoted[k] == '\\' && k + 1 < quoted.size()) ++k;
      robot_ += quoted[k];
    }
  }

  void read_tiles(const std::string& path, const detail::Json& layout, bool check_digest) {
    const std::vector<Index> side = layout["side"].numbers<Index>();
    if (side.size() != dim()) detail::refuse("its tiles are none");
    const Index halo = std::clamp<Index>(*std::min_element(side.begin(), side.end()) / 16, 4, 64);
    tiles_.reset(new Tiles{path, layout["stamp"].text(), check_digest, halo});
    Index total = 1;
    for (int axis = 3 - dim_; axis < 3; ++axis) {
      tiles_->side[axis] = std::min(side[axis + dim_ - 3], cells_[axis]);
      tiles_->counts[axis] = (cells_[axis] - 1) / tiles_->side[axis] + 1;
      total *= tiles_->counts[axis];
      if (total > detail::MAX_TILES) detail::refuse("it has more than 2^22 tiles");
    }
    tiles_->open = std::make_unique<std::atomic<const Map*>[]>(total);
  }

  /// Return the tile with an index along each axis, and open it if this is the first query of it.
  const Map& find_tile(const Cell& index) const {
    const Index number = (index[0] * tiles_->counts[1] + index[1]) * tiles_->counts[2] + index[2];
    std::atomic<const Map*>& place = tiles_->open[number];
    if (place == nullptr) {
      const std::lock_guard<std::mutex> guard(tiles_->opening);
      if (place == nullptr) {
        tiles_->kept.push_back(open_tile(index));
        place = &tiles_->kept.back();
      }
    }
    return *place;
  }

  Map open_tile(const Cell& index) const {
    std::string name = std::to_string(index[3 - dim_]);
    for (int axis = 4 - dim_; axis < 3; ++axis) name += "." + std::to_string(index[axis]);
    Map tile = open(tiles_->path + "/" + name, tiles_->check_digest, tiles_->stamp + " " + name);
    bool is_same = !tile.tiles_ && tile.slices_ == slices_;
    for (int axis = 0; axis < 3; ++axis) {
      const Index begin = index[axis] * tiles_->side[axis];
      tile.first_[axis] = std::max<Index>(begin - tiles_->halo, 0);
      const Index end = std::min(begin + tiles_->side[axis] + tiles_->halo, cells_[axis]);
      is_same = is_same && tile.cells_[axis] == end - tile.first_[axis];
    }
    if (!is_same) throw FileError(tiles_->path + "/" + name + ": is a tile of another size");
    return tile;
  }

  void check_usable(const double* q) const {
    if (is_usable(q)) return;
    throw InputError("cspace: numbers must be finite, a yaw at most 2^20, and the norm of a quaternion 1");
  }
  const double* check_size(const std::vector<double>& q) const {
    if (q.size() != size()) throw InputError("cspace: a configuration has " + std::to_string(size()) + " numbers");
    return q.data();
  }

  /// Return a position, which is in the middle of the layer in the plane.
  Row position_of(const double* q) const { return dim_ == 2 ? Row{0.5 * spacing_, q[0], q[1]} : Row{q[0], q[1], q[2]}; }
  Quaternion rotation_of(const double* q) const { return {q[dim_], q[dim_ + 1], q[dim_ + 2], q[dim_ + 3]}; }

  Row in_cells(const Row& p) const {
    return {(p[0] - lower_[0]) / spacing_, (p[1] - lower_[1]) / spacing_, (p[2] - lower_[2]) / spacing_};
  }

  /// Return the states of a run of cells along the last axis; lower `count` to the number of cells that are there.
  const unsigned char* run_of(Index s, Index i, Index j, Index k, Index& count) const {
    if (!tiles_) return states_.at(s, (i * cells_[1] + j) * cells_[2] + k);
    const Cell index = {i / tiles_->side[0], j / tiles_->side[1], k / tiles_->side[2]};
    const Map& tile = find_tile(index);
    count = std::min(count, (index[2] + 1) * tiles_->side[2] - k);
    return tile.run_of(s, i - tile.first_[0], j - tile.first_[1], k - tile.first_[2], count);
  }

  State state_at(Index s, const Row& position) const {
    const Row c = in_cells(position);
    Cell cell;
    if (c[0] >= 0.0 && c[1] >= 0.0 && c[2] >= 0.0 && c[0] < cells_[0] && c[1] < cells_[1] && c[2] < cells_[2]) {
      for (int axis = 0; axis < 3; ++axis) cell[axis] = static_cast<Index>(c[axis]);
    } else {
      // Outside the grid, or on its upper border.
      const Exterior& exterior = exterior_[s];
      bool is_in_grid = true, is_in_box = true;
      for (int axis = 0; axis < 3; ++axis) {
        cell[axis] = static_cast<Index>(std::floor(std::clamp(c[axis], -detail::MAX_CELL, detail::MAX_CELL)));
        if (cell[axis] == cells_[axis] && position[axis] <= upper_[axis]) --cell[axis];
        is_in_grid = is_in_grid && cell[axis] >= 0 && cell[axis] < cells_[axis];
        is_in_box = is_in_box && exterior.first[axis] <= cell[axis] && cell[axis] <= exterior.last[axis];
      }
      if (!is_in_grid) return is_in_box ? MIXED : exterior.beyond;
    }
    Index count = 1;
    const unsigned char state = *run_of(s, cell[0], cell[1], cell[2], count);
    return state <= BLOCKED ? static_cast<State>(state) : MIXED;
  }

  Index slice_of(const double* q) const {
    if (kind_ == FIXED) return slice_of_[0];
    if (kind_ == YAW) return slice_of_[find_cell(q[dim_])];
    return slice_of_[std::get<Index>(find_parts(rotation_of(q)))];
  }

  /// Return the last cell whose border is not above a value, or cell 0; try a guess first.
  Index cell_above(double value, double guess) const {
    const double last = static_cast<double>(borders_.size() - 2);
    const Index cell = static_cast<Index>(std::min(last, std::max(0.0, guess)));
    if (borders_[cell] <= value && value < borders_[cell + 1]) return cell;
    return std::upper_bound(borders_.begin() + 1, borders_.end() - 1, value) - borders_.begin() - 1;
  }

  /// Wrap a yaw into the range of the cells, up to rounding.
  double wrap_to_cells(double yaw) const {
    return yaw - std::floor((yaw - borders_[0]) / detail::TWO_PI) * detail::TWO_PI;
  }
  Index find_cell(double yaw) const {
    yaw = wrap_to_cells(yaw);
    return cell_above(yaw, (yaw - borders_[0]) * (static_cast<double>(slice_of_.size()) / detail::TWO_PI));
  }

  /// Return the part of an axis that contains a quotient; the guess has the arc tangent to a few thousandths.
  Index find_part(double quotient) const {
    const double angle = quotient * (detail::QUARTER_PI + 0.273 * (1.0 - std::abs(quotient)));
    return cell_above(quotient, (angle / detail::QUARTER_PI + 1.0) * 0.5 * static_cast<double>(borders_.size() - 1));
  }

  /// Return the chart of a quaternion, its component of the largest modulus; the parts of the quotients by it; the
  /// cell.
  std::tuple<int, Cell, Index> find_parts(const Quaternion& q) const {
    int chart = 0;
    for (int component = 1; component < 4; ++component)
      if (std::abs(q[component]) > std::abs(q[chart])) chart = component;
    const Index n = static_cast<Index>(borders_.size()) - 1;
    Index cell = chart;
    Cell parts;
    for (int axis = 0; axis < 3; ++axis) {
      parts[axis] = find_part(q[detail::OTHER_COMPONENTS[chart][axis]] / q[chart]);
      cell = cell * n + parts[axis];
    }
    return {chart, parts, cell};
  }

  /// Return the cell at a point of a chord, with the fraction `done` before it; go on to where the chord leaves the
  /// cell.
  Index next_part(const Quaternion& first, const Quaternion& end, double& done, bool& has_next) const {
    const Quaternion point = detail::mix(first, detail::mix(end, first, 1.0, -1.0), 1.0, done);
    const auto [chart, parts, cell] = find_parts(point);
    const double sign = std::copysign(1.0, point[chart]);
    double share = 1.0;
    for (int axis = 0; axis < 3; ++axis) {
      const int other = detail::OTHER_COMPONENTS[chart][axis];
      for (const double side : {-1.0, 1.0}) {
        // Zero on the lower or upper border of the cell, and negative inside.
        const double border = borders_[parts[axis] + (side > 0.0)] + side * detail::QUOTIENT_SLACK;
        const double beyond = side * sign * (point[other] - border * point[chart]);
        const double beyond_at_end = side * sign * (end[other] - border * end[chart]);
        if (beyond_at_end > 0.0) share = std::min(share, beyond / (beyond - beyond_at_end));
      }
    }
    done += (1.0 - done) * share;
    has_next = share < 1.0;
    return cell;
  }

  /// Return true if a motion is FREE, with all positions within `radii` of it and rotations within `turn`.
  bool tube_is_free(const double* q0, const double* q1, const Row& radii, double turn) const {
    const Row p0 = position_of(q0), p1 = position_of(q1);
    if (kind_ == QUATERNION) return quaternion_edge_is_free(p0, rotation_of(q0), p1, rotation_of(q1), radii);
    if (state_at(slice_of(q1), p1) != FREE) return false;
    return kind_ == YAW ? yaw_edge_is_free(p0, q0[dim_], p1, q1[dim_], radii, turn)
                        : segment_is_free(slice_of_[0], p0, p1, 0.0, 1.0, radii);
  }

  bool yaw_edge_is_free(const Row& p0, double yaw0, const Row& p1, double yaw1, const Row& radii, double stray) const {
    const Index count = static_cast<Index>(slice_of_.size());
    const double start = wrap_to_cells(yaw0);
    double angle = yaw1 - yaw0;
    angle -= std::floor(angle / detail::TWO_PI) * detail::TWO_PI;
    if (angle > detail::PI) angle -= detail::TWO_PI;
    // If two arcs are equally short up to rounding, the second one turns the other way.
    const int arcs = detail::PI - std::abs(angle) <= detail::ANGLE_SLACK ? 2 : 1;
    for (int arc = 0; arc < arcs; ++arc) {
      if (arc == 1) angle += angle > 0.0 ? -detail::TWO_PI : detail::TWO_PI;
      const double lowest = std::min(start, start + angle) - stray, highest = std::max(start, start + angle) + stray;
      // Begin with the first cell, widened by ANGLE_SLACK, that contains the lowest yaw.
      double turn = std::floor((lowest - borders_[0]) / detail::TWO_PI);
      Index cell = find_cell(lowest);
      if (lowest - (borders_[cell] + turn * detail::TWO_PI) <= detail::ANGLE_SLACK) --cell;
      for (;; ++cell) {
        if (cell < 0 || cell == count) {
          turn += cell < 0 ? -1.0 : 1.0;
          cell = cell < 0 ? count - 1 : 0;
        }
        const double low = borders_[cell] + turn * detail::TWO_PI - detail::ANGLE_SLACK;
        const double high = borders_[cell + 1] + turn * detail::TWO_PI + detail::ANGLE_SLACK;
        if (low > highest) break;
        const double at_low = angle == 0.0 ? 0.0 : std::clamp((low - stray - start) / angle, 0.0, 1.0);
        const double at_high = angle == 0.0 ? 1.0 : std::clamp((high + stray - start) / angle, 0.0, 1.0);
        const double enter = std::min(at_low, at_high), leave = std::max(at_low, at_high);
        if (!segment_is_free(slice_of_[cell], p0, p1, enter, leave, radii)) return false;
      }
    }
    return true;
  }

  bool quaternion_edge_is_free(const Row& p0, const Quaternion& r0, const Row& p1, const Quaternion& r1,
                               const Row& radii) const {
    const Quaternion a = detail::normalise(r0, 1.0), target = detail::normalise(r1, 1.0);
    const double cosine = detail::dot_product(a, target);
    const int arcs = std::abs(cosine) <= detail::QUOTIENT_SLACK ? 2 : 1;
    for (int arc = 0; arc < arcs; ++arc) {
      // Both signs of a quaternion are one rotation; arc 0 leads to the nearer one.
      const bool is_flipped = (cosine < 0.0) != (arc == 1);
      const Quaternion b = is_flipped ? detail::normalise(target, -1.0) : target;
      const Quaternion chord = detail::mix(b, a, 1.0, -1.0), total = detail::mix(b, a, 1.0, 1.0);
      const double tangent = std::sqrt(detail::dot_product(chord, chord) / detail::dot_product(total, total));
      if (!(tangent < 2.0)) return false;
      // OMPL's rotation may jump along a tiny arc, so each part must be FREE everywhere.
      const bool is_tiny = detail::dot_product(a, b) > 1.0 - detail::OMPL_EQUALITY_SLACK;
      double done = 0.0, enter = 0.0, leave;
      for (bool has_next = true; has_next; enter = leave) {
        const Index cell = next_part(a, b, done, has_next);
        // The time at which SLERP passes the point of the chord. It ascends, as cells are widened by more than
        // rounding.
        const double slerp = std::atan((2.0 * done - 1.0) * tangent) / std::atan(tangent);
        leave = has_next ? std::min(0.5 + 0.5 * slerp, 1.0) : 1.0;
        if (!segment_is_free(slice_of_[cell], p0, p1, is_tiny ? 0.0 : enter, is_tiny ? 1.0 : leave, radii)) return false;
      }
    }
    return true;
  }

  /// Return true if all cells of a slice near a motion from p0 to p1 are FREE from time `enter` to `leave`.
  ///
  /// They are those within `radii` along each axis, metres, and SLACK.
  bool segment_is_free(Index s, const Row& p0, const Row& p1, double enter, double leave, const Row& radii) const {
    const Row first = detail::position_along(p0, p1, enter), last = detail::position_along(p0, p1, leave);
    const Row p = in_cells(first), q = in_cells(last);
    bool inside = true;
    double total = 0.0;
    Row reach;
    for (int axis = 0; axis < 3; ++axis) {
      reach[axis] = radii[axis] / spacing_ + detail::SLACK;
      // Rounding counts where a radius is added. A mere segment may lie on the border of the grid.
      const double radius = radii[axis] > 0.0 ? reach[axis] * spacing_ : 0.0;
      inside = inside && std::min(first[axis], last[axis]) - radius >= lower_[axis];
      inside = inside && std::max(first[axis], last[axis]) + radius <= upper_[axis];
      total += std::abs(p[axis]) + std::abs(q[axis]) + reach[axis];
    }
    if (!(total <= detail::MAX_POSITION)) return false;
    // The closed cells of the grid contain all of a segment inside. Any other segment is proven only if all cells
    // outside both grid and exterior box are FREE.
    const Exterior& exterior = exterior_[s];
    if (!inside && exterior.beyond != FREE) return false;
    Cell low, high;
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = inside ? 0 : std::min<Index>(exterior.first[axis], 0);
      high[axis] = inside ? cells_[axis] - 1 : std::max(exterior.last[axis], cells_[axis] - 1);
    }
    // Cut the segment into slabs along x, and each slab along y. Each piece touches one run of cells along z.
    const detail::Walk x(p[0], q[0], reach[0]), y(p[1], q[1], reach[1]), z(p[2], q[2], reach[2]);
    Index west, east, left, right, bottom, top;
    x.cells_between(0.0, 1.0, low[0], high[0], west, east);
    for (Index i = west; i <= east; ++i) {
      double start = 0.0, stop = 1.0;
      x.narrow(i, start, stop);
      if (start > stop) continue;
      y.cells_between(start, stop, low[1], high[1], left, right);
      for (Index j = left; j <= right; ++j) {
        double from = start, to = stop;
        y.narrow(j, from, to);
        if (from > to) continue;
        z.cells_between(from, to, low[2], high[2], bottom, top);
        const bool is_free = inside && !tiles_ ? are_free(states_.at(s, (i * cells_[1] + j) * cells_[2]), bottom, top)
                                               : run_is_free(s, i, j, bottom, top);
        if (!is_free) return false;
      }
    }
    return true;
  }

  /// Return true if states `first` to `last` are FREE.
  static bool are_free(const unsigned char* states, Index first, Index last) {
    // Most runs have one or two cells, which no loop tests: processors guess wrong when it ends.
    for (Index k = first + 1; k < last; ++k)
      if (states[k] != FREE) return false;
    return (states[first] | states[last]) == FREE;
  }

  /// Return true if cells `first` to `last` along the last axis are FREE; outside the grid, those in the box are MIXED.
  bool run_is_free(Index s, Index i, Index j, Index first, Index last) const {
    const bool in_grid = 0 <= i && i < cells_[0] && 0 <= j && j < cells_[1];
    const Index stop = in_grid ? std::min(last, cells_[2] - 1) : -1;
    for (Index count, k = std::max<Index>(first, 0); k <= stop; k += count) {
      count = stop - k + 1;
      const unsigned char* states = run_of(s, i, j, k, count);
      if (!are_free(states, 0, count - 1)) return false;
    }
    if (in_grid && first >= 0 && last < cells_[2]) return true;
    const Exterior& box = exterior_[s];
    if (!(box.first[0] <= i && i <= box.last[0] && box.first[1] <= j && j <= box.last[1])) return true;
    const Index begin = std::max(first, box.first[2]), end = std::min(last, box.last[2]);
    return begin > end || (in_grid && begin >= 0 && end < cells_[2]);
  }

  double clearance_at(Index s, const Row& position) const {
    if (state_at(s, position) != FREE) return 0.0;
    const Row c = in_cells(position);
    Row place, nearest;
    double box_square = 0.0, beyond_square = 0.0, spread = 0.0;
    for (int axis = 3 - dim_; axis < 3; ++axis) {
      place[axis] = std::clamp(c[axis], -detail::MAX_CELL, detail::MAX_CELL) - 0.5;
      nearest[axis] = std::clamp(place[axis], 0.0, static_cast<double>(cells_[axis] - 1));
      const double cell_place = place[axis] + 0.5;
      const double* corners = &distance_boxes_[s * 2 * dim_ + axis - (3 - dim_)];
      const double box_gap = std::max({0.0, corners[0] - cell_place, cell_place - corners[dim_]});
      box_square += box_gap * box_gap;
      const double beyond = place[axis] - nearest[axis];
      beyond_square += beyond * beyond;
      const double share = nearest[axis] - std::floor(nearest[axis]);
      spread += share * (1.0 - share);
    }
    double best = std::sqrt(box_square) * detail::ROUNDING_FACTOR;
    double mean_square = 0.0;
    for (int corner = 0; corner < 1 << dim_; ++corner) {
      Index cell = 0;
      double weight = 1.0, gap_square = 0.0;
      for (int axis = 3 - dim_; axis < 3; ++axis) {
        // Each bit of the corner selects the lower or the upper center along an axis.
        const bool is_upper = (corner >> (axis - (3 - dim_))) & 1;
        const double center = std::floor(nearest[axis]), share = nearest[axis] - center;
        const Index k = std::min(static_cast<Index>(center) + is_upper, cells_[axis] - 1);
        weight *= is_upper ? share : 1.0 - share;
        const double gap = place[axis] - static_cast<double>(k);
        gap_square += gap * gap;
        cell = cell * cells_[axis] + k;
      }
      const float stored = *reinterpret_cast<const float*>(distances_.at(s, cell));
      const double distance = static_cast<double>(stored) * detail::ROUNDING_FACTOR;
      best = std::max(best, distance - std::sqrt(gap_square));
      mean_square += weight * distance * distance;
    }
    if (mean_square > spread) best = std::max(best, std::sqrt(mean_square - spread) - std::sqrt(beyond_square));
    return std::max(0.0, best - 4.0 * detail::SLACK) * spacing_;
  }

  Kind kind_ = FIXED;
  int dim_ = 0;
  std::vector<std::string> axes_;
  Cell cells_ = {1, 1, 1};  ///< number of cells along each axis; 1 along the first one in the plane
  Cell first_ = {0, 0, 0};  ///< of a tile: its first cell in the whole map
  Row lower_{}, upper_{};
  double spacing_ = 0.0, margin_ = 0.0;
  std::string outside_, frame_id_, robot_;
  Index slices_ = 0;
  std::vector<double> borders_;     ///< of yaw cells, or of the quotients of quaternions
  std::vector<Index> slice_of_;     ///< of each rotation cell
  std::vector<Exterior> exterior_;  ///< of each slice
  detail::Array states_;            ///< unless the map has tiles
  std::unique_ptr<Tiles> tiles_;
  bool has_taken_cells_ = false, has_floor_ = false;
  std::string floor_parts_;
  Index layers_ = 1;      ///< of the workspace
  detail::Array taken_;  ///< cells of the workspace that may meet obstacles
  detail::Array distances_;
  std::vector<double> distance_boxes_;  ///< lower and upper corner, of each slice
};

}  // namespace cspace

#if defined(__clang__)
#pragma STDC FP_CONTRACT DEFAULT
#elif defined(__FP_FAST_FMA)
#pragma GCC pop_options
#endif

#endif  // CSPACE_MAP_HPP
