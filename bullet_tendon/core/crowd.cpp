#include "crowd.h"

#include "search_constants.h"

namespace bt {

void Crowd::find_common(const std::vector<Searched>& tendons) {
  way_ = gone_ = {};
  int count = 0;
  for (size_t c = 0; c < tendons.size(); ++c) {
    if (!tendons[c].chain) continue;
    way_ += tendons[c].travel.way().by, gone_ += tendons[c].travel.gone() - parts_[c].gone;
    ++count;
  }
  if (count > 0) way_ = (1.0 / count) * way_, gone_ = (1.0 / count) * gone_;
}

double Crowd::done(const Searched& tendon, const Part& part) const {
  const Traveller& t = tendon.travel;
  return t.reach() + t.way().off + size_of(t.way().by - way_) + size_of(t.gone() - part.gone - gone_) +
         (t.gone_off() - part.gone_off);
}

bool Crowd::stays_clear(const std::vector<Searched>& tendons) {
  if (parts_.size() != tendons.size()) return false;
  find_common(tendons);
  bool clear = true;
  for (size_t c = 0; c < tendons.size(); ++c)
    if (const Chain* chain = tendons[c].chain)
      clear &= done(tendons[c], parts_[c]) < parts_[c].most && chain->rest_set == parts_[c].rest_set;
  if (clear) return ++looks_, true;
  waits_ = looks_ >= kLooksWorth ? 0 : wait_ = std::min(2 * wait_ + 1, kLongestWait);
  forget();
  return false;
}

void Crowd::share(const std::vector<Searched>& tendons, const std::vector<PairSearch>& searches) {
  if (waits_ > 0) return void(--waits_);
  const size_t count = tendons.size();
  parts_.assign(count, {});
  for (size_t c = 0; c < count; ++c)
    if (const Chain* chain = tendons[c].chain)
      parts_[c] = {tendons[c].travel.gone(), tendons[c].travel.gone_off(), 0, 1e300, chain->rest_set};
  find_common(tendons);
  looks_ = 0;
  for (size_t c = 0; c < count; ++c)
    if (tendons[c].chain) parts_[c].has = done(tendons[c], parts_[c]);
  for (size_t j = 0; j < count; ++j)
    for (size_t i = 0; i <= j; ++i) {
      if (!tendons[i].chain || !tendons[j].chain) continue;
      const double room = searches[slot_of(i, j)].room(tendons[i], tendons[j]);
      const double left = room - parts_[i].has - parts_[j].has;
      for (Part* part : {&parts_[i], &parts_[j]}) part->most = std::min(part->most, part->has + 0.5 * left);
    }
}

}  // namespace bt
