// Parts of a world, by slot. A removed part leaves an empty slot, which the next one that is added takes.
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

}  // namespace bt
