// The world: tendons, links, shapes and tunnels. One step has these stages:
//
//   predict           history, inertial targets and starting guess of every tendon
//   update_proximity  distances between tendons and shapes, where they are needed
//   limit_motion      shortens the substep so that nothing passes through anything
//   collect_contacts  contacts with bones, bores, mouths and tendons, with warm start
//   solve_islands     solves each island by itself
//   take_substep      updates tendons, contact memory and the wrenches on links
//
// world/step.cpp has the loop. world/checkpoint.cpp restores the state when a step fails.
#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "cartilage/cartilage.h"
#include "collision/broad_phase.h"
#include "geometry/drilled_mesh.h"
#include "integrator/scheme.h"
#include "ligament/ligament.h"
#include "solver/island.h"
#include "world/checkpoint.h"
#include "world/report.h"
#include "world/slots.h"

namespace bt {

// Measures distances to shapes that the core cannot measure by itself.
class DistanceOracle {
 public:
  virtual ~DistanceOracle() = default;
  // Writes for each query the distance [m], the nearest surface point [m] and the segment parameter in [0, 1]
  // (collision/proximity_cache.h, answer).
  virtual void measure(const std::vector<Query>& queries, std::vector<double>& distance,
                       std::vector<Vec3>& points, std::vector<double>& u) = 0;
  // Called repeatedly during a step. It may throw, which ends the step.
  virtual void poll() {}
};

// The objects of a world.
struct Scene {
  Slots<Tendon> tendons;
  std::vector<Link> links;
  std::vector<GeneralizedBody> bodies;  // each body is in the slot of one of its links; other slots are empty
  Slots<Shape> shapes;
  Slots<Tunnel> tunnels;
  CollisionFilter filter;
  Slots<Ligament> ligaments;
  Slots<Cartilage> cartilages;
  PairList element_pairs;
  // Calls what(element) for every element.
  template <class Do>
  void each_element(Do what) const {
    for (auto [slot, ligament] : filled(ligaments)) what(static_cast<Element&>(ligament));
    for (auto [slot, cartilage] : filled(cartilages)) what(static_cast<Element&>(cartilage));
  }
  bool has_elements() const { return !ligaments.empty() || !cartilages.empty(); }
  // Lists the pairs of links that elements touch together.
  void pair_elements() {
    element_pairs.all.clear();
    each_element([&](Element& element) { element_pairs.include(element); });
  }
  // The bore of a tunnel, in its link's frame.
  Bore bore_in_link(int tunnel) const { return in_world(*tunnels[tunnel], Pose{}); }
};

// One step, and the substep that is being solved.
struct StepState {
  StepContext context;
  bool whole = false;  // the step must not be divided into substeps
  double at_hand = 0;  // of StepContext, in a `whole` step
  Substepper substeps;
  Budget budget;
  bool attempted = false;             // within World::attempt, which has started the budget
  bool resolved = false;              // the attempt has solved the previous step again
  int parts = 1;                      // initial number of substeps of a step in which a segment turns far
  bool failed = false;                // a solution is not finite
  double motion_limit = 1;            // share of the substep in which nothing can pass through anything [-]
  bool unconverged = false;           // an island did not converge
  std::vector<char> unsolved;         // by tendon: a solution of its island has failed
  std::vector<char> unsolved_bodies;  // the same, by body
  double solved_share = 1;            // share of the step before its early end [-]
  std::vector<int> left_out;          // tendons that take no part in the rest of the step
  int detections = 0;                 // contact detections after a solution of this substep
  int stop_changes = 0;               // times that this substep was solved again because joint stops changed
  std::vector<Tendon*> slots;         // tendons that move in the substep, by slot; null elsewhere
  Report report;                      // of the whole step
  Report attempt;                     // of the last substep solution
};

// Distances and candidate pairs for contacts.
struct Detection {
  std::vector<std::vector<NearCache>> caches;  // [tendon][shape]
  Queries queries;
  std::vector<double> distances;  // answers by query: distances [m], surface points, segment parameters
  std::vector<Vec3> points;
  std::vector<double> parameters;
  BroadPhase broad_phase;
  std::vector<SegmentPair> pairs;
  std::vector<Bore> bores;  // by tunnel
  std::vector<std::vector<Bore>> bores_by_link;
  std::vector<Bore> wide_bores;                   // of one link, for one tendon
  std::vector<int> wide_tunnels;                  // the same
  std::vector<int> near_tunnels;                  // of one tendon
  std::vector<int> pressed;                       // NearContext::pressed
  std::vector<std::vector<DrilledMesh>> drilled;  // [shape], for each set of bores that tendons may enter
};

// A segment near a mouth of a tunnel.
struct SegmentAtMouth {
  int tendon = 0, tunnel = 0, mouth = 0, segment = 0;
  bool threads = false;  // it passes through the mouth
  double reach = 0;      // distance from the mouth's edge within which it can touch it in the substep [m]
  BentSegment now;       // at the start of the substep
};

// Contacts of this substep and their memory.
struct ContactSet {
  std::vector<Contact> all;     // of the current detection
  std::vector<Contact> solved;  // of the previous solution of this substep
  std::vector<Contact> asleep;  // of sleeping tendons
  std::vector<Contact> before;  // of the last substep before an early end
  std::vector<ContactMemory> memory;
  std::vector<bool> recalled;  // work space, by memory: whether it is a contact of this detection
  std::vector<uint64_t> touching;
};

// Decides which islands sleep.
struct SleepState {
  Vec3 gravity;                // when the last tendon fell asleep [m/s^2]
  std::vector<char> restful;   // by island root: something supports the island
  std::vector<char> restless;  // by island root: the island must not sleep
  std::vector<Box> reach;      // of awake tendons in the step, by slot
};

// Tendons that are solved together (union-find).
struct IslandSet {
  std::vector<Island> all;
  std::vector<int> parent;         // union-find, by tendon
  std::vector<int> touches;        // by body: one tendon that touches it, or -1
  std::vector<char> solid;         // by link: the link has a shape or a tunnel
  std::vector<char> solid_bodies;  // by body: one of its links is solid, and yields
  std::vector<LinkEnd> ends;       // by link: of links that elements touch
  IslandElements loose;            // elements that touch no body with unknowns
};

// How the tendons' wrenches on these links change with the links' twists: found in steps that hold the bodies
// (world/tendon_stiffness.cpp).
struct TendonStiffness {
  std::vector<int> links;  // distinct slots; empty: not wanted
  dense::Numbers matrix;   // second derivatives of the potential (6 k, 6 k), with the particles at rest
  dense::Numbers motion;   // of the particles of all tendons by the twists, one after the other (6 k, 3 N)
  bool known = false;      // the last such step had one
  std::vector<Pose> held;  // where these links were in the last such step; empty: there was none
};

// Checkpoints that restore the state before the last step or before a failed one. Pointers, because the two
// change places in every step.
struct History {
  std::unique_ptr<Checkpoint> start = std::make_unique<Checkpoint>();  // before the last step
  std::unique_ptr<Checkpoint> now = std::make_unique<Checkpoint>();    // before a step that has not begun
  std::unique_ptr<Checkpoint> taken = std::make_unique<Checkpoint>();  // after a step that is solved again
  StepRecord last_step;                                                // the last one that was not `whole`
  bool may_resolve = false;  // the last step can be solved again; only where bodies move
};

// The slots of parts of which is(part) is true.
template <class Part, class Is>
std::vector<int> slots_where(const std::vector<Part>& parts, Is is) {
  std::vector<int> found;
  for (size_t i = 0; i < parts.size(); ++i)
    if (is(parts[i])) found.push_back(static_cast<int>(i));
  return found;
}

// Removes the entries of which is(entry) is true.
template <class Entry, class Is>
void remove_where(std::vector<Entry>& list, Is is) {
  list.erase(std::remove_if(list.begin(), list.end(), is), list.end());
}

// Calls what(tendon, anchor) for every anchor of these tendons; null entries are left out.
template <class Do>
void each_anchor(const std::vector<Tendon*>& tendons, Do what) {
  for (auto [slot, c] : filled(tendons))
    for (Anchor& anchor : c.anchors) what(c, anchor);
}

class World {
 public:
  // Locked by callers of methods where other threads may call them too.
  mutable std::recursive_mutex mutex;
  Options options;
  Scene scene;
  TendonStiffness stiffness;

