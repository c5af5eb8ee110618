// A copy of all state that a step changes. It restores the state before a step that fails or is solved again.
// With the models of the tendons, it is also the state that a user saves.
//
// Copies reuse existing vectors, so that a checkpoint in every step allocates nothing. Other data is
// recomputed (pairs of segments), or checks its own validity (distances, collision/proximity_cache.h).
#pragma once
#include <stdexcept>
#include <vector>

#include "bodies/link.h"
#include "cartilage/cartilage.h"
#include "contact/contact_cache.h"
#include "ligament/ligament.h"
#include "tendon/tendon.h"

namespace bt {

struct TendonCheckpoint {
  bool alive = false;
  TendonState state;
  SpringState structure, shear;
};

// State of the elements, by slot.
struct ElementCheckpoint {
  std::vector<LigamentState> ligaments;
  std::vector<CartilageState> cartilages;
};

// Length and gravity of a completed step.
struct StepRecord {
  double dt = 0;  // [s]
  Vec3 gravity;   // [m/s^2]
};

struct Checkpoint {
  bool valid = false;
  std::vector<TendonCheckpoint> tendons;  // by slot
  std::vector<Link> links;
  std::vector<GeneralizedBody> bodies;
  std::vector<int> touching;  // see World::touching
  bool touching_known = false;
  std::vector<ContactMemory> memory;
  std::vector<Contact> contacts, sleeping_contacts;
  Vec3 rest_gravity;  // when the last tendon fell asleep [m/s^2]
  StepRecord last_step;
  bool may_resolve = false;  // the last step can be solved again
  // Links and bodies as read from pybullet for the step that begins at this checkpoint.
  std::vector<Link> sensed_links;
  std::vector<GeneralizedBody> sensed_bodies;
  ElementCheckpoint elements;
  std::vector<Pose> held;  // of TendonStiffness; no part of what a user saves
};

// The bytes are not a state of this world.
struct StateMismatch : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace bt
