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

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cfloat>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <locale>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#ifdef CSPACE_ZSTD
#include <zstd.h>
#endif

#if defined(__FAST_MATH__)
#error "cspace/map.hpp: proofs need IEEE arithmetic; compile without -ffast-math"
#endif
static_assert(FLT_EVAL_METHOD == 0, "cspace/map.hpp: proofs need double arithmetic without excess precision");
static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "cspace/map.hpp: saved maps are little-endian");

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

/// What is proven of a configuration.
enum State : std::uint8_t { FREE = 0, MIXED = 1, BLOCKED = 2 };

/// A saved map that is missing, damaged, incomplete or of another version.
class FileError : public std::runtime_error {
 public:
  FileError(const std::string& file, const std::string& problem) : std::runtime_error(file + ": " + problem), file_(file) {}

  /// The name of the file or folder; the text of the error begins with it.
  const std::string& file() const { return file_; }

 private:
  std::string file_;
};

/// Numbers that are no configuration of the map: not finite, or with a wrong length, a norm that is not 1, or a huge yaw.
class InputError : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

/// What `Map` is made of; not for users.
namespace detail {

using Index = std::int64_t;
using Row = std::array<double, 3>;
using Cell = std::array<Index, 3>;
using Quaternion = std::array<double, 4>;

constexpr Index FORMAT_VERSION = 6;

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
constexpr Index WRITTEN_CHUNK_BYTES = 1 << 24;
constexpr Index MAX_TILES = 1 << 22;
constexpr int OTHER_COMPONENTS[4][3] = {{1, 2, 3}, {0, 2, 3}, {0, 1, 3}, {0, 1, 2}};

/// Throw the error for content that is no map; `Map::open` adds the name of the file.
[[noreturn]] inline void refuse(const std::string& problem) { throw std::runtime_error(problem); }

/// Multiply two counts; throw if the product does not fit.
inline Index multiply(Index a, Index b) {
  if (b != 0 && a > (Index(1) << 62) / b) refuse("its arrays are too large");
  return a * b;
}

// ---- files -----------------------------------------------------------------------------------------------------------

/// A file mapped into memory.
class File {
 public:
  explicit File(const std::string& path) {
    const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (file < 0) throw FileError(path, std::strerror(errno));
    struct stat status;
    const bool is_plain = ::fstat(file, &status) == 0 && S_ISREG(status.st_mode);
    size_ = is_plain ? static_cast<std::size_t>(status.st_size) : 0;
    void* mapped = size_ > 0 ? ::mmap(nullptr, size_, PROT_READ, MAP_PRIVATE, file, 0) : nullptr;
    ::close(file);
    if (!is_plain) throw FileError(path, "is not a plain file");
    if (mapped == MAP_FAILED) throw FileError(path, "cannot be mapped into memory");
    data_ = static_cast<const unsigned char*>(mapped);
  }
  ~File() {
    if (size_ > 0) ::munmap(const_cast<unsigned char*>(data_), size_);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;

  const unsigned char* data() const { return data_; }
  std::size_t size() const { return size_; }
  std::string text() const { return size_ > 0 ? std::string(reinterpret_cast<const char*>(data_), size_) : std::string(); }

 private:
  const unsigned char* data_ = nullptr;
  std::size_t size_ = 0;
};

/// SHA-256, as in FIPS 180-4.
class Sha256 {
 public:
  void add(const void* data, std::size_t size) {
    const unsigned char* bytes = static_cast<const unsigned char*>(data);
    total_ += size;
    while (size > 0) {
      if (filled_ == 0 && size >= 64) {
        compress(bytes);
        bytes += 64;
        size -= 64;
        continue;
      }
      const std::size_t taken = std::min(size, 64 - filled_);
      std::memcpy(block_ + filled_, bytes, taken);
      filled_ += taken;
      bytes += taken;
      size -= taken;
      if (filled_ == 64) {
        compress(block_);
        filled_ = 0;
      }
    }
  }
  void add(const std::string& text) { add(text.data(), text.size()); }

