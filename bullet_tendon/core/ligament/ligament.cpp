#include "ligament/ligament.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace bt {

namespace {

// Length below which a segment is held together [rest lengths], and the least [m]. Larger: points that are
// drawn together stay farther apart. Smaller: stiffer, where they meet, until rounding is felt as force.
constexpr double kMeeting = 1e-4;
constexpr double kLeastMeeting = 1e-7;

// Of a segment, of which `least` is what it is held together below [m].
double counted(double length, double least) {
  return length < least ? 0.5 * (length * length / least + least) : length;
}

std::vector<int> links_of(const std::vector<PathPoint>& path, const std::vector<Wrap>& wraps) {
  std::vector<int> links;
  for (const PathPoint& p : path) links.push_back(p.link);
  for (const Wrap& w : wraps) links.push_back(w.link);
  return links;
}

// The twist of a link that moves the point at the arm along u: its six coefficients.
std::array<double, 6> twist_along(Vec3 arm, Vec3 u) {
  const Vec3 turn = cross(arm, u);
  return {u.x, u.y, u.z, turn.x, turn.y, turn.z};
}

}  // namespace

Ligament::Ligament(const std::vector<PathPoint>& path, const std::vector<Wrap>& wraps,
                   const Material& material, double rest_length)
    : Element(links_of(path, wraps)), path_(path), material_(material), wraps_(wraps) {
  rest = rest_length;
  memory.assign(material.tissue.weights.size(), 0.0);
  for (const PathPoint& p : path) of_point_.push_back(place_of(p.link));
  arms_.resize(path.size());
  wrap_frames_.resize(wraps.size());
  gradient_.resize(touched_.size());
}

int Ligament::place_of(int link) const {
  int place = 0;
  while (touched_[place].link != link) ++place;
  return place;
}

// Calls visit(wrap, from, to, way) for each part of the path between the nodes that node(i) gives, with the
// way around the first wrap that is in its way; way.touches: there is one. near: geodesics of a way nearby,
// by part and wrap.
template <class NodeAt, class FrameAt, class Visit>
void Ligament::each_part(NodeAt node, FrameAt frame, std::vector<Geodesic>& near, Visit visit) const {
  auto from = node(0);
  for (size_t i = 0; i + 1 < path_.size(); ++i) {
    const auto to = node(i + 1);
    Wrapped way;
    size_t w = 0;
    for (; w < wraps_.size(); ++w) {
      way = wrap_around(wraps_[w], frame(w), from.point, to.point, near[i * wraps_.size() + w]);
      if (way.touches) break;
    }
    visit(w, from, to, way);
    from = to;
  }
}

double Ligament::measure(const std::vector<Link>& links, std::vector<Geodesic>& near,
                         std::vector<Vec3>* points) const {
  auto node = [&](size_t i) { return Node{0, {}, to_world(links[path_[i].link].pose, path_[i].local)}; };
  auto frame = [&](size_t w) {
    const Pose& pose = links[wraps_[w].link].pose;
    return Pose{pose.rotation * wraps_[w].local.rotation, to_world(pose, wraps_[w].local.origin)};
  };
  near.assign(wraps_.size() * (path_.size() - 1), {});
  if (points) points->push_back(node(0).point);
  double sum = 0;
  auto straight = [&](Vec3 from, Vec3 to) { return counted(norm(to - from), points ? 0 : least()); };
  each_part(node, frame, near, [&](size_t, const Node& from, const Node& to, const Wrapped& way) {
    const Vec3 p = from.point, q = to.point;
    sum += way.touches ? straight(p, way.first) + way.arc + straight(way.last, q) : straight(p, q);
    if (points && way.touches) points->insert(points->end(), {way.first, way.last});
    if (points) points->push_back(q);
  });
  return sum;
}

double Ligament::length_at(const std::vector<Link>& links, std::vector<Vec3>& points) const {
  std::vector<Geodesic> near;
  return measure(links, near, &points);
}

