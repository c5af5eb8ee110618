#include "geometry/drilled_mesh.h"

#include <cmath>
#include <utility>
#include <vector>

namespace bt {

namespace {

// Facets of a round wall [-]. Fewer: the edge of what is left is farther from the wall. More: more triangles.
constexpr int kFacets = 64;
// Distance from a mouth's edge or its chamfer, across and along the axis, up to which the edge stands for the
// surface, in radii [-]. It is how far the surface may be from the mouth's plane (mouths.py). Larger: what is
// pulled over the edge sinks in between the edge and what is left. Smaller: both are felt at once.
constexpr double kBesideEdge = 0.25;

using Polygon = std::vector<Vec3>;

// The points p with n.p <= c.
struct HalfSpace {
  Vec3 n;
  double c;
};

using Convex = std::vector<HalfSpace>;

// A cylinder around a bore's axis, open at its ends.
Convex around(const Bore& bore, double radius) {
  const Vec3 one = any_perpendicular(bore.axis), other = cross(bore.axis, one);
  Convex found;
  for (int k = 0; k < kFacets; ++k) {
    const double angle = 2 * M_PI * k / kFacets;
    const Vec3 out = std::cos(angle) * one + std::sin(angle) * other;
    found.push_back({out, dot(out, bore.start) + radius});
  }
  return found;
}

// The points that are beyond a mouth's plane by at most `most`, along the axis [m].
HalfSpace before(const Bore& bore, int mouth, double most) {
  const Vec3 n = mouth ? bore.axis - bore.slope[1] : bore.slope[0] - bore.axis;
  return {n, dot(n, bore.start) + most + (mouth ? bore.length : 0)};
}

HalfSpace other_side(const HalfSpace& h) { return {-h.n, -h.c}; }

// What the bore removes, as convex parts: the bore and the bone before its mouths, and the surface beside the
// edges of its mouths, which have contacts of their own.
std::vector<Convex> removed_by(const Bore& bore) {
  const double beside = kBesideEdge * bore.radius;
  std::vector<Convex> parts{around(bore, bore.radius)};
  for (int mouth : {0, 1}) parts[0].push_back(before(bore, mouth, kBoreReach * bore.radius));
  for (int mouth : {0, 1}) {
    const double depth = mouth ? bore.length - bore.chamfer_at(1) : bore.chamfer_at(0);
    Convex part = around(bore, bore.radius + bore.chamfer + beside);
    part.push_back(before(bore, mouth, depth + beside));
    part.push_back(other_side(before(bore, mouth, -depth - beside)));
    parts.push_back(std::move(part));
  }
  return parts;
}

// Appends the parts of a convex polygon on both sides of a plane, which meet there.
void cut(const Polygon& whole, const HalfSpace& h, Polygon& inside, Polygon& outside) {
  for (size_t k = 0; k < whole.size(); ++k) {
    const Vec3 p = whole[k], q = whole[(k + 1) % whole.size()];
    const double over = dot(h.n, p) - h.c, next = dot(h.n, q) - h.c;
    if (over <= 0) inside.push_back(p);
    if (over >= 0) outside.push_back(p);
    if ((over < 0 && next > 0) || (over > 0 && next < 0)) {
      const Vec3 between = p + over / (over - next) * (q - p);
      inside.push_back(between);
      outside.push_back(between);
    }
  }
}

void append_fan(const Polygon& p, std::vector<Triangle>& out) {
  for (size_t k = 2; k < p.size(); ++k) out.push_back({p[0], p[k - 1], p[k]});
}

// Whether a plane of the convex part separates it from a triangle.
bool is_beside(const Triangle& t, const Convex& part) {
  return std::any_of(part.begin(), part.end(), [&](const HalfSpace& h) {
    return dot(h.n, t.a) >= h.c && dot(h.n, t.b) >= h.c && dot(h.n, t.c) >= h.c;
  });
}

// Appends a triangle without a convex part: what each of its planes cuts off of what the planes before left.
void append_without(const Triangle& t, const Convex& part, std::vector<Triangle>& out) {
  const size_t before = out.size();
  Polygon left{t.a, t.b, t.c}, inside, outside;
  for (const HalfSpace& h : part) {
    inside.clear();
    outside.clear();
    cut(left, h, inside, outside);
    append_fan(outside, out);
    std::swap(left, inside);
    if (left.size() < 3) {  // nothing is removed of it
      out.resize(before);
      out.push_back(t);
      return;
    }
  }
}

}  // namespace

std::vector<Triangle> drilled(const std::vector<Triangle>& triangles, const Bore& bore) {
  std::vector<Triangle> left = triangles, next;
  for (const Convex& part : removed_by(bore)) {
    next.clear();
    for (const Triangle& t : left)
      if (is_beside(t, part))
        next.push_back(t);
      else
        append_without(t, part, next);
    std::swap(left, next);
  }
  return left;
}

}  // namespace bt