  /// Return the digest as 64 hexadecimal digits; nothing may be added afterwards.
  std::string finish() {
    const std::uint64_t bits = total_ * 8;
    add(std::string(1, '\x80'));
    while (filled_ != 56) add(std::string(1, '\0'));
    unsigned char length[8];
    for (int k = 0; k < 8; ++k) length[k] = static_cast<unsigned char>(bits >> (56 - 8 * k));
    add(length, 8);
    std::string digits;
    for (const std::uint32_t word : words_)
      for (int shift = 28; shift >= 0; shift -= 4) digits += "0123456789abcdef"[(word >> shift) & 15];
    return digits;
  }

 private:
  static std::uint32_t rotate(std::uint32_t word, int by) { return (word >> by) | (word << (32 - by)); }

  void compress(const unsigned char* block) {
    static const std::uint32_t constants[64] = {
        0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5, 0xd807aa98, 0x12835b01,
        0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174, 0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc,
        0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da, 0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147,
        0x06ca6351, 0x14292967, 0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
        0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070, 0x19a4c116, 0x1e376c08,
        0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3, 0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208,
        0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2};
    std::uint32_t w[64];
    for (int t = 0; t < 16; ++t) {
      const unsigned char* four = block + 4 * t;
      w[t] = std::uint32_t(four[0]) << 24 | std::uint32_t(four[1]) << 16 | std::uint32_t(four[2]) << 8 | four[3];
    }
    for (int t = 16; t < 64; ++t) {
      const std::uint32_t s0 = rotate(w[t - 15], 7) ^ rotate(w[t - 15], 18) ^ (w[t - 15] >> 3);
      const std::uint32_t s1 = rotate(w[t - 2], 17) ^ rotate(w[t - 2], 19) ^ (w[t - 2] >> 10);
      w[t] = w[t - 16] + s0 + w[t - 7] + s1;
    }
    std::array<std::uint32_t, 8> h = words_;
    for (int t = 0; t < 64; ++t) {
      const std::uint32_t s1 = rotate(h[4], 6) ^ rotate(h[4], 11) ^ rotate(h[4], 25);
      const std::uint32_t t1 = h[7] + s1 + ((h[4] & h[5]) ^ (~h[4] & h[6])) + constants[t] + w[t];
      const std::uint32_t s0 = rotate(h[0], 2) ^ rotate(h[0], 13) ^ rotate(h[0], 22);
      const std::uint32_t t2 = s0 + ((h[0] & h[1]) ^ (h[0] & h[2]) ^ (h[1] & h[2]));
      h = {t1 + t2, h[0], h[1], h[2], h[3] + t1, h[4], h[5], h[6]};
    }
    for (int k = 0; k < 8; ++k) words_[k] += h[k];
  }

  std::array<std::uint32_t, 8> words_ = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                         0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
  unsigned char block_[64];
  std::size_t filled_ = 0;
  std::uint64_t total_ = 0;
};

/// A JSON value; the parser refuses all that RFC 8259 does not allow, except NaN, and names that occur twice.
class Json {
 public:
  static Json parse(const std::string& text) {
    Parser parser{text, 0};
    Json value = parser.read(0);
    parser.skip_spaces();
    if (parser.at != text.size()) parser.fail();
    return value;
  }

  bool has(const std::string& name) const { return find(name) != nullptr; }

  /// Return the member of an object.
  const Json& operator[](const std::string& name) const {
    const Json* member = find(name);
    if (member == nullptr) refuse("it has no '" + name + "'");
    return *member;
  }

  const std::vector<Json>& list() const { return expect(LIST, "list").items_; }
  const std::string& text() const { return expect(TEXT, "text").text_; }
  bool boolean() const { return expect(BOOLEAN, "true or false").text_ == "true"; }

  double number() const {
    double value = NAN;
    std::istringstream stream(expect(NUMBER, "number").text_);
    stream.imbue(std::locale::classic());  // the program's locale may have a decimal comma
    stream >> value;
    if (stream.fail() || !stream.eof()) refuse("it has the number " + text_.substr(0, 40));
    return value;
  }

