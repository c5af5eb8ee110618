// Contacts whose nearest points have moved along within a step.
#include "solver/missed_contacts.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "geometry/segment_distance.h"
#include "solver/assembly.h"

namespace bt {

namespace {

// A contact this share of its radii too near gets another contact in the same step [-], unless its
// nearest points are within kNearlySame of a segment of where a contact already is.
constexpr double kPairDepth = 0.002;
constexpr double kNearlySame = 1e-3;

// Contacts that may be added so in one step and island [-].
constexpr int kMostExtraContacts = 256;

// The row of a pair at the points that are nearest now. A pair that seems to have passed through
// keeps its side. false: it is not too near, or has a contact there already.
bool moved_pair(const Island& island, const Contact& contact, Contact& more) {
  const Tendon &a = island.at(contact.a), &b = island.at(contact.b);
  double u, w;
  nearest_parameters(a.x_new.at(contact.a.first), a.x_new.at(contact.a.first + 1),
                     b.x_new.at(contact.b.first), b.x_new.at(contact.b.first + 1), u, w);
  more.a.w0 = 1 - u, more.a.w1 = u, more.b.w0 = 1 - w, more.b.w1 = w;
  more.anchored_at = u, more.anchored_at_other = w, more.point_shift = {};
  Vec3 apart = more.a.of(a.x_new) - more.b.of(b.x_new);
  double distance = norm(apart);
  if (distance >= (1 - kPairDepth) * contact.offset + contact.depth_allowance || distance == 0) return false;
  if (std::fabs(u - contact.a.w1) < kNearlySame && std::fabs(w - contact.b.w1) < kNearlySame) return false;
  more.normal = (dot(apart, contact.normal) < 0 ? -1 / distance : 1 / distance) * apart;
  more.side = more.normal;
  more.relative_start = more.a.of(a.x) - more.b.of(b.x);
  return true;
}

bool same_place(const Contact& a, const Contact& b) {
  ContactKey first = a.key, second = b.key;
  first.extra = second.extra = 0;
  return first == second && std::fabs(a.a.w1 - b.a.w1) < kNearlySame &&
         std::fabs(a.b.w1 - b.b.w1) < kNearlySame;
}

}  // namespace

bool add_missed(Island& island) {
  const size_t known = island.contacts.size();
  bool any = false;
  std::vector<const Contact*> besides;
  for (const Contact* contact : island.contacts)
    if (contact->key.extra) besides.push_back(contact);
  for (size_t r = 0; r < known && island.extra.size() < kMostExtraContacts; ++r) {
    Contact& contact = *island.contacts[r];
    if (contact.b.tendon < 0 || contact.follows) continue;  // what follows has its points with it
    Contact more = contact;
    more.lambda = more.lambda_predicted = more.limit = 0, more.tangent_anchor = {}, more.sliding = false;
    if (contact.softest > 0) more.stiffness = contact.softest;
    if (!moved_pair(island, contact, more) || overruled(more, island.at(more.a))) continue;
    auto there = [&](const Contact* other) { return same_place(*other, more); };
    if (there(&contact) || std::any_of(besides.begin(), besides.end(), there)) continue;
    more.key.extra = 1;
    if (island.extra.empty()) island.extra.reserve(kMostExtraContacts);  // pointers to them stay
    island.extra.push_back(more);
    island.contacts.push_back(&island.extra.back()), besides.push_back(island.contacts.back());
    any = true;
  }
  return any;
}

}  // namespace bt
