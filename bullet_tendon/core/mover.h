// What moves of a pybullet body: its coordinates, and how they answer to forces.
//
// The links of a body share them. With J the Jacobian of a link (velocity of its centre of mass, spin) and E
// the root of the response (observer.h), a force f at the point p of a link, r from its centre of mass,
// displaces every point of the body within a step by
//
//   B = s [I, -[r]] J E,     u = B y,     y = B^T f,     s^2 = (time since the step began) (length of the
//   part),
//
// so that y, of energy |y|^2/2, are the body's unknowns in the solution (border.cpp), whatever holds it. What
// touches the body gives y in the span of all B^T only: with an orthonormal basis Q of that, y = Q z with
// fewer unknowns z, three for a single attachment (unknowns.cpp).
//
// Joint limits are foreseen: a coordinate that is past one, and would go on, pybullet gives the rate that
// takes back a share of the depth in the step. With S those coordinates and R = E E^T,
//
//   rates += R_:S R_SS^-1 (wanted - rates)_S,     E -= R_:S R_SS^-1 E_S.
#pragma once
#include "observer.h"
#include "vec.h"

namespace bt {

// A limit that is thought to stop a coordinate in this step.
struct Stop {
  int coordinate = 0;
  double side = 0;     // 1 where it pushes up, -1 where it pushes down
  double wanted = 0;   // rate that it gives
  double missing = 0;  // of that, to the rate foreseen without it
};

struct Mover {
  using Numbers = dense::Numbers;
  Numbers rates;  // now: velocity of the centre of mass and spin, of the base, and of the joints
  Numbers free;   // M^-1 (n n)
  Numbers falls;  // acceleration by a unit of gravity (n 3); empty: not known
  Vec3 gyration;  // of a rigid body, its gyroscopic acceleration in this step [rad/s^2]
  Numbers stops;  // (coordinate, side, depth) of every limit that is passed: side 1 where it pushes up
  Observer observer;
  Numbers root;    // E, without what the stops take away in this step
  Numbers change;  // of the rates in this step, foreseen but for the tendons, and by earlier parts of it
  Numbers forces;  // generalized, of the tendons in this step
  // In a solution.
  bool unknown = false;
  int freedom = 0;            // how many unknowns it has
  Numbers basis;              // Q^T (freedom n), where they are fewer than n
  Numbers y, step, residual;  // z, its change, and the residual
  Numbers gathered;           // z of whole steps, by the parts of a group's step that are done
  int first = 0;              // of its unknowns among those of its group
  double lever = 0;           // largest |B| of its touched points

  // Coordinates that a limit stops in this step.
  std::vector<int> stopped() const {
    std::vector<int> coordinates;
    for (const Stop& s : stopped_) coordinates.push_back(s.coordinate);
    return coordinates;
  }
  int n() const { return static_cast<int>(rates.size()); }
  // One more direction (n) that it can be moved in, of which it gets the part that is new.
  void widen(Numbers direction);
  // What it did since the last step, and what it is going to do.
  void sense(Vec3 gravity);
  void foresee(double dt, Vec3 gravity);
  // Its rates right after the step; whether it seems to have been let go (Observer::note).
  bool note(const Numbers& after, Vec3 gravity);
  // The tendons' forces of a step of dt.
  void act(double dt);
  // An impulse, generalized, changes its motion.
  void push(const Numbers& impulse);

 private:
  // -I^-1 (w x I w) of a rigid body, by the angular block I^-1 of its response [rad/s^2].
  Vec3 gyroscopic() const;
  const Numbers& known(Vec3 gravity);
  const Numbers& unforced(Vec3 gravity);
  void doubt_stops();
  void find_stopped(double dt);
  void stop(double dt);
  Numbers stopped_by_;  // acceleration that the stops made in the last step, beside the response
  std::vector<Stop> stopped_;
  Numbers doubted_;  // by coordinate, not 0: it went on through what pybullet tells as its limit
  Numbers known_, half_, within_, within_root_, missing_;
  template <class A>
  friend void fields(A& a, Mover& mover);  // state.h
};

}  // namespace bt
