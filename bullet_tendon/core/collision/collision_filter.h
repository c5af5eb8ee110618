// Pairs that make no contacts: two tendons, a tendon with itself, or a tendon and a link.
#pragma once
#include <algorithm>
#include <cstdint>
#include <vector>

namespace bt {

class CollisionFilter {
 public:
  // Whether tendon a makes contacts with tendon b, or (a == b) with itself.
  bool meet(int a, int b) const {
    return !has(inert_, a) && !has(inert_, b) && !has(tendons_, pair(std::min(a, b), std::max(a, b)));
  }
  // Whether the tendon makes contacts with the shapes and bores of the link.
  bool meets_link(int tendon, int link) const {
    return !has(inert_, tendon) && !has(links_, pair(tendon, link));
  }
  // Whether the tendon makes contacts at all.
  bool is_inert(int tendon) const { return has(inert_, tendon); }

  void set_inert(int tendon, bool inert) { set(inert_, tendon, inert); }
  void set_tendons(int a, int b, bool meet) { set(tendons_, pair(std::min(a, b), std::max(a, b)), !meet); }
  void set_link(int tendon, int link, bool meet) { set(links_, pair(tendon, link), !meet); }

  // The slot of a tendon, or of a link, is empty.
  void forget_tendon(int slot) {
    set_inert(slot, false);
    erase(tendons_, [&](uint64_t p) { return first(p) == slot || second(p) == slot; });
    erase(links_, [&](uint64_t p) { return first(p) == slot; });
  }
  void forget_link(int slot) {
    erase(links_, [&](uint64_t p) { return second(p) == slot; });
  }

  // Whether every slot is below these counts, and the lists are in order.
  bool is_valid(size_t tendons, size_t links) const {
    auto within = [&](const std::vector<uint64_t>& list, size_t firsts, size_t seconds) {
      return std::is_sorted(list.begin(), list.end()) &&
             std::all_of(list.begin(), list.end(), [&](uint64_t p) {
               return static_cast<size_t>(first(p)) < firsts && static_cast<size_t>(second(p)) < seconds;
             });
    };
    return within(inert_, 1, tendons) && within(tendons_, tendons, tendons) && within(links_, tendons, links);
  }

 private:
  friend struct StateFields;
  static uint64_t pair(int a, int b) { return static_cast<uint64_t>(a) << 32 | static_cast<uint32_t>(b); }
  static int first(uint64_t p) { return static_cast<int>(p >> 32); }
  static int second(uint64_t p) { return static_cast<int>(p & 0xffffffffu); }
  static bool has(const std::vector<uint64_t>& list, uint64_t key) {
    return !list.empty() && std::binary_search(list.begin(), list.end(), key);
  }
  static void set(std::vector<uint64_t>& list, uint64_t key, bool in) {
    const auto at = std::lower_bound(list.begin(), list.end(), key);
    const bool there = at != list.end() && *at == key;
    if (in && !there) list.insert(at, key);
    if (!in && there) list.erase(at);
  }
  template <class Gone>
  static void erase(std::vector<uint64_t>& list, Gone gone) {
    list.erase(std::remove_if(list.begin(), list.end(), gone), list.end());
  }

  std::vector<uint64_t> inert_;    // tendons without any contacts
  std::vector<uint64_t> tendons_;  // pairs of tendons, the lower slot in the upper half
  std::vector<uint64_t> links_;    // pairs of a tendon (upper half) and a link
};

}  // namespace bt
