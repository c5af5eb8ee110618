#include "strands.h"

#include <utility>

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

namespace {

double apart(Vec3 p0, Vec3 p1, Vec3 q0, Vec3 q1) {
  double u, w;
  nearest_parameters(p0, p1, q0, q1, u, w);
  return norm((1 - u) * p0 + u * p1 - ((1 - w) * q0 + w * q1));
}

}  // namespace

double between(const Strand& p, const Strand& q) { return apart(p.a, p.b, q.a, q.b); }

double between_segments(const Field& x, int k, const Field& y, int m) {
  return apart(x.at(k), x.at(k + 1), y.at(m), y.at(m + 1));
}

int leaves_of(int segments) { return (segments + kLeafSegments - 1) / kLeafSegments; }

bool divides_first(const Strand& p, const Strand& q) {
  return q.second < 0 || (p.second >= 0 && p.last - p.first >= q.last - q.first);
}

void Strands::look(int segments) {
  if (strands_.empty() || strands_[0].last != segments) strands_.clear(), build(0, segments);
  fitted_.assign(strands_.size(), 0);
}

// All leaves but the last are full.
int Strands::build(int first, int last) {
  const int at = size();
  strands_.push_back({});
  strands_[at].first = first, strands_[at].last = last;
  const int leaves = leaves_of(last - first);
  if (leaves <= 1) return at;
  const int middle = first + (leaves + 1) / 2 * kLeafSegments;
  build(first, middle);
  const int second = build(middle, last);
  strands_[at].second = second;
  return at;
}

const Strand& Strands::fit(const Chain& c, int at) {
  Strand& strand = strands_[at];
  if (std::exchange(fitted_[at], 1)) return strand;
  strand.a = c.x.at(strand.first), strand.b = c.x.at(strand.last);
  if (strand.second < 0)
    fit_leaf(c, strand);
  else
    join(strand, fit(c, at + 1), fit(c, strand.second));
  return strand;
}

void Strands::fit_leaf(const Chain& c, Strand& leaf) const {
  leaf.heading = unit_or(leaf.b - leaf.a, {});
  leaf.radius = 0, leaf.straight = leaf.stretch = 1;
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
