// A step in parts, where it would outrun its contacts or does not converge with them.
//
// Contacts are planes at the nearest points at the start of a step, looked for as far around as
// particles are thought to move. The solution tells whether that was right:
//
//   strayed     a particle ends up elsewhere than foreseen: contacts are looked for around there, and
//               where there are more, the solution goes on with them
//   room        what is near something moves relative to it by more than its radius: only that share of
//               the step is taken (share_to_go), and the rest from there
//   unsettled   a group with contacts does not converge: half of it is taken
//
// A part is a step of its own, with contacts of its own. Links go as they were going, and as earlier parts
// have pushed them, from the start of the step on: pybullet moves them by the step's length times the
// velocity that all of it gives them. Their wrenches are the means over the parts, so that impulses stay
// exact. A depth that is there at the start of a part goes by the share that the part has of what is left of
// the step: depth over the length of a short part would be a wild velocity.
#include <algorithm>
#include <cmath>

#include "constants.h"
#include "world.h"

namespace bt {

namespace {

// Where a grip leads its particle by the end of a part: straight to its goal.
void aim_grips(Chain& c, double share) {
  for (Hold& h : c.holds)
    if (h.link < 0) h.aim = share == 1 ? h.goal : (1 - share) * c.x.at(h.particle) + share * h.goal;
}

}  // namespace

bool World::can_split() const { return !whole_ && can_carry(); }

// Share of the part that begins in what is left of the step.
double World::share_left() const { return static_cast<double>(size_) / (kUnits - done_); }

void World::begin_part() {
  const bool smallest = size_ <= kUnits / kMostSubsteps;
  context_.dt = whole_dt_ * size_ / kUnits;
  context_.whole = whole_, context_.part = size_ < kUnits;
  context_.splitting = !can_split() ? Splitting::by_group : smallest ? Splitting::never : Splitting::by_world;
  looks_ = 0, looking_ = false;
  find_turning();
  context_.reach = std::sqrt(time_of_part() * context_.dt);
  for (Link& l : links)
    l.turned.begun = (time_of_part() - context_.dt) * l.spin, l.turned.more = context_.dt * l.spin;
  for (Chain* c : slots_) {
    if (!c) continue;
    aim_attachments(*c);
    aim_grips(*c, share_left());
    begin_step(*c, context_);
    c->foresee();
  }
  find_bores();
}

Outcome World::solve() {
  if (looking_) rows_.swap(before_);
  collect_rows();
  if (rouse_met()) return solve_again();
  if (can_split() && room_ < 1 && size_ > 1) return shrink(room_);
  const bool left = looking_ && stray_;
  if (!looking_ || take_new_rows() || left) {
    if (share_weights()) return solve_again();
    const bool other_unknowns = find_unknowns();
    for (Chain* c : slots_) {
      if (!c) continue;
      if (other_unknowns) aim_attachments(*c);
      if (other_unknowns || c->gathered)
        c->restore_multipliers(c->kept), begin_step(*c, context_);  // solve it afresh
    }
    make_groups();
    context_.goes_on = looking_ && !other_unknowns;
    context_.may_look = can_split() && looks_ < kLooks;
    const bool finite = solve_groups();
    if ((!finite || unsettled_) && context_.splitting == Splitting::by_world) return shrink(0.5);
    if (!finite) return report_.take(attempt_), cancel(), Outcome::failed;
    if (can_split() && looks_ < kLooks && (strayed() || stray_))
      return ++looks_, looking_ = true, Outcome::again;
  }
  if (settle_stops() || find_turning()) return solve_again();
  report_.take(attempt_);
  if (done_ + size_ == kUnits) return Outcome::done;
  next_part();
  return Outcome::again;
}

// Particles that end elsewhere than foreseen are foreseen where they end.
bool World::strayed() {
  bool any = false;
  for (Chain* c : slots_) {
    if (!c || !strays(*c)) continue;
    for (int i = 0; i < c->n(); ++i) {
      const double off = norm(c->next.at(i) - c->foreseen.at(i));
      if (!(off > c->slack[i])) continue;
      any = true;
      c->slack[i] = kSlack * c->radius + 0.5 * off;
      c->most_slack = std::max(c->most_slack, c->slack[i]);
      c->foreseen.set(i, c->next.at(i));
    }
  }
  return any;
}

// rows_ becomes what was there, solved for, and what is there now besides. false: there is nothing new that
// touches.
bool World::take_new_rows() {
  keys_.clear();
  for (const Row& row : before_) keys_.push_back(row.key);
  std::sort(keys_.begin(), keys_.end());
  const size_t known = before_.size();
  bool touches = false;
  for (const Row& row : rows_)
    if (!std::binary_search(keys_.begin(), keys_.end(), row.key))
      before_.push_back(row), touches |= !row.passes;
  if (!touches) before_.resize(known);
  rows_.swap(before_);
  return touches;
}

Outcome World::solve_again() {
  for (Chain* c : slots_)
    if (c) c->restore_multipliers(c->kept);
  begin_part();
  return Outcome::again;
}

void World::keep_start() {
  if (done_ == 0 && backup_.empty()) copy_chains(backup_), backup_memory_ = memory_;
}

Outcome World::shrink(double share) {
  keep_start();
  do size_ /= 2, share *= 2;
  while (share < 1 && size_ > 1);
  return solve_again();
}

// Into copies of earlier steps where there are some: nothing has to be allocated.
void World::copy_chains(std::vector<std::unique_ptr<Chain>>& copies) const {
  copies.resize(chains.size());
  for (size_t c = 0; c < chains.size(); ++c) {
    if (chains[c] && copies[c])
      *copies[c] = *chains[c];
    else
      copies[c] = chains[c] ? std::make_unique<Chain>(*chains[c]) : nullptr;
  }
}

void World::next_part() {
  take_part();
  push_bodies();
  for (Link& l : links) l.advance_to(time_of_part());
  done_ += size_;
  if (done_ % (2 * size_) == 0 && done_ + 2 * size_ <= kUnits)
    size_ *= 2;
  for (Chain* c : slots_)
    if (c) c->keep_multipliers(c->kept);
  settlings_ = 0;
  begin_part();
}

// What the part that was solved does to the links, after those before it.
void World::push_links(double share) {
  for (Link& l : links) l.touching = 0, l.before_force = l.force, l.before_torque = l.torque;
  auto push = [&](Link& link, Vec3 force, Vec3 torque) {
    ++link.touching, link.force += share * force, link.torque += share * torque;
  };
  for (const Row& row : rows_) {
    if (row.link < 0) continue;
    Link& link = links[row.link];
    // On the centreline's point, not on the surface: particles do not spin.
    const Vec3 point = row.a.of(slots_[row.a.chain]->next), force = -row.mean_force;
    push(link, force, link.turned.far ? link.torque_of(force, row.arm) : cross(point - link.centre, force));
  }
  for (const Chain* c : slots_)
    for (size_t i = 0; c && i < c->holds.size(); ++i) {
      const Hold& h = c->holds[i];
      if (h.link < 0) continue;
      Link& link = links[h.link];
      push(link, h.mean_force, link.turned.far ? h.mean_torque : cross(link.arm_of(h.local), h.mean_force));
    }
}

// The part that was solved becomes the state, and the links feel it.
void World::take_part() {
  const double share = static_cast<double>(size_) / kUnits;
  push_links(share);
  for (Chain* c : slots_)
    for (size_t i = 0; c && i < c->holds.size(); ++i) {
      Hold& h = c->holds[i];
      h.kept_force = h.mean_force;
      h.sum_force += share * h.mean_force;
    }
  remember();
  for (Chain* c : slots_)
    if (c) finish_step(*c, context_);
  share_weights();
  ++parts_;
}

void World::finish() {
  take_part();
  report_.substeps = std::max(report_.substeps, parts_);
  sum_forces(1, false);
  for (Mover& m : movers)
    if (m.n() > 0) m.act(whole_dt_);
  for (Chain* c : slots_)
    for (size_t i = 0; c && i < c->holds.size(); ++i) c->holds[i].step_force = c->holds[i].sum_force;
  push_asleep();
  report_.asleep = std::count_if(chains.begin(), chains.end(), [](auto& c) { return c && c->bed >= 0; });
  fall_asleep();
}

void World::cancel() {
  for (size_t c = 0; c < slots_.size(); ++c) {
    if (!slots_[c]) continue;
    if (!backup_.empty()) *slots_[c] = *backup_[c];
    slots_[c]->restore_multipliers(slots_[c]->kept);
    slots_[c]->smooth = slots_[c]->kept_smooth;
    for (Hold& h : slots_[c]->holds) h.mean_force = h.kept_force;
  }
  if (!backup_.empty()) memory_ = backup_memory_;
  backup_.clear();
  rows_.clear();
}

}  // namespace bt
