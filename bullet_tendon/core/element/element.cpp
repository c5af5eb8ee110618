#include "element/element.h"

#include <algorithm>

namespace bt {

void TouchedLink::add(Vec3 arm, Vec3 f) {
  force += f;
  torque += cross(arm, f);
  pulls += outer_product(arm, f);
}

// Each link once, in the order of the slots, so that the first of a pair has the lower slot.
Element::Element(const std::vector<int>& links) {
  for (int link : links) {
    const bool known = std::any_of(touched_.begin(), touched_.end(),
                                   [link](const TouchedLink& t) { return t.link == link; });
    if (known) continue;
    touched_.emplace_back();
    touched_.back().link = link;
  }
  std::sort(touched_.begin(), touched_.end(),
            [](const TouchedLink& a, const TouchedLink& b) { return a.link < b.link; });
}

void PairList::include(Element& element) {
  const int n = static_cast<int>(element.touched_.size());
  element.pairs_.assign(n * n, -1);
  for (int i = 0; i < n; ++i)
    for (int j = i; j < n; ++j)
      element.pairs_[i * n + j] = find(element.touched_[i].link, element.touched_[j].link);
}

// Index of the pair, which is made where it is not listed yet.
int PairList::find(int one, int other) {
  const auto found = std::find_if(all.begin(), all.end(),
                                  [&](const LinkPair& p) { return p.one == one && p.other == other; });
  if (found != all.end()) return static_cast<int>(found - all.begin());
  all.emplace_back();
  all.back().one = one;
  all.back().other = other;
  return static_cast<int>(all.size()) - 1;
}

}  // namespace bt
