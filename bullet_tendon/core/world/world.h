// The core's world: tendons, links, shapes and tunnels, and one step of them in named stages.
//
//   predict           history, inertial targets and starting guess of every tendon
//   update_proximity  which distances are needed, and their values
//   collect_contacts  contacts from planes, bores, mouths and pairs of tendons, warm started
//   solve_islands     each island by itself
//   take_substep      new states, contact memories, and one wrench per touched link
//
// world/step.cpp has the loop, and world/checkpoint.cpp the way back where a step fails.
#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "collision/broad_phase.h"
#include "solver/linear_solve.h"
#include "world/checkpoint.h"
#include "world/report.h"

namespace bt {

// Measures distances to shapes that the core cannot measure by itself.
class DistanceOracle {
 public:
  virtual ~DistanceOracle() = default;
  // By query: distance [m], nearest surface point (3) and parameter of the segment
  // (collision/proximity_cache.h, answer).
  virtual void measure(const std::vector<Query>& queries, std::vector<double>& distance,
                       std::vector<double>& points, std::vector<double>& u) = 0;
  // Called now and then in a step. It may throw, which ends the step.
  virtual void poll() {}
};

// What a world is made of. Slots keep their numbers: a removed part leaves an empty slot, and the next
// addition takes it.
struct Scene {
  std::vector<std::unique_ptr<Tendon>> tendons;
  std::vector<Link> links;
  std::vector<GeneralizedBody> bodies;  // each in the slot of one of its links; empty in the others
  std::vector<Shape> shapes;
  std::vector<Tunnel> tunnels;
  std::vector<char> shape_alive;
  std::vector<char> tunnel_alive;
};

// One step, and the substep that is being solved.
struct StepState {
  StepContext context;
  bool whole = false;  // it must not be cut
  Substepper substeps;
  Budget budget;
  int parts = 1;               // that a step whose segments turn far is begun with
  bool failed = false;         // a solution is not finite
  double motion_limit = 1;     // share of the substep that can pass before something unpredicted touches
  bool unconverged = false;    // an island did not converge
  int detections = 0;          // of contacts, after a solution of this substep
  int stop_changes = 0;        // times that this substep was solved again for other joint stops
  std::vector<Tendon*> slots;  // tendons of this step, by slot
  Report report;               // of the step
  Report attempt;              // of the last solution of a substep
};

// What is near what.
struct Detection {
  std::vector<std::vector<NearCache>> caches;  // [tendon][shape]
  std::vector<Query> queries;
  std::vector<double> distances;  // the answers to them
  std::vector<double> points;
  std::vector<double> parameters;
  BroadPhase broad_phase;
  std::vector<SegmentPair> pairs;
  std::vector<Bore> bores;  // by tunnel
  std::vector<std::vector<Bore>> bores_by_link;
  std::vector<int> near_tunnels;  // of one tendon
};

// Contacts of this substep or of the last one, and what is remembered of them.
struct ContactSet {
  std::vector<Contact> all;     // of this detection
  std::vector<Contact> solved;  // of the last solution of this substep
  std::vector<Contact> asleep;  // of tendons that sleep
  std::vector<ContactMemory> memory;
  std::vector<uint64_t> touching;
};

// Which islands may sleep.
struct SleepState {
  Vec3 gravity;                // when the last tendon fell asleep
  std::vector<char> restful;   // by root of an island
  std::vector<char> restless;  // by root of an island
  std::vector<Box> reach;      // of tendons that do not sleep, by slot
};

// Which tendons are solved together (union-find), and by which bodies.
struct IslandSet {
  std::vector<Island> all;
  std::vector<int> parent;   // of a tendon
  std::vector<int> touches;  // by body, one of the tendons that touch it
  std::vector<char> solid;   // by link: it has a shape or a tunnel
};

// Checkpoints of the last step and of the step to come.
struct History {
  Checkpoint start;          // of the last step
  Checkpoint now;            // of an attempt whose step has not begun
  StepRecord last_step;      // that is not whole
  bool may_resolve = false;  // the last step can be solved again: bodies had a part in it
};

class World {
 public:
  // Held by whoever calls a method while other threads may do so too.
  mutable std::recursive_mutex mutex;
  Options options;
  Scene scene;

  // Makes the slot of a link. Until the link is read from pybullet, it is one that nothing moves.
  void ensure_link(int link);
  int add_tendon(std::unique_ptr<Tendon> tendon);
  void remove_tendon(int slot);
  int add_shape(const Shape& shape);
  void remove_shape(int slot);
  int add_tunnel(const Tunnel& tunnel);
  void remove_tunnel(int slot);
  // Forgets contacts, planes and tunnels of one tendon, after it was moved from outside.
  void forget_contacts(int tendon);

