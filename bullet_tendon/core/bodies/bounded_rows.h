// Rows of a body's complementarity problem: stops, whose impulses only push, and motors and constraints,
// whose impulses are bounded on both sides (bodies/body_stops.cpp). With impulses x, a row lacks the rate
// left - W x of what it wants, and
//
//   x within its bounds: it lacks nothing,     at the upper one: it lacks >= 0,     at the lower one: <= 0.
#pragma once
#include <cstddef>
#include <numeric>
#include <utility>
#include <vector>

#include "bodies/joint_motors.h"
#include "math/small_matrix.h"

namespace bt {

// Change of a rate at which pybullet's solver ends its sweeps over stops (the square root of its default
// residual threshold), and the error of rates that is expected of it [m/s], [rad/s].
constexpr double kSolverResidual = 3e-4;
constexpr double kSolverNoise = 1e-3;

// A row of a body along a direction d. A limit that is reached, or a contact, may bound the rate from below
// in this step. A motor, or a constraint with another link, sets the rate, by a force that is bounded.
struct Stop {
  double wanted = 0;     // the bound of the rate, or the rate that is set [m/s], [rad/s]
  double missing = 0;    // `wanted` less the rate predicted without stops and without tendons
  double held_back = 0;  // `wanted` less the rate predicted with the tendons and all other stops
  double unstopped = 0;  // of a constraint or contact: the rate without these [m/s], [rad/s]
  int coordinate = -1;   // of a limit or motor; -1: a contact or constraint
  bool acts = false;     // it sets the rate
  bool admitted = true;  // whether it may begin to act
  // Way to a limit that is not reached yet, so that pybullet does not act on it; negative: behind it [m],
  // [rad].
  double ahead = 0;
  double least = 0, most = kUnlimited;  // bounds of its force [N], [N m]
  int side = -1;  // its force is at the lower bound (-1) or at the upper one (1); 0: it acts
  bool motor = false;
  bool friction = false;   // of bodies that touch: it sets their relative rate to zero
  double coefficient = 0;  // of friction: its largest force over the normal force [-], [m]
  int pair = -1;           // of a contact or friction: the two links that touch
  int constraint = -1;     // the row of one that it stands for; -1: none
  bool yielded = false;    // of a motor: it was within its limit before in this step
  // Of a motor: it has given what would throw its joint at the rate that pybullet cuts off.
  bool firm = false;
  double given = 0;  // share of its impulse that is applied as a known force [-]

  // pybullet's friction needs normal forces of its own.
  bool is_of_contact() const { return friction || (coordinate < 0 && constraint < 0); }
  bool sets_rate() const { return motor || friction || constraint >= 0; }
};

// A row of a matrix times a vector.
inline double along(const dense::Numbers& rows, size_t row, const dense::Numbers& of) {
  return std::inner_product(of.begin(), of.end(), rows.begin() + row * of.size(), 0.0);
}

class BoundedRows {
 public:
  // within: W = D R D^T (m m); left (m) [m/s], [rad/s]; whole (m): sum of the sizes of the rates that left is
  // made of. dt: the time for which the forces act [s].
  BoundedRows(const std::vector<Stop>& rows, const Numbers& within, const Numbers& left, const Numbers& whole,
              double dt)
      : rows_(rows), within_(within), left_(left), whole_(whole), dt_(dt) {}

  // Sets the impulses (m), beginning with these. Where the rows depend on each other this can go in circles:
  // then it leaves them, and returns false.
  bool solve(Numbers& pushes) const;
  // -1, 1: an impulse is at its lower or upper bound; 0: it is within.
  int side_of(size_t row, double push) const {
    return push <= bound(row, -1) ? -1 : push >= bound(row, 1) ? 1 : 0;
  }
  double bound(size_t row, int side) const { return dt_ * (side < 0 ? rows_[row].least : rows_[row].most); }
  // The rate that a row lacks with these impulses.
  double lacks(size_t row, const Numbers& pushes) const { return left_[row] - along(within_, row, pushes); }
  // Sets swept (m) to the impulses that pybullet's sweeps end with. What was solved and given to it is fixed.
  void sweep_as_pybullet(const Numbers& solved, Numbers& swept) const;
  // Largest difference of a rate by these impulses and by those.
  double differs(const Numbers& a, const Numbers& b) const;

 private:
  using Sides = std::vector<int>;
  std::vector<size_t> find_motors() const;
  static void leave_to_motors(const std::vector<size_t>& motors, Sides& sides);
  static bool held_by_motor(size_t row, const std::vector<size_t>& motors, const Sides& sides);
  void solve_acting(const Sides& sides, Numbers& pushes) const;
  std::pair<size_t, int> first_wrong(const std::vector<size_t>& motors, const Sides& sides,
                                     const Numbers& pushes) const;
  double sweep(Numbers& pushes, bool backwards) const;

  const std::vector<Stop>& rows_;
  const Numbers &within_, &left_, &whole_;
  double dt_;
};

}  // namespace bt
