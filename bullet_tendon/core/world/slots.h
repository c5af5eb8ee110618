// Parts of a world, by slot. A removed part leaves an empty slot, which the next one that is added takes.
//
// for (auto [slot, part] : filled(list)) visits the slots of a list of pointers that are not empty.
#pragma once
#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

namespace bt {

template <class Part>
class Slots : public std::vector<std::unique_ptr<Part>> {
 public:
  int add(std::unique_ptr<Part> part) {
    const auto free = std::find(this->begin(), this->end(), nullptr);
    const int slot = static_cast<int>(free - this->begin());
    if (free == this->end()) this->emplace_back();
    (*this)[slot] = std::move(part);
    return slot;
  }
  void remove(int slot) {
    (*this)[slot].reset();
    while (!this->empty() && !this->back()) this->pop_back();
  }
};

template <class Pointer>
class Filled {
 public:
  struct Slot {
    int slot;
    decltype(*std::declval<Pointer>()) part;
  };
  struct Iterator {
    Pointer *first, *at, *end;
    Slot operator*() const { return {static_cast<int>(at - first), **at}; }
    bool operator!=(const Iterator& other) const { return at != other.at; }
    Iterator& operator++() { return ++at, skip(); }
    Iterator& skip() {
      while (at != end && !*at) ++at;
      return *this;
    }
  };
  Filled(Pointer* first, size_t count) : first_(first), end_(first + count) {}
  Iterator begin() const { return Iterator{first_, first_, end_}.skip(); }
  Iterator end() const { return {first_, end_, end_}; }

 private:
  Pointer *first_, *end_;
};

template <class Pointer>
Filled<const Pointer> filled(const std::vector<Pointer>& list) {
  return {list.data(), list.size()};
}

}  // namespace bt