  // Creates the slot of a link. Until the link is read from pybullet, it does not move.
  void ensure_link(int link);
  int add_tendon(std::unique_ptr<Tendon> tendon);
  void remove_tendon(int slot);
  int add_shape(const Shape& shape);
  void remove_shape(int slot);
  int add_tunnel(const Tunnel& tunnel);
  // Where the axis of a tunnel meets its mouths' planes [m], and the slopes of these (Rim), in its link's
  // frame.
  void set_mouths(int slot, const Vec3 (&centre)[2], const Vec3 (&slope)[2]);
  void remove_tunnel(int slot);
  // Of scene.ligaments or scene.cartilages.
  template <class Kind>
  int add_element(Slots<Kind>& slots, std::unique_ptr<Kind> element) {
    for (const TouchedLink& touched : element->touched()) ensure_link(touched.link);
    forbid_resolve();
    const int slot = slots.add(std::move(element));
    scene.pair_elements();
    return slot;
  }
  template <class Kind>
  void remove_element(Slots<Kind>& slots, int slot) {
    forbid_resolve();
    slots.remove(slot);
    scene.pair_elements();
  }
  // Changes scene.filter by change(filter) for these tendons.
  void filter_contacts(std::initializer_list<int> tendons,
                       const std::function<void(CollisionFilter&)>& change);
  // Deletes contacts, contact memory, cached planes and tunnel membership of a tendon that the user has
  // moved.
  void forget_contacts(int tendon);

