// A pybullet body by its generalized coordinates, and its response to forces.
//
// The links of a body share its coordinates. With J the Jacobian of a link (velocity of its centre of mass,
// spin) and E the root of the response (bodies/response_observer.h), a force f at the point p of a link, at
// the arm r from its centre of mass, displaces every point of the body within a step by
//
//   B = s [I, -[r]] J E,     u = B y,     y = B^T f,     s^2 = (time since the step began) (length of the
//   substep),
//
// so that y, of energy |y|^2/2, are the body's unknowns in the solution (solver/body_schur.cpp), whatever
// holds it. Only the span of all B^T of touched points is reached: with an orthonormal basis Q of it, y = Q z
// with fewer unknowns z (World::narrow_bodies).
//
// Joint limits and contacts with bodies that do not move are predicted: where the rate along a direction d
// would pass through one, pybullet gives it a rate that takes back a share of the depth
// (bodies/unilateral_stops.cpp).
#pragma once
#include <vector>

#include "bodies/response_observer.h"
#include "bodies/unilateral_stops.h"
#include "math/vec3.h"

namespace bt {

// The unknowns of a body in the solution of an island.
struct BodyUnknowns {
  using Numbers = dense::Numbers;
  bool any = false;
  int freedom = 0;          // how many
  Numbers basis;            // Q^T (freedom n), where they are fewer than n
  Numbers y, dy, residual;  // z, its change, and the residual
  int first = 0;            // their place among those of the island
  double lever = 0;         // largest |B| of its touched points
};

// Space for intermediate results. Of it, only `through` (D E) and `within` (D R D^T), of all stops, last for
// a step.
struct BodyWorkspace {
  dense::Scratch known, half, direction, through, within, within_acting, within_root, missing, given, along;
};

// Whether a free body turns far in this step, so that arms are not those at its start.
struct BodyTurning {
  bool far = false;
  Vec3 torque;      // of the tendons, by the last solution [N m]
  double pull = 0;  // sum of their forces times arms [N m]
};

struct GeneralizedBody {
  using Numbers = dense::Numbers;
  Numbers rates;             // now: velocity of the centre of mass and spin, of the base, and of the joints
  Numbers free;              // M^-1 (n n)
  Numbers gravity_response;  // acceleration by a unit of gravity (n 3); empty: not known
  Vec3 gyroscopic_acceleration;  // of a rigid body, its gyroscopic acceleration in this step [rad/s^2]
  Numbers limits;  // (coordinate, side, depth) of every limit that is passed: side 1 where it pushes up
  // Of a rigid body: direction (6) and distance, below 0 inside, of every contact with a body without mass.
  Numbers contacts;
  bool contacts_known = false;  // they are those of the next step (pybullet does not restore its own)
  Observer observer;
  Numbers root;    // E, without what the stops take away in this step
  Numbers change;  // of the rates in this step, foreseen but for the tendons, and by earlier parts of it
  Numbers forces;  // generalized, of the tendons in this step
  BodyTurning turning;
  int touches = 0;          // attachments and contacts of tendons
  bool point_mass = false;  // it is a spring in the solution (World::aim_attachments)
  BodyUnknowns unknowns;

  // Coordinates that a limit stops in this step.
  std::vector<int> stopped() const {
    std::vector<int> coordinates;
    for (const Stop& s : stops_)
      if (s.acts && s.coordinate >= 0) coordinates.push_back(s.coordinate);
    return coordinates;
  }
  bool may_stop() const { return !stops_.empty(); }
  bool is_stopped() const;
  // Whether contacts may decide what it is going to do.
  bool may_rest(Vec3 gravity) const;
  int n() const { return static_cast<int>(rates.size()); }
  // One more direction (n) that it can be moved in, of which it gets the part that is new.
  void widen(Numbers direction);
  // What it did since the last step, and what it is going to do.
  void sense(Vec3 gravity);
  void predict(double dt, Vec3 gravity);
  // Its rates right after the step; whether it seems to have been let go (Observer::sample).
  bool sample(const Numbers& after, Vec3 gravity);
  // The tendons' forces of a step of dt.
  void act(double dt);
  // Whether it turns far within dt with this predicted spin, or its arms would under the tendons' pulls.
  bool turns_far(Vec3 spin, double dt) const;
  // Whether other stops act with these forces of the tendons than those that are foreseen; then they are now.
  bool settle_stops(const Numbers& forces, double dt);
  // An impulse, generalized, changes its motion.
  void push(const Numbers& impulse);

 private:
  // -I^-1 (w x I w) of a rigid body, by the angular block I^-1 of its response [rad/s^2].
  Vec3 gyroscopic() const;
  const Numbers& known(Vec3 gravity);
  const Numbers& unforced(Vec3 gravity);
  void doubt_stops();
  void find_stops(double dt);
  double rate_along(size_t stop, const Numbers& of) const;
  void add_stop(double wanted, int coordinate);
  void find_pushes(double dt);
  void gather_acting();
  bool choose_stops(const Numbers& forces, double dt);
  void stop(double dt);
  void take_away(double dt);
  void push_by(const Numbers& impulse);
  Numbers stopped_by_;  // acceleration that the stops made in the last step, beside the response
  std::vector<Stop> stops_;
  Numbers directions_;    // D (n in each row)
  Numbers pushes_;        // lambda, of the stops that were looked at last
  Numbers unstopped_;     // change without them and without the tendons
  Numbers pushed_;        // impulses of the tendons in the parts that are done
  Numbers doubted_;       // by coordinate, not 0: it went on through what pybullet tells as its limit
  bool rested_ = false;   // on contacts, in the last step
  bool slipped_ = false;  // through them
  BodyWorkspace work_;
  friend struct StateFields;  // world/state_fields.h
};

}  // namespace bt