  /// Return a whole number of at least `lowest`, below 2^53.
  Index integer(Index lowest) const {
    const std::string& digits = expect(NUMBER, "whole number").text_;
    if (digits.size() > 15 || digits.find_first_not_of("0123456789") != std::string::npos || std::stoll(digits) < lowest)
      refuse("it has the number " + digits.substr(0, 40));
    return std::stoll(digits);
  }

  std::vector<Index> integers(Index lowest) const {
    std::vector<Index> values;
    for (const Json& item : list()) values.push_back(item.integer(lowest));
    return values;
  }

 private:
  enum Kind { NOTHING, BOOLEAN, NUMBER, TEXT, LIST, OBJECT };

  struct Parser {
    const std::string& text;
    std::size_t at;

    [[noreturn]] void fail() const { refuse("its metadata are no JSON, at byte " + std::to_string(at)); }
    char next() const { return at < text.size() ? text[at] : '\0'; }
    void skip_spaces() { at = std::min(text.find_first_not_of(" \t\r\n", at), text.size()); }
    void take(char expected) {
      if (next() != expected) fail();
      ++at;
    }
    bool skip(const std::string& word) {
      if (text.compare(at, word.size(), word) != 0) return false;
      at += word.size();
      return true;
    }

    Json read(int depth) {
      if (depth > 64) fail();
      skip_spaces();
      Json value;
      const char first = next();
      if (first == '{' || first == '[') {
        read_items(value, first == '{', depth);
      } else if (first == '"') {
        value.kind_ = TEXT;
        value.text_ = read_text();
      } else if (skip("true") || skip("false")) {
        value.kind_ = BOOLEAN;
        value.text_ = first == 't' ? "true" : "false";
      } else if (!skip("null") && !skip("NaN") && !skip("Infinity") && !skip("-Infinity")) {
        value.kind_ = NUMBER;
        value.text_ = read_number();
      }
      return value;
    }

    void read_items(Json& value, bool is_object, int depth) {
      value.kind_ = is_object ? OBJECT : LIST;
      const char end = is_object ? '}' : ']';
      ++at;
      skip_spaces();
      while (next() != end) {
        if (!value.items_.empty()) take(',');
        if (is_object) {
          skip_spaces();
          value.names_.push_back(read_text());
          if (std::count(value.names_.begin(), value.names_.end(), value.names_.back()) > 1) fail();
          skip_spaces();
          take(':');
        }
        value.items_.push_back(read(depth + 1));
        skip_spaces();
      }
      ++at;
    }

    std::string read_number() {
      const std::size_t start = at;
      const auto take_digits = [this] {
        if (next() < '0' || next() > '9') fail();
        while (next() >= '0' && next() <= '9') ++at;
      };
      if (next() == '-') ++at;
      if (next() == '0') ++at;
      else take_digits();
      if (next() == '.') {
        ++at;
        take_digits();
      }
      if (next() == 'e' || next() == 'E') {
        ++at;
        if (next() == '+' || next() == '-') ++at;
        take_digits();
      }
      return text.substr(start, at - start);
    }

    std::string read_text() {
      take('"');
      std::string read;
      while (next() != '"') {
        if (static_cast<unsigned char>(next()) < 0x20) fail();  // also at the end
        if (next() != '\\') {
          read += text[at++];
          continue;
        }
        ++at;
        const char escape = next();
        ++at;
        const std::size_t which = std::string("\"\\/bfnrt").find(escape);
        if (escape == 'u') append_utf8(read);
        else if (which == std::string::npos) fail();
        else read += "\"\\/\b\f\n\r\t"[which];
      }
      ++at;
      return read;
    }