void Ligament::begin(const std::vector<Link>& links, double h) {
  h_ = h;
  for (TouchedLink& touched : touched_) touched.lever = {};
  auto act = [this](int place, Vec3 arm) {
    Vec3& lever = touched_[place].lever;
    if (dot(arm, arm) > dot(lever, lever)) lever = arm;
  };
  for (size_t i = 0; i < path_.size(); ++i) {
    arms_[i] = links[path_[i].link].arm_of(path_[i].local);
    act(of_point_[i], arms_[i]);
  }
  for (size_t w = 0; w < wraps_.size(); ++w) {
    const Link& link = links[wraps_[w].link];
    wrap_frames_[w] = {link.pose.rotation * wraps_[w].local.rotation, link.arm_of(wraps_[w].local.origin)};
    act(place_of(wraps_[w].link), wrap_frames_[w].origin + Vec3{wraps_[w].radii.x, 0, 0});
  }
  // Only these depend on the length at the start, or search for the way from the one there.
  const bool is_needed = material_.damping != 0 || !memory.empty() ||
                         std::any_of(wraps_.begin(), wraps_.end(),
                                     [](const Wrap& w) { return w.shape == WrapShape::ellipsoid; });
  if (is_needed)
    start_length_ = measure(links, near_, nullptr);
  else
    near_.assign(wraps_.size() * (path_.size() - 1), {});
  if (memory.empty()) return;
  if (!begun) {
    begun = true;
    double force, slope;
    elastic_any(material_.law, start_length_ / rest - 1, force, slope);
    unrelaxed = material_.stiffness * force;
    for (size_t i = 0; i < memory.size(); ++i) memory[i] = material_.tissue.weights[i] * unrelaxed;
  }
  relaxation_.begin(material_.tissue, h);
  recalled_ = relaxation_.recalled(memory.data(), unrelaxed);
}

// Sets the tension and its derivative by the length.
void Ligament::find_tension() {
  if (ruptured) {
    tension_now_ = slope_ = potential_ = stiffest_ = 0;
    return;
  }
  if (tension >= 0) {
    tension_now_ = tension;
    slope_ = 0;
    potential_ = tension * length_now_;
    stiffest_ = 0;
    return;
  }
  const Law& law = material_.law;
  const double strain = length_now_ / rest - 1;
  double force, slope;
  elastic_any(law, strain, force, slope);
  unrelaxed_now_ = material_.stiffness * force;
  const double share = relaxation_.share();
  tension_now_ = share * unrelaxed_now_ + recalled_;
  slope_ = share * material_.stiffness * slope / rest;
  potential_ = share * material_.stiffness * rest * elastic_energy_any(law, strain) + recalled_ * length_now_;
  stiffest_ = slope_;
  if (law.tension_only && tension_now_ < 0) tension_now_ = slope_ = 0;
  if (material_.damping == 0 || h_ == 0) return;
  const double rate = (length_now_ - start_length_) / (h_ * rest);
  const double c = material_.damping * damping_share(law, start_length_ / rest - 1);
  damping(law, rate, force, slope);
  tension_now_ += c * force;
  slope_ += c * slope / (h_ * rest);
  potential_ += c * h_ * rest * dissipation(law, rate);
  stiffest_ = slope_;
  if (law.tension_only && tension_now_ < 0) tension_now_ = slope_ = 0;
}

double Ligament::least() const { return std::max(kMeeting * rest, kLeastMeeting); }

// A part that turns about one of its ends moves the other end across it.
void Ligament::add_across(const Straight& part, Vec3 across, double inverse) {
  Across term{part.first.touched, part.last.touched, twist_along(part.first.arm, -across),
              twist_along(part.last.arm, across), inverse};
  if (term.one > term.other) {
    std::swap(term.one, term.other);
    std::swap(term.by_one, term.by_other);
  }
  across_.push_back(term);
}

void Ligament::add_straight(const Node& first, const Node& last) {
  const Vec3 d = last.point - first.point;
  const double length = norm(d), inverse = 1 / std::max(length, least());
  length_now_ += counted(length, least());
  if (first.touched == last.touched) return;  // a part within a link does not change
  straights_.push_back({first, last, inverse * d});
  const Straight& part = straights_.back();
  for (const auto& [node, side] : {std::pair{&part.first, -1.0}, std::pair{&part.last, 1.0}}) {
    const Twists t = twist_along(node->arm, side * part.direction);
    for (int k = 0; k < 6; ++k) gradient_[node->touched][k] += t[k];
  }
  const bool meets = length < least();
  const Vec3 along = meets ? Vec3{1, 0, 0} : part.direction, across = any_perpendicular(along);
  for (const Vec3 e : {across, cross(along, across)}) add_across(part, e, inverse);
  if (meets) add_across(part, along, inverse);
}

