// How state becomes bytes, and bytes state again: archives that go through fields in order (state.h lists
// them). Each call of an archive leaves its number of fields as a tag, so that bytes of another layout are
// refused.
#pragma once
#include <cstring>
#include <stdexcept>
#include <type_traits>
#include <vector>

#include "field.h"

namespace bt {

// Kept byte by byte: numbers, and structs that are nothing but doubles.
template <class T>
constexpr bool kPlain = std::is_arithmetic_v<T> || std::is_enum_v<T> || std::is_same_v<T, Vec3> ||
                        std::is_same_v<T, Sym3> || std::is_same_v<T, Rot3> || std::is_same_v<T, Pose>;

struct StateMismatch : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Goes through the fields in order; Derived says what happens to a run of bytes, to a run that has to
// be equal, and to a length.
template <class Derived>
class Archive {
 public:
  template <class... T>
  void operator()(T&... values) {
    unsigned char tag = sizeof...(T);
    self().equal(&tag, 1);
    (one(values), ...);
  }
  template <class... T>
  void same(T&... values) {
    (same_one(values), ...);
  }
  template <class... T>
  void scratch(T&...) {}

 private:
  Derived& self() { return static_cast<Derived&>(*this); }
  template <class T>
  void one(T& value) {
    if constexpr (kPlain<T>)
      self().bytes(&value, sizeof(T));
    else
      fields(self(), value);
  }
  void one(Field& f) {
    for (int k = 0; k < 3; ++k) self().bytes(f[k], f.size() * sizeof(double));
  }
  template <class T>
  void one(std::vector<T>& list) {
    const size_t count = self().length(list.size());
    if constexpr (kPlain<T>) {
      self().run(list, count);
    } else if (self().writes(list, count)) {
      for (T& value : list) one(value);
    } else {
      T none{};
      for (size_t i = 0; i < count; ++i) one(none);
    }
  }
  template <class T>
  void same_one(T& value) {
    if constexpr (kPlain<T>)
      self().equal(&value, sizeof(T));
    else
      same_fields(self(), value);
  }
  template <class T>
  void same_one(std::vector<T>& list) {
    size_t count = list.size();
    self().equal(&count, sizeof count);
    for (T& value : list) same_one(value);
  }
};

// Writes over what is in `out`, which keeps its length, and with it its memory, until finish.
class Writer : public Archive<Writer> {
 public:
  explicit Writer(std::vector<char>& out) : out_(out) {}
  void bytes(const void* p, size_t size) {
    if (size > out_.size() - written_) out_.resize(2 * (written_ + size));
    if (size) std::memcpy(out_.data() + written_, p, size);
    written_ += size;
  }
  void equal(const void* p, size_t size) { bytes(p, size); }
  size_t length(size_t count) {
    bytes(&count, sizeof count);
    return count;
  }
  template <class T>
  bool writes(std::vector<T>&, size_t) {
    return true;
  }
  template <class T>
  void run(std::vector<T>& list, size_t count) {
    bytes(list.data(), count * sizeof(T));
  }
  bool applies() const { return false; }
  void finish() { out_.resize(written_); }

 private:
  std::vector<char>& out_;
  size_t written_ = 0;
};

// Reads what Writer wrote. Without `apply` nothing is changed: so a state is looked through to its end
// before it is taken. Throws StateMismatch.
class Reader : public Archive<Reader> {
 public:
  Reader(const char* from, size_t size, bool apply) : at_(from), end_(from + size), apply_(apply) {}
  void bytes(void* p, size_t size) {
    need(size);
    if (apply_ && size) std::memcpy(p, at_, size);
    at_ += size;
  }
  void equal(const void* p, size_t size) {
    need(size);
    if (std::memcmp(p, at_, size) != 0) throw StateMismatch("of a world that is made of the same parts");
    at_ += size;
  }
  size_t length(size_t) {
    need(sizeof(size_t));
    size_t count;
    std::memcpy(&count, at_, sizeof count);
    at_ += sizeof count;
    need(count);  // every element is a byte at least
    return count;
  }
  template <class T>
  bool writes(std::vector<T>& list, size_t count) {
    if (apply_) list.resize(count);
    return apply_;
  }
  template <class T>
  void run(std::vector<T>& list, size_t count) {
    need(count * sizeof(T));
    if (writes(list, count))
      bytes(list.data(), count * sizeof(T));
    else
      at_ += count * sizeof(T);
  }
  bool applies() const { return apply_; }
  void finish() const {
    if (at_ != end_) throw StateMismatch("of the length that the world's parts give");
  }

 private:
  void need(size_t size) const {
    if (size > static_cast<size_t>(end_ - at_)) throw StateMismatch("complete");
  }
  const char *at_, *end_;
  bool apply_;
};

}  // namespace bt
