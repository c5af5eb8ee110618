// Saving and restoring a world, and taking back a step that failed.
#include "state.h"

namespace bt {

std::vector<char> World::save() {
  size_caches();
  empty_caches();
  std::vector<char> out;
  Writer writer(out);
  all_fields(writer);
  writer.finish();
  return out;
}

void World::restore(const char* from, size_t size) {
  size_caches();
  kept_entries_.clear();
  for (bool apply : {false, true}) {
    Reader reader(from, size, apply);
    all_fields(reader);
    reader.finish();
  }
}

void World::keep() {
  kept_before_.swap(kept_moving_);
  kept_entries_.clear();
  begun_ = false;
  Writer writer(kept_moving_);
  moving_fields(writer);
  writer.finish();
  kept_rows_ = rows_;
}

void World::roll_back() {
  if (kept_moving_.empty()) return;
  Reader reader(kept_moving_.data(), kept_moving_.size(), true);
  moving_fields(reader);
  // An entry may have been answered twice in one step: the first of its copies is the old one.
  for (size_t k = kept_entries_.size(); k-- > 0;) {
    const KeptEntry& e = kept_entries_[k];
    caches_[e.chain][e.shape].entries[e.feature] = e.entry;
  }
  rows_.swap(kept_rows_);
  kept_moving_.swap(kept_before_);
  if (begun_) before_links_.swap(kept_links_), before_movers_.swap(kept_movers_);
  begun_ = false;
}

}  // namespace bt
