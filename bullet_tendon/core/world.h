// The core's world: tendons, links, shapes and tunnels, and one step of them in named stages.
//
//   begin      starting guess and goals of every tendon
//   near       which distances are needed (asked of the caller, who answers)
//   solve      rows from planes, bores, mouths and tendon pairs, with what they remember (contacts.cpp,
//              tunnels.cpp); each group of touching tendons by itself (groups.cpp)
//   finish     new states, memories, and one wrench per touched link
//
// solve may ask for near and solve once more: because contacts have to be looked for elsewhere, or
// because the step is taken in parts (parts.cpp). A step that fails or is cancelled leaves the state as
// it was.
#pragma once
#include <memory>
#include <stdexcept>
#include <vector>

#include "collision/broad_phase.h"
#include "near.h"
#include "stepping.h"

namespace bt {

// What a contact was in the last step, for reading out.
struct ContactRecord {
  int chain = 0, segment = 0, other_chain = -1, link = -1;
  ContactKind kind = ContactKind::bone;
  Vec3 position, normal;  // on the centreline; from the body (or tendon b) to tendon a
  double distance = 0;    // between the surfaces [m]
  double normal_force = 0, friction_force = 0;
};

struct Report {
  int iterations = 0;
  double residual = 0;
  bool converged = true;
  int worst_chain = -1, worst_particle = -1;
  NearCounts near;
  PairCounts pairs;
  long rows = 0, groups = 0, asleep = 0;
  double search_seconds = 0;  // of wall time: which segments of tendons could touch
  int substeps = 1;           // parts that the step was split into, or that of the most violent group
  // Adds a part that was solved.
  void take(const Report& part);
};

enum class Outcome : int { failed = 0, done = 1, again = 2 };

class World {
 public:
  Options options;
  // Slots keep their numbers; a removed one is empty, and the next addition takes it.
  std::vector<std::unique_ptr<Chain>> chains;
  std::vector<Link> links;
  std::vector<Mover> movers;  // of the bodies, each in the slot of one of its links; empty in the others
  std::vector<Shape> shapes;
  std::vector<Tunnel> tunnels;
  std::vector<char> shape_alive, tunnel_alive;

  int add_chain(std::unique_ptr<Chain> chain);
  void remove_chain(int slot);
  int add_shape(const Shape& shape);
  void remove_shape(int slot);
  int add_tunnel(const Tunnel& tunnel);
  void remove_tunnel(int slot);
  // Forgets contacts, planes and memberships, after things were moved from outside.
  void forget_contacts();

  // Looks at what links did since the last step. held: nothing moves them, and nothing is learned.
  void sense(double dt, Vec3 gravity, bool held);
  // Movers that were let go in the last step, which was solved as if they were held.
  std::vector<int> released_movers() const;
  // Free rigid bodies that something unforeseen pulled at in the last step, so that their tendons are
  // stretched by what these have not answered to.
  std::vector<int> pulled_movers() const;
  // What was let go is free from now on, and everything is taken back to before that step, of dt, in which
  // `pulled` go as was seen. false: there is no way back.
  bool rewind(double dt, Vec3 gravity, const std::vector<int>& pulled);
  bool any_held() const;
  // The rates of a mover right after a step; whether it seems to have been let go.
  bool note(int mover, const dense::Numbers& rates);
  // Nothing can hold the mover.
  void let_go(int mover);
  // What bodies rest on is what was told before rewind, though they are told of once more.
  void keep_told_contacts();
  // Their rates were set from outside, to mend the last step, which is not taken back again.
  void refresh_movers();
  // whole: not in parts, whatever happens (for steps whose length means nothing).
  void begin(double dt, Vec3 gravity, bool whole);
  const std::vector<Query>& near();
  void answers(const double* distance, const double* points, const double* u);
  // failed: not finite, state as before begin. again: near, answers and solve once more.
  Outcome solve();
  void finish();
  // Back to the state before begin, at any time before finish.
  void cancel();
  // Keeps all that a step changes, before links are sensed, and puts it back.
  void keep();
  void roll_back();

  // All state as bytes (state.h lists it), and back. restore throws std::runtime_error, and changes
  // nothing, unless the bytes are whole and the world is made of the same parts.
  std::vector<char> save();
  void restore(const char* from, size_t size);

  const Report& report() const { return report_; }
  Vec3 gravity() const { return context_.gravity; }  // of the last step
  std::vector<ContactRecord> contacts() const;
  // The tendon steps again, with all that rest with it: something about it has changed (sleep.cpp).
  void rouse(int chain);
  void rouse_all();

