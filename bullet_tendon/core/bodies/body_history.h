// The history of a body whose tendons are stepped by BDF2.
//
// pybullet moves a body by u_1 = u_0 + dt R (F_1 + k), x_1 = x_0 + dt u_1, with R = M^-1 and k the forces
// that it knows itself. u is the mean velocity of a step. BDF2 for positions and velocities is
//
//   v_1 = v_0 + dt R (G_1 + k),   G_1 = (2 T_1 + G_0)/3,   u_1 = (2 v_1 + u_0)/3,
//
// with T the forces of the tendons at the end of a step and G their mean. So the forces that pybullet has to
// be given are
//
//   F_1 = (2 G_1 + F_0)/3 = 4/9 T_1 + given,   given = 2/9 G_0 + 1/3 F_0.
//
// After a step of implicit Euler, G = F = T and v = u + dt R (F + k)/2: u is the velocity half a step
// earlier. Then constant forces are not changed. u of bodies and of tendons together conserves momentum.
//
// On articulated bodies the same holds for the wrenches on each link, with F at the place of the start of the
// step, where the mass matrix is that of the step: M(q_0) (q_1 - 2 q_0 + q_-1)/dt^2 = h(q_0, v_0) + sum J_l^T
// F_l. pybullet takes the forces h of the motion itself at u_0, half a step behind. It is given what they
// differ by from those at the velocity at the start of the step, 3/2 u_0 - 1/2 u_-1 (joint_forces).
#pragma once
#include "math/small_matrix.h"

namespace bt {

// Share of the step weight of BDF2 in the step, after a step of the same length [-].
constexpr double kTwoStepShare = 2.0 / 3;

struct BodyHistory {
  bool possible = false;    // it moves by what is known of it
  bool smooth = false;      // as TendonState::smooth
  Numbers known;            // known_acceleration of the last step (n); empty: not known
  double steady_share = 1;  // of the forces F of the last step (World::begin_histories)
  double dt = 0;            // length of the last step [s]; 0: the next one is by implicit Euler
  // Of the present step:
  bool asked = false;     // whether it can have a history is decided
  bool able = false;      // it can have one
  bool admitted = false;  // and so can all bodies of its island
  bool coupled = false;   // a tendon acts on it
  bool continues = false;
  Numbers given;  // generalized force of `given` of all its links (n)

  // Step weight over the length of the step.
  double share() const { return continues ? kTwoStepShare : 1; }
  // Whether it ends a step of implicit Euler after which it may continue.
  bool begins() const { return dt > 0 && coupled && !continues; }
  void forget();
};

}  // namespace bt
