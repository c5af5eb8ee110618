// The core's world: tendons, links, shapes and tunnels, and one step of them in named stages.
//
//   begin      starting guess and goals of every tendon
//   near       which distances are needed (asked of the caller, who answers)
//   contacts   rows from planes, bores, mouths and tendon pairs, with what they remember
//   solve      each group of touching tendons by itself
//   finish     new states, memories, and one wrench per touched link
//
// A step that fails, or is given up before finish, is taken back (roll_back): all is as it was.
#pragma once
#include <memory>
#include <stdexcept>
#include <vector>

#include "near.h"
#include "pairs.h"
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
  long rows = 0, groups = 0;
  int substeps = 1;  // parts that the most violent group's step was split into
};

class World {
 public:
  Options options;
  // Slots keep their numbers; a removed one is empty, and the next addition takes it.
  std::vector<std::unique_ptr<Chain>> chains;
  std::vector<Link> links;
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

  void begin(double dt, Vec3 gravity);
  const std::vector<Query>& near();
  void answers(const double* distance, const double* points, const double* u);
  // false: not finite; the step has been rolled back.
  bool solve();
  void finish();
  // Everything as it was before begin; nothing where no step has begun.
  void roll_back();

  // All state as bytes (state.h lists it), and back. restore throws std::runtime_error, and changes
  // nothing, unless the bytes are whole and the world is made of the same parts.
  std::vector<char> save();
  void restore(const char* from, size_t size);

  const Report& report() const { return report_; }
  std::vector<ContactRecord> contacts() const;

 private:
  template <class A>
  void moving_fields(A& a);  // state.h
  template <class A>
  void all_fields(A& a);
  void keep();
  void size_caches();
  template <class Which>
  void forget_memory(Which which);
  void forget_planes();
  void aim_attachments(Chain& c);
  // contacts.cpp
  void collect_rows();
  void bone_rows();
  void half_space_rows(int chain, int shape);
  void tendon_rows();
  void finish_row(Row& row, int chain_slot, int particle);
  void add_row(const Row& row);
  void recall(Row& row);
  void remember();
  // tunnels.cpp
  void find_bores();
  void classify(Chain& c);
  void bore_rows(int chain, int tunnel);
  void mouth_rows(int chain, int tunnel);
  double mouth_reach(int chain, int t, int k) const;
  void mouth_row(int chain, int tunnel, int mouth, int segment, const Bore& bore, Vec3 centre, double radius);

  const std::vector<Bore>& bores_of(int link) const { return bores_by_link_[link]; }
  void make_groups();
  Row plane_row(ContactKind kind, Spot spot, int link, Vec3 point, Vec3 normal, uint64_t key,
                double friction);

  StepContext context_;
  std::vector<Chain*> slots_;
  std::vector<std::vector<NearCache>> caches_;  // [chain][shape]
  std::vector<Query> queries_;
  std::vector<BoxTree> trees_;
  std::vector<SegmentPair> pairs_;
  std::vector<Row> rows_, found_;
  std::vector<ContactMemory> memory_;
  std::vector<uint64_t> touching_;
  std::vector<Bore> bores_;  // by tunnel
  std::vector<std::vector<Bore>> bores_by_link_;
  std::vector<Group> groups_;
  std::vector<int> group_of_;
  Report report_;

  // As it was before the step that has begun.
  struct KeptEntry {
    int chain, shape, feature;
    Entry entry;
  };
  std::vector<char> kept_moving_;
  std::vector<KeptEntry> kept_entries_;
  std::vector<Row> kept_rows_;
};

}  // namespace bt
