// Report of a step, and records of its contacts.
#pragma once
#include "collision/narrow_phase.h"
#include "collision/proximity_cache.h"
#include "contact/contact.h"
#include "world/substepper.h"

namespace bt {

// A contact of the last step, for the user.
struct ContactRecord {
  int tendon = 0, segment = 0, other_tendon = -1, link = -1;
  ContactKind kind = ContactKind::bone;
  Vec3 position, normal;  // position on the centreline [m]; normal from the body (or tendon b) to tendon a
  double distance = 0;    // between the surfaces [m]
  double normal_force = 0, friction_force = 0;  // [N]
};

struct Report {
  int iterations = 0;
  double residual = 0;
  bool converged = true;
  int worst_tendon = -1, worst_particle = -1;
  NearCounts near;
  PairCounts pairs;
  long contacts = 0, islands = 0, asleep = 0;
  // Wall time [s]: reading of bodies; distances to shapes; the rest of the step; and, included in the rest,
  // the search for pairs of segments.
  double sense_seconds = 0, near_seconds = 0, solve_seconds = 0, search_seconds = 0;
  int substeps = 1;          // taken in the step
  long linear_solves = 0;    // of all islands, including those of rejected solutions
  bool over_budget = false;  // the exhausted budget refused work
  ReasonCounts reasons{};    // number of repeated or cut substeps, by reason
  // Adds the report of a solved substep.
  void take(const Report& part);
};

}  // namespace bt
