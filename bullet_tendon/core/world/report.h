// Report of a step.
#pragma once
#include "collision/narrow_phase.h"
#include "collision/proximity_cache.h"
#include "integrator/substepper.h"

namespace bt {

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
  int substeps = 1;           // taken in the step
  long linear_solves = 0;     // of all islands, including those of rejected solutions
  bool over_budget = false;   // the exhausted budget refused work
  bool stops_settled = true;  // the stops of all bodies act as the forces of the solution ask for
  ReasonCounts reasons{};     // number of repeated or cut substeps, by reason
  int coarse_tendon = -1;     // slot of a tendon of which a turn has to be reported; -1: none
  int flat_cartilage = -1;    // slot of cartilage of which a depth beyond its thickness has to be; -1: none
  // Adds the report of a solved substep.
  void take(const Report& part);
  void add(const ReasonCounts& more) {
    for (size_t i = 0; i < reasons.size(); ++i) reasons[i] += more[i];
  }
};

}  // namespace bt
