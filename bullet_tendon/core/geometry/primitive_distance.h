// Exact distances from a segment to a box, sphere, capsule or cylinder, in the shape's frame.
//
// Every one is a convex core grown by a radius: a box (capsule: no extent but along z; sphere: none at all),
// or a cylinder along z that is not grown, as its edges are sharp.
#pragma once
#include "math/vec3.h"

namespace bt {

struct Primitive {
  struct Nearest {
    double distance = 0;  // below 0: of the way out [m]
    Vec3 point;           // on the surface [m]
    double u = 0;         // nearest point of the segment: a + u (b - a); where it runs through, the deepest
  };
  enum class Kind : int { none = 0, box, cylinder };
  Kind kind = Kind::none;
  Vec3 half;                           // of the box [m]
  double growth = 0;                   // [m]
  double radius = 0, half_length = 0;  // of the cylinder [m]

  explicit operator bool() const { return kind != Kind::none; }
  bool is_flat() const { return kind == Kind::box && growth == 0; }
  bool is_round() const { return *this && !is_flat(); }
  Nearest nearest(Vec3 a, Vec3 b) const;
  // The cylinder or the sphere that the surface is at a point of it, where its normal is `normal`.
  struct Round {
    double radius = 0;  // 0: flat there [m]
    Vec3 axis;          // unit vector; zero: a sphere
  };
  Round round_at(Vec3 point, Vec3 normal) const;
  // Share of the segment a-b over the extent in which the surface is straight at a point of it, such as
  // the length of a cylinder's side; 1: it is straight in no direction there.
  double beside_straight(Vec3 point, Vec3 a, Vec3 b) const;
  // The face of a box before which a point begins, and over which it stays until `to`, also if it ends up to
  // `beside` from there [m]; `to` may be behind it: 1 to 3 by axis, negative on the low side; 0: none.
  int face_over(Vec3 from, Vec3 to, double beside) const;

 private:
  friend struct AlongPrimitive;
  // From the core's nearest point; zero inside.
  Vec3 gap(Vec3 x) const;
  // Of a point in the core: how far its surface is, as a number <= 0, and the normal there.
  double inside(Vec3 x, Vec3& normal) const;
};

}  // namespace bt
