// A copy of all state that a step changes. It is the only way back: for a step that fails, for a step that is
// solved again, and, with the models of the tendons, for a state that a user saves.
//
// Copies go into existing vectors, so that a checkpoint in every step allocates nothing. What is not in it is
// made anew from it (the search for pairs of tendons), or checks by itself whether it holds (distances,
// collision/proximity_cache.h).
#pragma once
#include <stdexcept>
#include <vector>

#include "bodies/link.h"
#include "contact/contact_cache.h"
#include "tendon/tendon.h"

namespace bt {

struct TendonCheckpoint {
  bool alive = false;
  TendonState state;
  SpringState structure, shear;
};

// A step that was taken.
struct StepRecord {
  double dt = 0;  // [s]
  Vec3 gravity;   // [m/s^2]
};

struct Checkpoint {
  bool valid = false;
  std::vector<TendonCheckpoint> tendons;  // by slot
  std::vector<Link> links;
  std::vector<GeneralizedBody> bodies;
  std::vector<ContactMemory> memory;
  std::vector<Contact> contacts, sleeping_contacts;
  Vec3 rest_gravity;
  StepRecord last_step;
  bool may_resolve = false;  // the last step can be solved again
  // Links and bodies as they were read from pybullet for the step that begins here.
  std::vector<Link> sensed_links;
  std::vector<GeneralizedBody> sensed_bodies;
};

// Bytes that are no state of this world.
struct StateMismatch : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace bt
