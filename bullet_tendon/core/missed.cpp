// Contacts whose nearest points have moved along within a step.
#include "constants.h"
#include "pairs.h"
#include "stepping.h"
#include "tunnel.h"

namespace bt {

namespace {

// The row of a pair at the points that are nearest now. A pair that seems to have passed through
// keeps its side. false: it is not too near, or has a row there already.
bool moved_pair(const Group& group, const Row& row, Row& more) {
  const Chain &a = group.at(row.a), &b = group.at(row.b);
  double u, w;
  nearest_parameters(a.next.at(row.a.first), a.next.at(row.a.first + 1), b.next.at(row.b.first),
                     b.next.at(row.b.first + 1), u, w);
  more.a.w0 = 1 - u, more.a.w1 = u, more.b.w0 = 1 - w, more.b.w1 = w;
  Vec3 apart = more.a.of(a.next) - more.b.of(b.next);
  double distance = norm(apart);
  if (distance >= (1 - kPairDepth) * row.offset + row.allowed || distance == 0) return false;
  if (std::fabs(u - row.a.w1) < kNearlySame && std::fabs(w - row.b.w1) < kNearlySame) return false;
  more.normal = (dot(apart, row.normal) < 0 ? -1 / distance : 1 / distance) * apart;
  more.reference = more.a.of(a.split ? a.start_x : a.x) - more.b.of(b.split ? b.start_x : b.x);
  return true;
}

// The same of a segment and the edge of a mouth.
bool moved_mouth(const Group& group, const Row& row, Row& more) {
  const Chain& c = group.at(row.a);
  const int k = row.a.first;
  double u = nearest_to_circle(c.next.at(k), c.next.at(k + 1), row.axis_point, row.axis, row.ring);
  more.a.w0 = 1 - u, more.a.w1 = u;
  if (std::fabs(u - row.a.w1) < kNearlySame) return false;
  more.evaluate(more.a.of(c.next), true);
  if (more.gap >= -kPairDepth * row.offset) return false;
  more.reference = more.a.of(c.split ? c.start_x : c.x);
  return true;
}

}  // namespace

bool add_missed(Group& group) {
  const size_t known = group.rows.size();
  for (size_t r = 0; r < known && group.extra.size() < group.extra.capacity(); ++r) {
    const Row& row = *group.rows[r];
    Row more = row;
    more.carried = more.multiplier = more.limit = 0, more.stuck = {}, more.sliding = false;
    bool missed = row.b.chain >= 0 ? moved_pair(group, row, more)
                                   : row.kind == ContactKind::mouth && moved_mouth(group, row, more);
    if (!missed || overruled(more, group.at(more.a))) continue;
    more.key |= 1ull << 63;
    group.extra.push_back(more);
    group.rows.push_back(&group.extra.back());
  }
  return group.rows.size() > known;
}

}  // namespace bt