    unsigned read_hex() {
      unsigned value = 0;
      for (int k = 0; k < 4; ++k, ++at) {
        const std::size_t digit = std::string("0123456789abcdef0123456789ABCDEF").find(next());
        if (next() == '\0' || digit == std::string::npos) fail();
        value = 16 * value + static_cast<unsigned>(digit % 16);
      }
      return value;
    }

    void append_utf8(std::string& out) {
      unsigned code = read_hex();
      if (code >= 0xd800 && code < 0xdc00 && skip("\\u")) code = 0x10000 + ((code & 0x3ff) << 10) + (read_hex() & 0x3ff);
      const int tail = code < 0x80 ? 0 : code < 0x800 ? 1 : code < 0x10000 ? 2 : 3;
      const unsigned marks[] = {0x00, 0xc0, 0xe0, 0xf0};
      out += static_cast<char>(marks[tail] | (code >> (6 * tail)));
      for (int k = tail - 1; k >= 0; --k) out += static_cast<char>(0x80 | ((code >> (6 * k)) & 0x3f));
    }
  };

  const Json* find(const std::string& name) const {
    expect(OBJECT, "object");
    const auto found = std::find(names_.begin(), names_.end(), name);
    return found == names_.end() ? nullptr : &items_[static_cast<std::size_t>(found - names_.begin())];
  }

  const Json& expect(Kind kind, const char* name) const {
    if (kind_ != kind) refuse(std::string("its metadata lack a ") + name);
    return *this;
  }