  // Observes the motion of links since the last step, and predicts their motion in the next step of dt [s].
  // held: links do not move, and the observers learn nothing.
  void sense(double dt, Vec3 gravity, bool held);
  // Bodies that were released in the last step, while the step predicted them as held.
  std::vector<int> released_bodies() const;
  // Free rigid bodies that an unpredicted force moved in the last step, far enough to stretch their tendons.
  std::vector<int> pulled_bodies() const;
  // Restores the state before the last step, so that it can be solved again. Released bodies become free. The
  // bodies `pulled` are predicted with their observed motion. false: the step cannot be solved again, and
  // only the released bodies have changed.
  bool rewind(const std::vector<int>& pulled);
  // Takes the new solution of the step that was rewound. Anchors go on with what the user has chosen for them
  // since that step. was_read: its forces may have been read before it was solved again. What they lacked is
  // then read with the next step, so that the impulses that are read are those that act.
  void accept_resolve(bool was_read);
  // Treats the body as free: nothing but the tendons holds it.
  void let_go(int body);
  // Ends relaxation: bodies have rested under the forces of tendons and elements where they are now, and
  // nothing is learned from how they came there. Call it once they were read.
  void rest_bodies();
  // Ends the correction of the last step, in which the caller set the rates of bodies. That step is not
  // solved again. An attempt that fails restores this state.
  void finish_resolve();
  // The last step is not solved again, because its initial state was changed.
  void forbid_resolve() { history_.may_resolve = false; }
  // One step of dt [s]. First `sense` (if any) reads the bodies. It may solve the previous step again, within
  // the budget of this one. false: a solution is not finite. In that case, and if it throws, the state is
  // unchanged. whole: without substeps (for relaxation, where dt has no physical meaning); bodies are held.
  bool attempt(double dt, Vec3 gravity, bool whole, DistanceOracle& oracle,
               const std::function<void()>& sense);
  // Such a step in which bodies are held. at_hand: largest force on them beside the tendons' [N].
  bool hold(double dt, Vec3 gravity, double at_hand, DistanceOracle& oracle);
  // The step without a checkpoint. If it fails, the state is undefined.
  bool step(double dt, Vec3 gravity, bool whole, DistanceOracle& oracle);
  // Share of a motion of links, and of all particles, one after the other, in which nothing passes through
  // anything, as in a step of time. Without particles, that of elements alone.
  double safe_share(const std::vector<Twist>& of_links, const double* of_particles, DistanceOracle& oracle);
  // Moves all particles, one after the other, with bodies that are put elsewhere next.
  void carry_tendons(const double* motion);
  // The last step that was not `whole`.
  const StepRecord& last_step() const { return history_.last_step; }
  // By slot, position and orientation of links that pybullet's step did not move, as they were last read.
  std::vector<std::optional<std::array<double, 7>>> standing;
  // Pairs of bodies that touch, and whether they are those of the next step (pybullet does not restore its
  // contacts).
  std::vector<int> touching;
  bool touching_known = false;
  // Called after every substep, and after every solution of an island, for tests.
  std::function<void()> after_substep;
  std::function<void(Island&, const StepContext&)> after_solution;

  // Converts all state (listed in world/state_fields.h) to bytes and back. If the bytes are not a state of a
  // world with the same objects, restore throws StateMismatch and changes nothing.
  std::vector<char> save();
  void restore(const char* from, size_t size);
  // The same without bytes, as long as the world has the same objects. The step before is not solved again.
  std::shared_ptr<Checkpoint> checkpoint() const;
  // The same into one that is there, in whose memory it fits mostly.
  void capture(Checkpoint& to) const;
  void return_to(const Checkpoint& at);

