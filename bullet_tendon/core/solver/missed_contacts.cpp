// Contacts whose nearest points have moved along within a step.
#include "solver/missed_contacts.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "geometry/segment_distance.h"
#include "solver/assembly.h"

namespace bt {

namespace {

// A contact this share of its radii too near gets another row in the same step [-], unless its
// nearest points are within kNearlySame of a segment of where a row already is.
constexpr double kPairDepth = 0.002;
constexpr double kNearlySame = 1e-3;

// Rows that may be added so in one step and group [-].
constexpr int kMostExtraRows = 256;

// The row of a pair at the points that are nearest now. A pair that seems to have passed through
// keeps its side. false: it is not too near, or has a row there already.
bool moved_pair(const Group& group, const Row& row, Row& more) {
  const Chain &a = group.at(row.a), &b = group.at(row.b);
  double u, w;
  nearest_parameters(a.next.at(row.a.first), a.next.at(row.a.first + 1), b.next.at(row.b.first),
                     b.next.at(row.b.first + 1), u, w);
  more.a.w0 = 1 - u, more.a.w1 = u, more.b.w0 = 1 - w, more.b.w1 = w;
  more.stuck_at = u, more.stuck_at_other = w, more.slid = {};
  Vec3 apart = more.a.of(a.next) - more.b.of(b.next);
  double distance = norm(apart);
  if (distance >= (1 - kPairDepth) * row.offset + row.allowed || distance == 0) return false;
  if (std::fabs(u - row.a.w1) < kNearlySame && std::fabs(w - row.b.w1) < kNearlySame) return false;
  more.normal = (dot(apart, row.normal) < 0 ? -1 / distance : 1 / distance) * apart;
  more.side = more.normal;
  more.reference = more.a.of(a.x) - more.b.of(b.x);
  return true;
}

bool same_place(const Row& a, const Row& b) {
  ContactKey first = a.key, second = b.key;
  first.extra = second.extra = 0;
  return first == second && std::fabs(a.a.w1 - b.a.w1) < kNearlySame &&
         std::fabs(a.b.w1 - b.b.w1) < kNearlySame;
}

}  // namespace

bool add_missed(Group& group) {
  const size_t known = group.rows.size();
  bool any = false;
  std::vector<const Row*> besides;
  for (const Row* row : group.rows)
    if (row->key.extra) besides.push_back(row);
  for (size_t r = 0; r < known && group.extra.size() < kMostExtraRows; ++r) {
    Row& row = *group.rows[r];
    if (row.b.chain < 0 || row.follows) continue;  // what follows has its points with it
    Row more = row;
    more.carried = more.multiplier = more.limit = 0, more.stuck = {}, more.sliding = false;
    if (row.softest > 0) more.stiffness = row.softest;
    if (!moved_pair(group, row, more) || overruled(more, group.at(more.a))) continue;
    auto there = [&](const Row* other) { return same_place(*other, more); };
    if (there(&row) || std::any_of(besides.begin(), besides.end(), there)) continue;
    more.key.extra = 1;
    if (group.extra.empty()) group.extra.reserve(kMostExtraRows);  // pointers to them stay
    group.extra.push_back(more);
    group.rows.push_back(&group.extra.back()), besides.push_back(group.rows.back());
    any = true;
  }
  return any;
}

}  // namespace bt
