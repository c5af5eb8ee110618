// What a step tells of itself.
#pragma once
#include "collision/narrow_phase.h"
#include "collision/proximity_cache.h"
#include "contact/contact.h"
#include "world/substepper.h"

namespace bt {

// What a contact was in the last step, for reading out.
struct ContactRecord {
  int tendon = 0, segment = 0, other_tendon = -1, link = -1;
  ContactKind kind = ContactKind::bone;
  Vec3 position, normal;  // on the centreline; from the body (or tendon b) to tendon a
  double distance = 0;    // between the surfaces [m]
  double normal_force = 0, friction_force = 0;
};

struct Report {
  int iterations = 0;
  double residual = 0;
  bool converged = true;
  int worst_tendon = -1, worst_particle = -1;
  NearCounts near;
  PairCounts pairs;
  long contacts = 0, islands = 0, asleep = 0;
  // Wall time [s]: reading bodies; distances that could matter; the rest of the step; and of that the search
  // for segments of tendons that could touch.
  double sense_seconds = 0, near_seconds = 0, solve_seconds = 0, search_seconds = 0;
  int substeps = 1;          // that the step was taken in
  long linear_solves = 0;    // of all islands, whatever came of them
  bool over_budget = false;  // the budget was used up
  ReasonCounts reasons{};    // how often substeps were solved again, by reason
  // Adds a substep that was solved.
  void take(const Report& part);
};

}  // namespace bt