  const Report& report() const { return step_.report; }
  Vec3 gravity() const { return step_.context.gravity; }  // of the last step
  // Contacts of the last step, those of islands that sleep behind the others.
  size_t contact_count() const { return contacts_.all.size() + contacts_.asleep.size(); }
  const Contact& contact(size_t i) const {
    const size_t awake = contacts_.all.size();
    return i < awake ? contacts_.all[i] : contacts_.asleep[i - awake];
  }
  // Wakes the whole island of a tendon.
  void wake_tendon(int tendon);
  void wake_all();

 private:
  // world/checkpoint.cpp
  template <class W, class C, class Copy>
  static void each_part(W& world, C& checkpoint, Copy copy);
  void apply(const Checkpoint& from);
  void require_state(const Checkpoint& c) const;
  void require_elements(const ElementCheckpoint& c) const;
  uint64_t structure_mark() const;
  void size_caches();
  void empty_caches();
  template <class Which>
  void forget_memory(Which which);
  void forget_memory_of(int tendon);
  void forget_planes();
  bool any_moved() const;
  double pulled_away(const Tendon& c, const Anchor& anchor) const;
  void put_bodies_back();
  void return_to_start(const StepRecord& step);
  void begin_again(Reason why);
  // Predicts the motion of a body, and of its links, in this step.
  void predict(int body);
  void lead_links(int body);
  const GeneralizedBody* body_of(const Link& l) const;
  void lead_bodies();
  void foresee_ends();
  // Restarts two-step methods in all tendons, because the motion of a link is discontinuous. All restart,
  // because tendons that exert forces on each other must have the same step weight.
  void interrupt();
  void aim_attachments(Tendon& c);
  void expect_carried(Tendon& c);
  // world/step.cpp
  void start_budget(DistanceOracle& oracle);
  void begin_step_of_world(double dt, Vec3 gravity, bool whole);
  void predict();
  void update_proximity(DistanceOracle& oracle);
  std::optional<Reason> solve_substep();
  std::optional<Reason> outlast_history();
  std::optional<Reason> solve_islands();
  bool solution_leaves() const;
  bool outruns_prediction();
  void solve_again(Reason why);
  void take_substep();
  void finish_step_of_world();
  void measure_wrenches();
  bool predict_at_solution();
  void inherit_multipliers();
  // world/early_end.cpp
  void end_early();
  void outlast_failure();
  bool any_moves() const;
  bool stays(const Element& element) const;
  bool stays(const Link& link) const;
  void mark_unsolved(const Island& island);
  bool is_unsolved(const Island& island) const;
  bool is_limited(const Island& island) const;
  bool any_limited() const;
  bool is_near_left_out(const Island& island) const;
  void leave_out_near();
  void leave_out_island(Island& island);
  void leave_out_limited();
  void leave_out_unsolved(bool leaving);
  void finish_left_out();
  // world/histories.cpp
  template <class Do>
  void each_coupling(Do what);
  template <class Do>
  void each_pair(Do what);
  template <class Do>
  void each_lost_contact(Do what);
  void continue_histories();
  void continue_history(int body);
  void find_couplings();
  // Gives what acts on each other the same step weight, so that impulses are equal and opposite. true: a step
  // weight has changed.
  bool share_weights();
  // Ends the histories of tendons in contact whose velocities jump in this substep. true: there are some.
  bool restart_jolted();
  bool gives_twice(const Tendon& c) const;
  Vec3 given(const Tendon& c, Vec3 mean, Vec3 last) const;
  Vec3 known_acceleration(const Tendon& c, int i) const;
  void begin_histories();
  // world/bodies.cpp
  template <class Do>
  void each_touch(Do what) const;
  void count_touches();
  void find_point_masses();
  void find_unknowns();
  void find_bodies();
  template <class Of>
  void sum_forces(double scale, Of wrench_of);
  void act_on_bodies();
  bool turns_finitely() const;
  void mark_touchable_bodies();
  bool find_turning();
  void push_bodies();
  std::optional<Reason> settle_stops();
  void measure_forces();
  bool limit_holds();
  void find_solid_links();
  // world/islands.cpp
  bool solve_each_island();
  bool overpowers() const;
  void read_worst(const Island& island);
  void let_read();
  void find_coarse_turns_on_body(const Contact& contact, Tendon& c, double gravity);
  void find_coarse_turns_on_tendon(const Contact& contact, bool seen_from_other, double gravity);
  void find_coarse_turns();
  void find_flat_cartilage();
  // world/contact_builder.cpp
  void limit_motion();
  void collect_contacts();
  void limit_motion(Tendon& c, double share);
  void drop_contacts_of_torn();
  void constrain_once();
  void find_pairs();
  void pair_contact(const SegmentPair& pair, const PairPoint& at);
  void add_link_contact(Contact& contact, int link, double friction);
  void finish_contact(Contact& contact, const HeldBack& held, double radius);
  bool turns_far(const Link& link) const;
  void set_arm(Contact& contact) const;
  bool is_contradicted(const Contact& contact) const;
  bool is_beside(const Anchor& anchor, const Contact& contact) const;
  const ContactMemory* remembered(const ContactKey& key) const;
  double depth_to_leave(const Contact& contact, double most) const;
  // Warm start from the contact memory. inertia: of the particle, over the squared step weight [N/m].
  void recall(Contact& contact, double inertia);
  void remember();
  // world/bone_contacts.cpp
  void bone_contacts(int tendon, int shape);
  void both_sides(const SegmentPoint& at, ContactKey key, int first, const Tangent& beside,
                  const std::optional<Plane>& other, const Pose& end);
  void bone_contact(const SegmentPoint& spot, const ContactKey& key, const Tangent& surface);
  bool last_faced(const ContactKey& key, Vec3 one, Vec3 other) const;
  void half_space_contacts(int tendon, int shape);
  double distance_to_keep(const SegmentPoint& spot, const ContactKey& key) const;
  double distance_from(const Shape& shape, const ContactKey& key, int particle) const;
  // world/sleeping.cpp
  bool any_asleep() const;
  bool feels(int tendon, int link, double dt) const;
  void wake_disturbed(double dt);
  bool is_met(int tendon) const;
  bool meets(int still, int moving) const;
  void find_reach();
  bool wake_met();
  void join_step();
  void wake_tendons();
  bool count_rest(double dt);
  void find_restful();
  void fall_asleep();
  void push_asleep();
  // world/tunnel_contacts.cpp
  void find_bores();
  // Whether a tunnel exists, is wider than the tendon, and makes contacts with it.
  bool may_enter(int tendon, int tunnel) const;
  void classify(int tendon);
  void thread(Tendon& c);
  void enter(Tendon& c, int tunnel);
  // Writes to detection_.near_tunnels the tunnels that contain the tendon or that it can reach in the step.
  void find_near_tunnels(int tendon);
  void bore_contacts(int tendon, int tunnel);
  void mouth_contacts(int tendon, int tunnel);
  double mouth_reach(int tendon, int t, int first, int last) const;
  double distance_kept_from_edge(const Tendon& c, int tunnel) const;
  void edge_contacts(const SegmentAtMouth& at, Rim rim);
  void mouth_contact(const SegmentAtMouth& at, const Rim& rim, double u);