 private:
  template <class A>
  void moving_fields(A& a);  // state.h
  template <class A>
  void all_fields(A& a);
  void size_caches();
  template <class Which>
  void forget_memory(Which which);
  void forget_planes();
  bool any_moved() const;
  double pulled_away(const Chain& c, const Hold& hold) const;
  bool take_back();
  double share_left() const;
  // How a mover is going to move in this step.
  void foresee(int mover);
  void lead_links(int mover);
  // A jump in the motion of a link: two-step methods start again, of all tendons, because those that share
  // forces have to share their means.
  void interrupt();
  void aim_attachments(Chain& c);
  // parts.cpp
  bool can_carry() const;
  bool can_split() const;
  void begin_part();
  int turning_parts() const;
  bool has_struck() const;
  void keep_start();
  Outcome shrink(double share);
  void push_links(double share);
  Outcome solve_again();
  void copy_chains(std::vector<std::unique_ptr<Chain>>& copies) const;
  bool strayed();
  bool take_new_rows();
  void next_part();
  void take_part();
  double time_of_part() const { return whole_dt_ * (done_ + size_) / kUnits; }
  // restarts.cpp
  // What is to press on each other takes steps of the same weight, so that its impulses are equal and
  // opposite. true: some had begun with another.
  bool share_weights();
  // unknowns.cpp
  template <class Do>
  void each_touch(Do what) const;
  bool find_unknowns();
  void find_bodies();
  void narrow_bodies();
  void sum_forces(double scale, bool of_part);
  void push_bodies();
  bool find_turning();
  bool settle_stops();
  std::vector<char> solid_links() const;
  // groups.cpp
  bool solve_groups();
  void read_worst(const Group& group);
  // contacts.cpp
  void collect_rows();
  void bone_rows();
  void half_space_rows(int chain, int shape);
  void tendon_rows();
  void finish_row(Row& row, int chain_slot, int particle);
  void soften(Row& row, const Link& link, Vec3 at) const;
  void add_row(const Row& row);
  double depth_to_leave(const Row& row, double most) const;
  // inertia: of the particle that the row is of, over the step's weight squared [N/m].
  void recall(Row& row, double inertia);
  void remember();
  // sleep.cpp
  bool any_asleep() const;
  bool feels(const Chain& c, int link, double dt) const;
  void rouse_disturbed(double dt);
  bool is_met(const Chain& asleep) const;
  bool rouse_met();
  void join_step();
  bool count_rest(double dt);
  void find_restful();
  void fall_asleep();
  void push_asleep();
  // tunnels.cpp
  void find_bores();
  void classify(Chain& c);
  void bore_rows(int chain, int tunnel);
  void mouth_rows(int chain, int tunnel);
  double mouth_reach(int chain, int t, int k) const;
  void mouth_row(int chain, int tunnel, int mouth, int segment, const Bore& bore, Vec3 centre, double radius);

  const std::vector<Bore>& bores_of(int link) const { return bores_by_link_[link]; }
  void make_groups();
  int group_root(int chain);
  void join_groups(int a, int b);
  Row plane_row(ContactKind kind, Spot spot, int link, Vec3 point, Vec3 normal, uint64_t key,
                double friction);

  StepContext context_;
  double whole_dt_ = 0;        // of the step that begin was asked for [s]
  bool whole_ = false;         // it must not be taken in parts
  int done_ = 0, size_ = 0;    // parts finished, and the one being solved [units of the step]
  int parts_ = 0, looks_ = 0;  // finished; looks for contacts in this one
  double room_ = 1;            // share of the part that can be gone before something unforeseen touches
  bool looking_ = false;       // rows_ are solved for, and are only to be added to
  bool stray_ = false;         // a group was left because its particles end elsewhere than foreseen
  bool unsettled_ = false;     // a group with contacts did not converge
  int settlings_ = 0;          // of this part, because other stops act than foreseen
  std::vector<std::unique_ptr<Chain>> backup_;  // before the first part
  std::vector<ContactMemory> backup_memory_;
  bool way_back_ = false;  // the last step can be taken back: bodies had a part in it
  // As they were told before it.
  std::vector<Link> before_links_;
  std::vector<Mover> before_movers_;
  std::vector<Chain*> slots_;
  std::vector<std::vector<NearCache>> caches_;  // [chain][shape]
  std::vector<Query> queries_;
  BroadPhase broad_phase_;
  std::vector<SegmentPair> pairs_;
  std::vector<int> touches_;  // by mover
  std::vector<Row> rows_, found_, before_;
  std::vector<Row> asleep_rows_;          // of tendons that sleep
  Vec3 rest_gravity_;                     // when the last of them fell asleep
  std::vector<char> restful_, restless_;  // by root of a group
  std::vector<Box> reach_;                // of tendons that do not, by slot
  std::vector<uint64_t> keys_;
  std::vector<ContactMemory> memory_;
  std::vector<uint64_t> touching_;
  std::vector<Bore> bores_;  // by tunnel
  std::vector<std::vector<Bore>> bores_by_link_;
  std::vector<Group> groups_;
  std::vector<int> group_of_;
  Report report_, attempt_;  // of the step, and of the last try at a part of it

  // As it was before the step (keep), and before the last one.
  std::vector<char> kept_moving_, kept_before_;
  std::vector<Link> kept_links_;  // before_links_ and before_movers_, once begun_
  std::vector<Mover> kept_movers_;
  bool begun_ = false;
  std::vector<dense::Numbers> told_contacts_;  // by mover, at rewind
  std::vector<KeptEntry> kept_entries_;
  std::vector<Row> kept_rows_;
};

}  // namespace bt
