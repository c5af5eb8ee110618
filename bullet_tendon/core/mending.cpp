// A step that pulled at bodies as held which had been let go in it is taken back, to be solved again.
#include <algorithm>

#include "world.h"

namespace bt {

namespace {

bool same_build(const Chain& a, const Chain& b) {
  if (a.n() != b.n() || a.rest != b.rest || a.holds.size() != b.holds.size()) return false;
  for (size_t h = 0; h < a.holds.size(); ++h)
    if (a.holds[h].id != b.holds[h].id) return false;
  return true;
}

}  // namespace

void World::let_go(int mover) {
  movers[mover].observer.let_go();
  foresee(mover);
  interrupt();
}

// What the user chose since then stays; where holds were made or lost, there is no way back.
bool World::take_back_chains() {
  if (before_chains_.size() != chains.size()) return false;
  for (size_t c = 0; c < chains.size(); ++c)
    if (chains[c] && !(before_chains_[c] && same_build(*chains[c], *before_chains_[c]))) return false;
  for (size_t c = 0; c < chains.size(); ++c) {
    if (!chains[c]) continue;
    Chain& now = *chains[c];
    Chain& then = *before_chains_[c];
    then.force = now.force;
    for (size_t h = 0; h < now.holds.size(); ++h) {
      const Hold& user = now.holds[h];
      Hold& hold = then.holds[h];
      hold.goal = user.goal, hold.rigid = user.rigid, hold.viscosity = user.viscosity;
      hold.clamped = user.clamped, hold.direction = user.direction;
      if (user.link < 0) hold.stiffness = user.stiffness;
    }
    now = then;
  }
  return true;
}

std::vector<int> World::released_movers() const {
  std::vector<int> released;
  for (size_t i = 0; i < movers.size(); ++i)
    if (movers[i].observer.released()) released.push_back(static_cast<int>(i));
  return released;
}

bool World::rewind(double dt, Vec3 gravity) {
  const std::vector<int> released = released_movers();
  const bool back = !released.empty() && take_back_chains();
  if (back) {
    context_.dt = dt, context_.gravity = gravity;
    memory_ = before_memory_;
    for (size_t i = 0; i < std::min(links.size(), before_links_.size()); ++i) links[i] = before_links_[i];
    for (size_t i = 0; i < std::min(movers.size(), before_movers_.size()); ++i) {
      std::swap(movers[i], before_movers_[i]);
      movers[i].observer = before_movers_[i].observer;
      foresee(static_cast<int>(i));  // by what has been learned since, of all of them
    }
    rows_.clear();
  }
  for (int i : released) let_go(i);
  before_chains_.clear();
  return back;
}

}  // namespace bt