  // The bores of a link that are wider than the tendon. The others are solid bone for it.
  const std::vector<Bore>& bores_for(const Tendon& c, int link);
  // What these bores leave of a mesh, in the shape's frame; null of other shapes.
  const Surface* surface_for(const Tendon& c, int shape);
  // Drills the meshes where parts are added: in a step it would take longer than the step.
  void drill_surfaces();
  // What the search for distances of a tendon to a shape depends on.
  NearContext near_context(const Tendon& c, int shape);
  // Features of a tendon on which a shape pressed in the last step, in ascending order.
  void find_pressed(int tendon, int shape);
  // world/tendon_stiffness.cpp
  void find_tendon_stiffness();
  void keep_held();
  Vec3 moved_since_held(const Contact& contact) const;
  bool linearise_tendons(Island& island);
  void make_islands();
  // Calls what(element) for every element that acts in the substep.
  template <class Do>
  void each_acting(Do what) const {
    scene.each_element([&](Element& element) {
      if (!stays(element)) what(element);
    });
  }
  void place_elements();
  void list_elements(IslandElements& elements);
  void limit_motion_of_cartilage();
  bool solution_passes_cartilage();
  template <class Measure>
  void limit_cartilage(Measure measure);
  void foresee_links();
  bool presses_elsewhere(const Contact& contact) const;
  bool foresee_at_solution();
  int island_root(int tendon);
  void join_islands(int a, int b);

  StepState step_;
  Detection detection_;
  ContactSet contacts_;
  SleepState sleep_;
  IslandSet islands_;
  History history_;
};

}  // namespace bt