void Ligament::find_length(const std::vector<LinkEnd>& ends) {
  across_.clear();
  straights_.clear();
  bent_.clear();
  for (Twists& g : gradient_) g.fill(0);
  length_now_ = 0;
  auto node = [&](size_t i) {
    const LinkEnd& end = ends[path_[i].link];
    const Vec3 arm = end.rotation * arms_[i];
    return Node{of_point_[i], arm, end.centre + arm};
  };
  auto frame = [&](size_t w) {
    const LinkEnd& end = ends[wraps_[w].link];
    return Pose{end.rotation * wrap_frames_[w].rotation, end.at(wrap_frames_[w].origin)};
  };
  each_part(node, frame, near_, [&](size_t w, const Node& from, const Node& to, const Wrapped& way) {
    if (!way.touches) return add_straight(from, to);
    const int touched = place_of(wraps_[w].link);
    const Vec3 centre = ends[wraps_[w].link].centre;
    length_now_ += way.arc;
    bent_.push_back({w, frame(w), centre, from, to});
    add_straight(from, {touched, way.first - centre, way.first});
    add_straight({touched, way.last - centre, way.last}, to);
  });
}

void Ligament::evaluate(const std::vector<LinkEnd>& ends) {
  find_length(ends);
  find_tension();
  largest_ = std::fabs(tension_now_);
  for (TouchedLink& t : touched_) t.clear();
  for (const Straight& part : straights_) {
    touched_[part.first.touched].add(part.first.arm, tension_now_ * part.direction);
    touched_[part.last.touched].add(part.last.arm, -tension_now_ * part.direction);
  }
}

void Ligament::add_stiffness(std::vector<LinkPair>& pairs, bool definite) const {
  const int n = static_cast<int>(touched_.size());
  for (int i = 0; i < n && slope_ != 0; ++i)
    for (int j = i; j < n; ++j)
      add_outer(pairs[pair(i, j)], slope_, gradient_[i].data(), gradient_[j].data());
  const double pull = definite ? std::max(0.0, tension_now_) : tension_now_;
  for (const Across& a : across_) {
    const double weight = pull * a.inverse;
    if (weight == 0) continue;
    add_outer(pairs[pair(a.one, a.one)], weight, a.by_one.data(), a.by_one.data());
    add_outer(pairs[pair(a.one, a.other)], weight, a.by_one.data(), a.by_other.data());
    add_outer(pairs[pair(a.other, a.other)], weight, a.by_other.data(), a.by_other.data());
  }
}

// The points of a wrap move with its link.
void Ligament::add_curvature(std::vector<LinkPair>& pairs) const {
  const int n = static_cast<int>(touched_.size());
  for (const Bent& part : bent_) {
    const Wrap& wrap = wraps_[part.wrap];
    const WrapCurvature found = curvature_around(wrap, part.frame, part.first.point, part.last.point);
    const int own = place_of(wrap.link);
    std::vector<Twists> a(n), b(n);
    auto relative = [&](const Node& node, Vec3 along, std::vector<Twists>& by) {
      const Twists of_point = twist_along(node.arm, along),
                   of_wrap = twist_along(node.point - part.centre, along);
      for (int k = 0; k < 6; ++k) {
        by[node.touched][k] += of_point[k];
        by[own][k] -= of_wrap[k];
      }
    };
    relative(part.first, found.a, a);
    relative(part.last, found.b, b);
    for (int i = 0; i < n; ++i)
      for (int j = i; j < n; ++j) {
        LinkPair& to = pairs[pair(i, j)];
        add_outer(to, tension_now_ * found.first, a[i].data(), a[j].data());
        add_outer(to, tension_now_ * found.shared, a[i].data(), b[j].data());
        add_outer(to, tension_now_ * found.shared, b[i].data(), a[j].data());
        add_outer(to, tension_now_ * found.last, b[i].data(), b[j].data());
      }
  }
}

void Ligament::accept() {
  force = tension_now_;
  const bool pulled = tension < 0 && !ruptured;  // by its material
  if (!memory.empty() && pulled) {
    relaxation_.advance(memory.data(), unrelaxed_now_ - unrelaxed);
    unrelaxed = unrelaxed_now_;
  }
  ruptured |= material_.tissue.excess(force, length_now_ / rest - 1) > 1;
}

}  // namespace bt
