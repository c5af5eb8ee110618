#include "strands.h"

#include "pairs.h"
#include "search_constants.h"

namespace bt {

namespace {

double off_chord(const Strand& s, Vec3 x) {
  const Vec3 along = s.b - s.a;
  const double square = dot(along, along), u = square > 0 ? dot(x - s.a, along) / square : 0;
  return norm(x - s.a - std::min(1.0, std::max(0.0, u)) * along);
}

// Cosine of the sum of two angles; -1 where that is more than half a turn.
double cosine_of_sum(double p, double q) {
  if (p + q < 0) return -1;
  return p * q - std::sqrt(std::max(0.0, 1 - p * p) * std::max(0.0, 1 - q * q));
}

double cosine(Vec3 p, Vec3 q) { return std::min(1.0, std::max(-1.0, dot(p, q))); }

}  // namespace

double straightness_of_both(const Strand& p, const Strand& q, Vec3& heading) {
  heading = unit_or(p.heading + q.heading, {});
  return std::min(cosine_of_sum(cosine(heading, p.heading), p.straight),
                  cosine_of_sum(cosine(heading, q.heading), q.straight));
}

double between(const Strand& p, const Strand& q) {
  double u, w;
  nearest_parameters(p.a, p.b, q.a, q.b, u, w);
  return norm((1 - u) * p.a + u * p.b - ((1 - w) * q.a + w * q.b));
}

void Strands::fit(const Chain& c) {
  strands_.clear();
  build(c, 0, c.n() - 1);
}

int Strands::build(const Chain& c, int first, int last) {
  const int at = static_cast<int>(strands_.size());
  strands_.push_back({c.x.at(first), c.x.at(last), 0, first, last, -1, {}, 1, 1});
  if (last - first <= kLeafSegments) {
    fit_leaf(c, strands_[at]);
    return at;
  }
  const int middle = (first + last) / 2;
  build(c, first, middle);
  const int second = build(c, middle, last);
  strands_[at].second = second;
  join(strands_[at], strands_[at + 1], strands_[second]);
  return at;
}

void Strands::fit_leaf(const Chain& c, Strand& leaf) const {
  leaf.heading = unit_or(leaf.b - leaf.a, {});
  for (int k = leaf.first; k < leaf.last; ++k) {
    const Vec3 way = c.x.at(k + 1) - c.x.at(k);
    const double length = norm(way);
    leaf.straight = std::min(leaf.straight, length > 0 ? dot(way, leaf.heading) / length : -1.0);
    leaf.stretch = std::min(leaf.stretch, length / c.rest[k]);
    if (k > leaf.first) leaf.radius = std::max(leaf.radius, off_chord(leaf, c.x.at(k)));
  }
}

void Strands::join(Strand& strand, const Strand& p, const Strand& q) const {
  strand.radius = off_chord(strand, p.b) + std::max(p.radius, q.radius);
  strand.straight = straightness_of_both(p, q, strand.heading);
  strand.stretch = std::min(p.stretch, q.stretch);
}

}  // namespace bt