  // Observes how links moved since the last step, and predicts how they will move in the next one, of dt.
  // held: nothing moves them, and nothing is learned.
  void sense(double dt, Vec3 gravity, bool held);
  // Bodies that were released in the last step, which was solved as if they were held.
  std::vector<int> released_bodies() const;
  // Free rigid bodies that an unpredicted force moved in the last step, so far that it stretches their
  // tendons.
  std::vector<int> pulled_bodies() const;
  // Goes back to before the last step, to solve it again. Released bodies are free from now on, and the
  // observed motion of the bodies `pulled` is their predicted motion in that step. false: it cannot be solved
  // again, and only the released bodies have changed.
  bool rewind(const std::vector<int>& pulled);
  bool any_held() const;
  // Records the rates of a body right after a step; whether it seems to have been released.
  bool sample(int body, const dense::Numbers& rates);
  // The body is free: nothing can hold it.
  void let_go(int body);
  // Ends the correction of the last step, in which the rates of bodies were set from outside. That step is
  // not solved again, and an attempt that fails goes back to this state.
  void finish_resolve();
  // The last step is not solved again: something that it began from was changed.
  void forbid_resolve() { history_.may_resolve = false; }
  // One step of dt [s], after `sense` (if any) has read the bodies. false: some solution is not finite. Then,
  // and where it throws, all state is that of before. whole: not in substeps, whatever happens (for steps
  // whose length means nothing); bodies neither move nor yield.
  bool attempt(double dt, Vec3 gravity, bool whole, DistanceOracle& oracle,
               const std::function<void()>& sense);
  // The step alone. Where it fails, the state is undefined.
  bool step(double dt, Vec3 gravity, bool whole, DistanceOracle& oracle);
  // The last step that is not whole.
  const StepRecord& last_step() const { return history_.last_step; }
  // Called after every substep, for tests.
  std::function<void()> after_substep;

  // All state as bytes (world/state_fields.h lists it), and back. restore throws StateMismatch, and changes
  // nothing, unless the bytes are a state of a world that is made of the same parts.
  std::vector<char> save();
  void restore(const char* from, size_t size);

  const Report& report() const { return step_.report; }
  Vec3 gravity() const { return step_.context.gravity; }  // of the last step
  std::vector<ContactRecord> contacts() const;
  // The tendon steps again, with all that sleep with it, because something about it has changed.
  void wake_tendon(int tendon);
  void wake_all();

 private:
  // world/checkpoint.cpp
  void capture(Checkpoint& to) const;
  void apply(const Checkpoint& from);
  void require_state(const Checkpoint& c) const;
  uint64_t structure_mark() const;
  void size_caches();
  void empty_caches();
  template <class Which>
  void forget_memory(Which which);
  void forget_memory_of(int tendon);
  void forget_planes();
  bool any_moved() const;
  double pulled_away(const Tendon& c, const Anchor& anchor) const;
  bool take_back();
  // Predicts how a body will move in this step.
  void predict(int body);
  void lead_links(int body);
  // The motion of a link has a jump: two-step methods restart in all tendons, because tendons that share
  // forces must have the same step weights.
  void interrupt();
  void aim_attachments(Tendon& c);
  // world/step.cpp
  void begin_step_of_world(double dt, Vec3 gravity, bool whole);
  void predict();
  void update_proximity(DistanceOracle& oracle);
  std::optional<Reason> solve_substep();
  std::optional<Reason> outlast_history();
  std::optional<Reason> solve_islands();
  void solve_again(Reason why);
  void take_substep();
  void finish_step_of_world();
  void measure_wrenches();
  bool predict_at_solution();
  void inherit_multipliers();
  // integrator/scheme.cpp
  // Tendons that press on each other get the same step weight, so that their impulses are equal and opposite.
  // true: some tendons had another one.
  bool share_weights();
  // world/bodies.cpp
  template <class Do>
  void each_touch(Do what) const;
  void count_touches();
  void find_point_masses();
  void find_unknowns();
  void find_bodies();
  void narrow_bodies();
  template <class Of>
  void sum_forces(double scale, Of wrench_of);
  void act_on_bodies();
  bool find_turning();
  void push_bodies();
  bool settle_stops();
  void find_solid_links();
  // world/islands.cpp
  bool solve_each_island();
  void read_worst(const Island& island);
  // world/contact_builder.cpp
  void collect_contacts();
  void bone_contacts();
  void half_space_contacts(int tendon, int shape);
  void tendon_contacts();
  void pair_contact(const SegmentPair& pair, const PairPoint& at);
  void finish_contact(Contact& contact, int tendon_slot, int particle);
  void finish_contact(Contact& contact, const HeldBack& held, double radius, bool two_step);
  void finish_pair(Contact& contact);
  void add_contact(const Contact& contact);
  double depth_to_leave(const Contact& contact, double most) const;
  // inertia: of the particle that the contact is of, over the step's weight squared [N/m].
  void recall(Contact& contact, double inertia);
  void remember();
  // world/sleeping.cpp
  bool any_asleep() const;
  bool feels(const Tendon& c, int link, double dt) const;
  void wake_disturbed(double dt);
  bool is_met(const Tendon& asleep) const;
  bool wake_met();
  void join_step();
  bool count_rest(double dt);
  void find_restful();
  void fall_asleep();
  void push_asleep();
  // world/contact_builder.cpp
  void find_bores();
  void classify(Tendon& c);
  // Those that the tendon could touch in the step, by boxes, and those that it is in, into near_tunnels_.
  void find_near_tunnels(const Tendon& c);
  void bore_contacts(int tendon, int tunnel);
  void mouth_contacts(int tendon, int tunnel);
  double mouth_reach(int tendon, int t, int k) const;
  void mouth_contact(int tendon, int tunnel, int mouth, int segment, const Bore& bore, Vec3 centre,
                     double radius);

  const std::vector<Bore>& bores_of(int link) const { return detection_.bores_by_link[link]; }
  void make_islands();
  int island_root(int tendon);
  void join_islands(int a, int b);
  Contact plane_contact(SegmentPoint spot, int link, Vec3 point, Vec3 normal, const ContactKey& key,
                        double friction);

  StepState step_;
  Detection detection_;
  ContactSet contacts_;
  SleepState sleep_;
  IslandSet islands_;
  History history_;
};

}  // namespace bt
