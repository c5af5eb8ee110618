// A copy of all state that a step changes: the only way back, for a failed step, a step that is solved again,
// and a state that a user saves.
//
// Copies go into the vectors that are there, so that a checkpoint in every step allocates nothing. What is
// not here is made anew from it (the search for tendon pairs), or checks by itself whether it still holds
// (distances, collision/proximity_cache.h).
#pragma once
#include <stdexcept>
#include <vector>

#include "bodies/link.h"
#include "contact/contact_cache.h"
#include "tendon/tendon.h"

namespace bt {

struct TendonCheckpoint {
  bool there = false;
  TendonState state;
  SpringState structure, shear;
};

struct Checkpoint {
  bool valid = false;
  std::vector<TendonCheckpoint> tendons;  // by slot
  std::vector<Link> links;
  std::vector<GeneralizedBody> bodies;
  std::vector<ContactMemory> memory;
  std::vector<Contact> contacts, sleeping_contacts;
  Vec3 rest_gravity;
  double step_length = 0;  // of the last step [s]
  bool way_back = false;   // the last step can be solved again
  // Links and bodies of the step that begins here, once they were read from pybullet.
  std::vector<Link> sensed_links;
  std::vector<GeneralizedBody> sensed_bodies;
};

// Bytes that are no state of this world.
struct StateMismatch : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace bt
