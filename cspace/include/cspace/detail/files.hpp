/// @file files.hpp
/// Files of saved maps: JSON, SHA-256, and arrays in chunks. `map.hpp` includes it; it is not for users.
#ifndef CSPACE_DETAIL_FILES_HPP
#define CSPACE_DETAIL_FILES_HPP

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <locale>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#ifdef CSPACE_ZSTD
#include <zstd.h>
#endif

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "cspace/map.hpp: saved maps are little-endian");

namespace cspace {

/// A saved map that is missing, damaged, incomplete or of another version.
class FileError : public std::runtime_error {
 public:
  FileError(const std::string& file, const std::string& problem) : std::runtime_error(file + ": " + problem), file_(file) {}

  /// The name of the file or folder; the text of the error begins with it.
  const std::string& file() const { return file_; }

 private:
  std::string file_;
};

namespace detail {

using Index = std::int64_t;

constexpr Index FORMAT_VERSION = 6;
constexpr Index WRITTEN_CHUNK_BYTES = 1 << 24;

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

  /// Return the address of a slice; null if slices are in several chunks, or the array is empty.
  const unsigned char* whole_slice(Index slice) const {
    return has_whole_slices_ ? slices_[static_cast<std::size_t>(slice)] : nullptr;
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
}  // namespace detail
}  // namespace cspace

#endif  // CSPACE_DETAIL_FILES_HPP
