// Converts state to bytes and back: archives that visit named fields (world/state_fields.h).
//
// Layout: each field begins with the hash of its name (4 bytes). Numbers and vectors are stored as in memory.
// A list begins with its length (8 bytes). The reader throws StateMismatch where the bytes end
// too early, a name differs, a flag is neither 0 nor 1, or a number is not finite.
#pragma once
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <type_traits>
#include <vector>

#include "world/checkpoint.h"

namespace bt {

// Types that are copied byte by byte: numbers, and structs that consist of doubles.
template <class T>
constexpr bool kOfDoubles = std::is_same_v<T, double> || std::is_same_v<T, Vec3> || std::is_same_v<T, Sym3> ||
                            std::is_same_v<T, Rot3> || std::is_same_v<T, Pose> || std::is_same_v<T, Twist> ||
                            std::is_same_v<T, Wrench>;
template <class T>
constexpr bool kPlain = kOfDoubles<T> || std::is_arithmetic_v<T> || std::is_enum_v<T>;

// FNV-1a.
inline uint32_t hash_of_name(const char* name) {
  uint32_t hash = 2166136261u;
  for (; *name; ++name) hash = (hash ^ static_cast<unsigned char>(*name)) * 16777619u;
  return hash;
}

class StateWriter {
 public:
  explicit StateWriter(std::vector<char>& out) : out_(out) {}
  // Reads the value: visit takes what is not const, because the reader fills it.
  template <class T>
  void operator()(const char* name, const T& value) {
    const uint32_t tag = hash_of_name(name);
    bytes(&tag, sizeof tag);
    one(const_cast<T&>(value));
  }

 private:
  void bytes(const void* p, size_t size) {
    const char* from = static_cast<const char*>(p);
    out_.insert(out_.end(), from, from + size);
  }
  void length(size_t count) {
    const uint64_t n = count;
    bytes(&n, sizeof n);
  }
  template <class T>
  void one(T& value) {
    if constexpr (kPlain<T>)
      bytes(&value, sizeof(T));
    else
      visit(*this, value);
  }
  void one(Field& f) {
    length(f.size());
    for (int k = 0; k < 3; ++k) bytes(f[k], f.size() * sizeof(double));
  }
  template <class T>
  void one(std::vector<T>& list) {
    length(list.size());
    for (T& value : list) one(value);
  }
  std::vector<char>& out_;
};

class StateReader {
 public:
  StateReader(const char* from, size_t size) : at_(from), end_(from + size) {}
  template <class T>
  void operator()(const char* name, T& value) {
    uint32_t tag;
    bytes(&tag, sizeof tag);
    if (tag != hash_of_name(name)) throw StateMismatch(std::string("of this layout, with a field ") + name);
    one(value);
  }
  void finish() const {
    if (at_ != end_) throw StateMismatch("of the length that its fields give");
  }

 private:
  void need(size_t size) const {
    if (size > static_cast<size_t>(end_ - at_)) throw StateMismatch("complete");
  }
  void bytes(void* p, size_t size) {
    need(size);
    if (size) std::memcpy(p, at_, size);
    at_ += size;
  }
  // Reads the length of a list whose elements have at least one byte.
  size_t length() {
    uint64_t n;
    bytes(&n, sizeof n);
    need(n);
    return static_cast<size_t>(n);
  }
  static void require_finite(const void* p, size_t doubles) {
    for (size_t i = 0; i < doubles; ++i) {
      double value;
      std::memcpy(&value, static_cast<const char*>(p) + i * sizeof value, sizeof value);
      if (!std::isfinite(value)) throw StateMismatch("finite");
    }
  }
  template <class T>
  void one(T& value) {
    if constexpr (std::is_same_v<T, bool>) {
      unsigned char flag;
      bytes(&flag, 1);
      if (flag > 1) throw StateMismatch("with flags of 0 or 1");
      value = flag != 0;
    } else if constexpr (kPlain<T>) {
      bytes(&value, sizeof(T));
      if constexpr (kOfDoubles<T>) require_finite(&value, sizeof(T) / sizeof(double));
    } else {
      visit(*this, value);
    }
  }
  void one(Field& f) {
    const size_t n = length();
    need(3 * n * sizeof(double));
    f.resize(static_cast<int>(n));
    for (int k = 0; k < 3; ++k) {
      bytes(f[k], n * sizeof(double));
      require_finite(f[k], n);
    }
  }
  template <class T>
  void one(std::vector<T>& list) {
    list.clear();
    for (size_t left = length(); left > 0; --left) {
      list.emplace_back();
      one(list.back());
    }
  }
  const char *at_, *end_;
};

}  // namespace bt
