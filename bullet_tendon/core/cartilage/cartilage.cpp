#include "cartilage/cartilage.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <utility>

namespace bt {

namespace {

// Triangles of a cluster at most [-]. More: triangles far from contact are evaluated. Fewer: more clusters.
constexpr int kCluster = 16;

// The matrix T of 6 x 6 with which a twist about the point s from the origin has the twist T^T about the
// origin, in axes that `turn` takes to the world's: rows of v and of w.
struct Shift {
  Rot3 turn;
  Vec3 arm;
  // The coefficients of (n, m) about the origin for a twist about s, in the world's axes.
  void apply(const double* in, double* out) const {
    const Vec3 n = turn * Vec3{in[0], in[1], in[2]};
    const Vec3 m = turn * Vec3{in[3], in[4], in[5]} - cross(arm, n);
    const double six[6] = {n.x, n.y, n.z, m.x, m.y, m.z};
    std::copy(six, six + 6, out);
  }
};

// T K S^T, with a sign.
void transform(const Shift& t, const std::array<double, 36>& k, const Shift& s, double sign, LinkPair& pair) {
  double half[36], column[6], out[6];
  for (int c = 0; c < 6; ++c) {
    for (int r = 0; r < 6; ++r) column[r] = k[6 * r + c];
    t.apply(column, out);
    for (int r = 0; r < 6; ++r) half[6 * r + c] = out[r];
  }
  for (int r = 0; r < 6; ++r) {
    s.apply(half + 6 * r, out);
    for (int c = 0; c < 6; ++c) pair.stiffness[6 * r + c] += sign * out[c];
  }
}

Rot3 outer_product(Vec3 a, Vec3 b) { return {a.x * b, a.y * b, a.z * b}; }
Rot3 minus(const Rot3& a, const Rot3& b) { return {a.r0 - b.r0, a.r1 - b.r1, a.r2 - b.r2}; }
Rot3 times(double s, const Rot3& a) { return {s * a.r0, s * a.r1, s * a.r2}; }

}  // namespace

Cartilage::Cartilage(int link_a, std::shared_ptr<const DistanceGrid> grid, int link_b,
                     FoundationSurface surface, const CartilageModel& model)
    : Element({link_a, link_b}),
      link_a_(link_a),
      link_b_(link_b),
      grid_(std::move(grid)),
      surface_(std::move(surface)),
      model_(model) {
  region_count_ = 1 + *std::max_element(surface_.regions.begin(), surface_.regions.end());
  regions.resize(region_count_);
  given_.resize(surface_.centres.size());
  std::iota(given_.begin(), given_.end(), 0);
  cluster(0, static_cast<int>(given_.size()));
  const FoundationSurface was = surface_;
  for (size_t i = 0; i < given_.size(); ++i) {
    surface_.centres[i] = was.centres[given_[i]];
    surface_.areas[i] = was.areas[given_[i]];
    surface_.regions[i] = was.regions[given_[i]];
  }
  place_[0] = link_a < link_b ? 0 : 1;
  place_[1] = 1 - place_[0];
}

// Halves the triangles across their longest extent until a cluster is small enough.
void Cartilage::cluster(int first, int count) {
  Box box;
  for (int i = first; i < first + count; ++i) box.include(surface_.centres[given_[i]]);
  if (count <= kCluster) {
    Cluster c{first, count, 0.5 * (box.lo + box.hi), 0};
    for (int i = first; i < first + count; ++i)
      c.radius = std::max(c.radius, norm(surface_.centres[given_[i]] - c.centre));
    clusters_.push_back(c);
    return;
  }
  const Vec3 size = box.hi - box.lo;
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  const int half = count / 2;
  std::nth_element(
      given_.begin() + first, given_.begin() + first + half, given_.begin() + first + count,
      [&](int s, int t) { return dot(surface_.centres[s] - surface_.centres[t], unit_axis(axis)) < 0; });
  cluster(first, half);
  cluster(first + half, count - half);
}

// Calls what(triangle, x) for the triangles that may be behind A; x in its frame.
template <class Do>
void Cartilage::each_near(const Frame& a, const Frame& b, Do what) const {
  const Rot3 turn = transposed(a.rotation) * b.rotation;
  const Vec3 shift = transposed_times(a.rotation, b.origin - a.origin);
  for (const Cluster& c : clusters_) {
    if (grid_->bound(turn * c.centre + shift, c.radius) > 0) continue;
    for (int i = c.first; i < c.first + c.count; ++i) {
      const Vec3 x = turn * surface_.centres[i] + shift;
      if (grid_->may_be_behind(x)) what(i, x);
    }
  }
}

std::vector<double> Cartilage::depths(const std::vector<Link>& links) const {
  const Pose &a = links[link_a_].pose, &b = links[link_b_].pose;
  std::vector<double> out(given_.size());
  for (size_t i = 0; i < given_.size(); ++i)
    out[given_[i]] = -grid_->estimate(to_local(a, to_world(b, surface_.centres[i])));
  return out;
}

std::vector<std::pair<int, double>> Cartilage::facing(const std::vector<Link>& links,
                                                      const std::vector<Vec3>& normals) const {
  const Pose &a = links[link_a_].pose, &b = links[link_b_].pose;
  const Rot3 turn = transposed(a.rotation) * b.rotation;
  std::vector<std::pair<int, double>> out;
  each_near({a.rotation, a.origin}, {b.rotation, b.origin}, [&](int i, Vec3 x) {
    Vec3 gradient;
    grid_->at(x, gradient);
    out.emplace_back(given_[i], dot(turn * normals[given_[i]], gradient));
  });
  return out;
}

double Cartilage::motion(const std::vector<Link>& links, double h) const {
  const Link &a = links[link_a_], &b = links[link_b_];
  double most = 0;
  for (const Cluster& c : clusters_) {
    const Vec3 at = to_world(b.pose, c.centre);
    const double moved = norm(b.drift(at, h) - a.drift(at, h));
    if (moved > most && grid_->bound(to_local(a.pose, at), c.radius + moved) <= 0) most = moved;
  }
  return most;
}

uint64_t Cartilage::mark() const {
  uint64_t hash = grid_->mark();
  auto add = [&](double v) {
    uint64_t bits;
    std::memcpy(&bits, &v, sizeof bits);
    hash = (hash ^ bits) * 1099511628211ull;
  };
  for (size_t i = 0; i < given_.size(); ++i)
    for (double v : {surface_.centres[i].x, surface_.centres[i].y, surface_.centres[i].z, surface_.areas[i]})
      add(v);
  return hash;
}

void Cartilage::begin(const std::vector<Link>& links, double h) {
  h_ = h;
  for (int side : {0, 1}) {
    const Link& link = links[side == 0 ? link_a_ : link_b_];
    start_[side] = {link.pose.rotation, link.pose.origin - link.centre};
    touched_[place_[side]].lever = side == 0
                                       ? to_world(links[link_b_].pose, clusters_[0].centre) - link.centre
                                       : link.arm_of(clusters_[0].centre);
  }
  if (model_.damping == 0) return;
  start_depths_.assign(given_.size(), 0.0);
  const Pose &a = links[link_a_].pose, &b = links[link_b_].pose;
  each_near({a.rotation, a.origin}, {b.rotation, b.origin}, [&](int i, Vec3 x) {
    Vec3 normal;
    start_depths_[i] = std::max(0.0, -grid_->at(x, normal));
  });
}

Cartilage::Frame Cartilage::end_of(int side, const LinkEnd& end) const {
  return {end.rotation * start_[side].rotation, end.at(start_[side].origin)};
}

void Cartilage::press(int i, Vec3 x, double depth, Vec3 n) {
  const double k = model_.foundation, area = surface_.areas[i];
  double factor = 1, slope = k, energy = 0.5 * k * depth * depth;
  if (model_.damping > 0 && h_ > 0) {
    const double rate = model_.damping / h_, start = start_depths_[i];
    factor = 1 + rate * (depth - start);
    if (factor <= 0) return;
    slope = k * (factor + rate * depth);
    energy += k * rate * depth * depth * (depth / 3 - start / 2);
  }
  const double pressure = k * depth * factor;
  pressed_.push_back({i, pressure, x, n});
  potential_ += area * energy;
  stiffest_ += area * slope;
  largest_ += area * pressure;
  const Vec3 m = cross(x, n), f = (pressure * area) * n;
  force_ += f;
  moment_ += (pressure * area) * m;
  products_.r0 += x.x * f;
  products_.r1 += x.y * f;
  products_.r2 += x.z * f;
  const double six[6] = {n.x, n.y, n.z, m.x, m.y, m.z};
  for (int r = 0; r < 6; ++r) {
    const double w = area * slope * six[r];
    for (int c = 0; c < 6; ++c) matrix_[6 * r + c] += w * six[c];
  }
}

void Cartilage::evaluate(const std::vector<LinkEnd>& ends) {
  frame_a_ = end_of(0, ends[link_a_]);
  centres_[0] = ends[link_a_].centre;
  centres_[1] = ends[link_b_].centre;
  potential_ = stiffest_ = largest_ = 0;
  force_ = moment_ = {};
  products_ = {{}, {}, {}};
  matrix_.fill(0);
  pressed_.clear();
  near_.clear();
  places_.clear();
  each_near(frame_a_, end_of(1, ends[link_b_]), [&](int i, Vec3 x) {
    near_.push_back(i);
    places_.push_back(x);
  });
  grid_->at(places_, samples_);
  for (size_t k = 0; k < near_.size(); ++k)
    if (samples_[k].distance < 0) press(near_[k], places_[k], -samples_[k].distance, samples_[k].gradient);
  give_wrenches();
}

void Cartilage::give_wrenches() {
  const Vec3 force = frame_a_.rotation * force_, moment = frame_a_.rotation * moment_;
  // Sum of r f^T with r from A's origin, in the world's axes: R (sum x f^T) R^T.
  const Rot3 products = frame_a_.rotation * products_ * transposed(frame_a_.rotation);
  for (int side : {0, 1}) {
    const double sign = side == 0 ? -1 : 1;
    const Vec3 arm = centres_[side] - frame_a_.origin;
    TouchedLink& touched = touched_[place_[side]];
    touched.force = sign * force;
    touched.torque = sign * (moment - cross(arm, force));
    touched.pulls = times(sign, minus(products, outer_product(arm, force)));
  }
}

void Cartilage::add_stiffness(std::vector<LinkPair>& pairs, bool) const {
  if (pressed_.empty()) return;
  const Shift shifts[2] = {{frame_a_.rotation, centres_[0] - frame_a_.origin},
                           {frame_a_.rotation, centres_[1] - frame_a_.origin}};
  const Shift &first = shifts[place_[0]], &second = shifts[place_[1]];
  transform(first, matrix_, first, 1, pairs[pair(0, 0)]);
  transform(first, matrix_, second, -1, pairs[pair(0, 1)]);
  transform(second, matrix_, second, 1, pairs[pair(1, 1)]);
}

void Cartilage::accept(double) {
  std::fill(regions.begin(), regions.end(), PressedRegion{});
  std::vector<double> loads(regions.size());
  for (const Pressed& p : pressed_) {
    const double area = surface_.areas[p.triangle];
    const Vec3 place = frame_a_.rotation * p.place + frame_a_.origin;
    const Vec3 force = (p.pressure * area) * (frame_a_.rotation * p.normal);
    PressedRegion& region = regions[surface_.regions[p.triangle]];
    region.force += force;
    region.torque += cross(place - centres_[1], force);
    region.area += area;
    region.centre += (p.pressure * area) * place;
    region.max_pressure = std::max(region.max_pressure, p.pressure);
    loads[surface_.regions[p.triangle]] += p.pressure * area;
  }
  for (size_t r = 0; r < regions.size(); ++r)
    if (loads[r] > 0) regions[r].centre = (1 / loads[r]) * regions[r].centre;
}

}  // namespace bt
