// Elements of a world, by kind and slot. A removed element leaves an empty slot, which the next one takes.
#pragma once
#include <memory>
#include <vector>

#include "element/element.h"

namespace bt {

template <class Kind>
class ElementSlots {
 public:
  const std::vector<std::unique_ptr<Kind>>& all() const { return slots_; }
  int add(std::unique_ptr<Kind> element) {
    size_t slot = 0;
    while (slot < slots_.size() && slots_[slot]) ++slot;
    if (slot == slots_.size()) slots_.emplace_back();
    slots_[slot] = std::move(element);
    return static_cast<int>(slot);
  }
  void remove(int slot) {
    slots_[slot].reset();
    while (!slots_.empty() && !slots_.back()) slots_.pop_back();
  }

 private:
  std::vector<std::unique_ptr<Kind>> slots_;
};

}  // namespace bt
