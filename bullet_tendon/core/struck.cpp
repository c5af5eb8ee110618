// The guess that a step begins with, where what turns far strikes another tendon, or itself.
//
// Particles go through each other in it. A contact that deep is a wild force: the first solutions throw the
// segments far away, and it takes several more to bring them back. So they are pushed apart before, by turns:
//
//   each contact      dN = max(-N, ((N_0 - N)/k - g)/(1/k + sum P_i^2 w_i)),    x_i += w_i P_i dN n
//
// with w and P the mobilities and shares of its particles, g the gap there and N = N_0 - k g in the end
// (nonlinear Gauss-Seidel); then each tendon gets its lengths back (pulls.cpp). What comes out answers
// contacts and lengths, but not how tension spreads a push along the tendon: that is left to the solutions.
#include <algorithm>
#include <cmath>

#include "assembly.h"
#include "constants.h"
#include "pulls.h"

namespace bt {

namespace {

bool only_what_turns(const Group& group) {
  const auto turns = [](const Chain* c) { return c->turn > kTurned; };
  const auto between = [](const Row* row) { return row->b.chain >= 0; };
  return std::all_of(group.chains.begin(), group.chains.end(), turns) &&
         std::all_of(group.rows.begin(), group.rows.end(), between);
}

double mobility(Chain& c, const Spot& s) {
  const Pulls p(c);
  return s.w0 * s.w0 * p.w[s.first] + s.w1 * s.w1 * p.w[s.first + 1];
}

void push(Chain& c, const Spot& s, Vec3 by) {
  const Pulls p(c);
  c.move(s.first, (s.w0 * p.w[s.first]) * by), c.move(s.first + 1, (s.w1 * p.w[s.first + 1]) * by);
}

// By how much at most [m].
double push_apart(Group& group) {
  double most = 0;
  for (Row* row : group.rows) {
    Chain &a = group.at(row->a), &b = group.at(row->b);
    const double here = dot(row->normal, relative_position(group, *row, &Chain::next));
    const double gap = here - row->offset - row->allowed;
    const double yields = 1 / row->stiffness + mobility(a, row->a) + mobility(b, row->b);
    const double missing = (row->carried - row->multiplier) / row->stiffness - gap;
    const double more = std::max(-row->multiplier, missing / yields);
    row->multiplier += more;
    push(a, row->a, more * row->normal), push(b, row->b, -more * row->normal);
    most = std::max(most, std::fabs(more) * yields);
  }
  return most;
}

}  // namespace

void guess_struck(Group& group) {
  if (group.rows.empty() || !only_what_turns(group)) return;
  double enough = 0;
  for (Row* row : group.rows) row->multiplier = 0, enough = kGuessed * row->radius;
  for (Chain* c : group.chains) {
    Pulls p(*c);
    weigh(*c, p), measure(c->structure, c->x);
  }
  for (int sweep = 0; sweep < kGuessSweeps && push_apart(group) > enough; ++sweep)
    for (Chain* c : group.chains) {
      Pulls p(*c);
      keep_present(*c, p);
    }
  for (Row* row : group.rows) row->settle_limits();
}

}  // namespace bt
