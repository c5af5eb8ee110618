// How far the particles of a tendon go, all together and each by itself.
#pragma once
#include "field.h"

namespace bt {

// Of particles that have moved: each by `by`, but for `off` at most [m].
struct Travel {
  Vec3 by;
  double off = 0;
};

// Of what all moves by something from `low` to `high`.
inline Travel travel_between(Vec3 low, Vec3 high) { return {0.5 * (low + high), 0.5 * norm(high - low)}; }

// What a tendon does: since a place of reference, and, as foreseen, in the step.
class Traveller {
 public:
  // Looks where it is. A particle may end `slack` from where it is foreseen to, and acts `skin` far [m].
  void look(const Field& x, const Field& foreseen, double slack, double skin);
  // What follows is measured from here on; what was before adds up.
  void settle(const Field& x);

  // Since the first look; `off` is the sum of what was found from one reference to the next.
  Vec3 gone() const { return before_.by + now_.by; }
  double gone_off() const { return before_.off + now_.off; }
  // That part of it which a difference of two sums has twice.
  double since_settled() const { return now_.off; }
  const Travel& way() const { return way_; }
  double reach() const { return reach_; }  // skin and slack [m]
  double skin() const { return skin_; }

 private:
  Field reference_;
  Travel before_, now_, way_;
  double reach_ = 0, skin_ = 0;
};

}  // namespace bt