  Kind kind_ = NOTHING;
  std::string text_;
  std::vector<std::string> names_;  ///< of the items, in an object
  std::vector<Json> items_;
};

/// Split a text at spaces.
inline std::vector<std::string> split(const std::string& text) {
  std::istringstream stream(text);
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

// ---- arrays ----------------------------------------------------------------------------------------------------------

/// An array in the order of C, in chunks of whole rows of at most 16 MiB.
class Array {
 public:
  Array() = default;
  Array(const std::vector<Index>& shape, Index item) : shape_(shape), item_(item), chunk_shape_(shape) {
    Index after = 1;
    for (std::size_t axis = shape.size(); axis-- > 0;) after = multiply(after, shape[axis]);
    size_ = after;
    multiply(size_, item);
    for (std::size_t axis = 0; axis < shape.size(); ++axis) {
      pass_ = after;
      after /= shape[axis];
      chunk_shape_[axis] = std::max<Index>(1, std::min(shape[axis], WRITTEN_CHUNK_BYTES / (after * item)));
      chunk_ = chunk_shape_[axis] * after;
      chunks_per_pass_ = (shape[axis] + chunk_shape_[axis] - 1) / chunk_shape_[axis];
      if (after * item <= WRITTEN_CHUNK_BYTES) break;
    }
    slice_ = size_ / shape[0];
    has_whole_slices_ = pass_ == size_;
  }

  const std::vector<Index>& shape() const { return shape_; }
  const std::vector<Index>& chunk_shape() const { return chunk_shape_; }
  Index chunk_bytes() const { return chunk_ * item_; }
  Index size() const { return size_; }
  bool empty() const { return size_ == 0; }

  /// Take the next chunk, unpacked or as a file.
  void add_chunk(std::shared_ptr<const File> file, std::vector<unsigned char> unpacked) {
    chunks_.push_back(file ? file->data() : unpacked.data());
    if (file) files_.push_back(std::move(file));
    else unpacked_.push_back(std::move(unpacked));
    if (has_whole_slices_)
      for (Index k = 0; k < chunk_shape_[0] && static_cast<Index>(slices_.size()) < shape_[0]; ++k)
        slices_.push_back(chunks_.back() + k * slice_ * item_);
  }

  /// Return the address of an entry; those of its row follow it.
  const unsigned char* at(Index entry) const {
    const Index in_pass = entry % pass_;
    const Index chunk = entry / pass_ * chunks_per_pass_ + in_pass / chunk_;
    return chunks_[static_cast<std::size_t>(chunk)] + in_pass % chunk_ * item_;
  }

  /// Return the address of an entry of a slice, an index along the first axis.
  const unsigned char* at(Index slice, Index entry) const {
    if (has_whole_slices_) return slices_[static_cast<std::size_t>(slice)] + entry * item_;
    return at(slice * slice_ + entry);
  }

  std::vector<double> doubles() const {
    std::vector<double> values(static_cast<std::size_t>(size_));
    for (Index k = 0; k < size_; ++k) std::memcpy(&values[static_cast<std::size_t>(k)], at(k), 8);
    return values;
  }

  std::vector<Index> integers() const {
    std::vector<Index> values(static_cast<std::size_t>(size_));
    for (Index k = 0; k < size_; ++k) std::memcpy(&values[static_cast<std::size_t>(k)], at(k), 8);
    return values;
  }

 private:
  std::vector<Index> shape_;
  Index item_ = 1;  ///< bytes of an entry
  std::vector<Index> chunk_shape_;
  Index size_ = 0, slice_ = 0;                           ///< entries of the array, and of a slice
  Index pass_ = 1, chunk_ = 1, chunks_per_pass_ = 1;     ///< entries, and chunks, along the axis that chunks divide
  bool has_whole_slices_ = false;                        ///< true if no slice is in two chunks
  std::vector<const unsigned char*> chunks_, slices_;
  std::vector<std::shared_ptr<const File>> files_;
  std::vector<std::vector<unsigned char>> unpacked_;
};

/// The type and shape that an array must have.
struct Layout {
  std::string type;
  Index item;
  std::vector<Index> shape;
};

/// A folder with the attributes and arrays of a map.
class Folder {
 public:
  Folder(const std::string& path, bool check_digest) : path_(path), check_digest_(check_digest) {
    std::string root = File(path + "/zarr.json").text();
    attributes = Json::parse(root)["attributes"];
    const std::string form = attributes["format"].text();
    if (form != "cspace-map" && form != "cspace-tiles") refuse("its attributes name another format");
    const Index version = attributes["format_version"].integer(0);
    if (version != FORMAT_VERSION)
      refuse("it has format version " + std::to_string(version) + ", and this header reads version 6 alone");
    is_tiled = form == "cspace-tiles";
    names = split(attributes["arrays"].text());
    given_digest_ = attributes["digest"].text();
    if (given_digest_.size() != 64) refuse("its digest is none");
    if (check_digest) digest_.add(root.replace(root.find(given_digest_), 64, std::string(64, '0')));
  }

  bool has(const std::string& name) const { return std::count(names.begin(), names.end(), name) > 0; }

  /// Read arrays in the order of the attribute `arrays`, with a digest of all files if it is checked.
  std::map<std::string, Array> read(const std::map<std::string, Layout>& wanted) {
    std::map<std::string, Array> arrays;
    for (const std::string& name : names) {
      if (name.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789_") != std::string::npos || arrays.count(name))
        refuse("it has an array '" + name.substr(0, 40) + "'");
      const auto layout = wanted.find(name);
      if (layout != wanted.end()) arrays[name] = read_array(name, &layout->second);
      else if (check_digest_) read_array(name, nullptr);
    }
    for (const auto& [name, layout] : wanted)
      if (!arrays.count(name)) refuse("it lacks the array '" + name + "'");
    if (check_digest_ && digest_.finish() != given_digest_) refuse("its files differ from their digest");
    return arrays;
  }

  Json attributes;
  std::vector<std::string> names;
  bool is_tiled = false;

 private:
  std::shared_ptr<const File> read_file(const std::string& name) {
    const std::shared_ptr<const File> file = std::make_shared<const File>(path_ + "/" + name);
    if (check_digest_) {
      digest_.add("\n" + name + " " + std::to_string(file->size()) + "\n");
      digest_.add(file->data(), file->size());
    }
    return file;
  }

  /// Read an array; without a layout, read its files for the digest.
  Array read_array(const std::string& name, const Layout* layout) {
    const Json metadata = Json::parse(read_file(name + "/zarr.json")->text());
    const std::vector<Index> shape = metadata["shape"].integers(1);
    const std::vector<Index> chunk_shape = metadata["chunk_grid"]["configuration"]["chunk_shape"].integers(1);
    const std::vector<Json>& codecs = metadata["codecs"].list();
    const bool is_compressed = codecs.size() == 2 && codecs[1]["name"].text() == "zstd";
    if (shape.empty() || shape.size() != chunk_shape.size() || metadata["zarr_format"].integer(0) != 3 ||
        metadata["node_type"].text() != "array" || metadata["chunk_grid"]["name"].text() != "regular" ||
        metadata["chunk_key_encoding"]["name"].text() != "default" || codecs.size() != (is_compressed ? 2u : 1u) ||
        codecs[0]["name"].text() != "bytes" || codecs[0]["configuration"]["endian"].text() != "little")
      refuse("its array '" + name + "' is encoded in another way");
    Array array;
    if (layout != nullptr) {
      array = Array(layout->shape, layout->item);
      if (shape != array.shape() || chunk_shape != array.chunk_shape() || metadata["data_type"].text() != layout->type ||
          is_compressed != attributes["compressed"].boolean())
        refuse("its array '" + name + "' has another shape, type or chunks");
    }
    // Files declare any number of chunks, so nothing is allocated before a chunk is there.
    std::vector<Index> place(shape.size(), 0);
    for (bool has_next = true; has_next;) {
      std::string chunk_name = name + "/c";
      for (const Index k : place) chunk_name += "/" + std::to_string(k);
      const std::shared_ptr<const File> file = read_file(chunk_name);
      if (layout != nullptr && is_compressed) array.add_chunk(nullptr, unpack(*file, array.chunk_bytes()));
      else if (layout != nullptr && static_cast<Index>(file->size()) != array.chunk_bytes())
        refuse("its chunk " + chunk_name + " has another size");
      else if (layout != nullptr) array.add_chunk(file, {});
      has_next = false;
      for (std::size_t axis = shape.size(); axis-- > 0 && !has_next;) {
        has_next = ++place[axis] < (shape[axis] + chunk_shape[axis] - 1) / chunk_shape[axis];
        if (!has_next) place[axis] = 0;
      }
    }
    return array;
  }

  static std::vector<unsigned char> unpack(const File& file, Index bytes) {
#ifdef CSPACE_ZSTD
    const std::size_t size = static_cast<std::size_t>(bytes);
    if (file.size() == 0 || ZSTD_getFrameContentSize(file.data(), file.size()) != size) refuse("it has a chunk of another size");
    std::vector<unsigned char> unpacked(size);
    if (ZSTD_decompress(unpacked.data(), size, file.data(), file.size()) != size) refuse("it has a chunk that does not unpack");
    return unpacked;
#else
    static_cast<void>(file);
    static_cast<void>(bytes);
    refuse("it is compressed: define CSPACE_ZSTD and link libzstd, or save it with compress=False");
#endif
  }

  std::string path_;
  bool check_digest_;
  std::string given_digest_;
  Sha256 digest_;
};

// ---- plain arithmetic ------------------------------------------------------------------------------------------------

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

// ---- the map ---------------------------------------------------------------------------------------------------------

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
        if (!run_is_free(s, i, j, std::max(low[2], bottom), std::min(high[2], top))) return false;
      }
    }
    return true;
  }

  /// Return true if cells `first` to `last` along the last axis are FREE; outside the grid, those in the box are MIXED.
  bool run_is_free(Index s, Index i, Index j, Index first, Index last) const {
    const bool in_grid = 0 <= i && i < cells_[0] && 0 <= j && j < cells_[1];
    if (in_grid) {
      const Index stop = std::min(last, cells_[2] - 1);
      for (Index k = std::max<Index>(first, 0); k <= stop;) {
        Index count = stop - k + 1;
        const unsigned char* states = run_of(s, i, j, k, count);
        for (Index n = 0; n < count; ++n)
          if (states[n] != FREE) return false;
        k += count;
      }
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
