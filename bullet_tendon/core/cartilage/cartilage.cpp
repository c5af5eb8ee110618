#include "cartilage/cartilage.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "math/simd.h"
#include "math/sym3.h"

namespace bt {

namespace {

// Of the grid's spacing: how far points of B may move before the list of near ones is made anew [-]. More:
// points are listed that are far from contact. Less: more lists.
constexpr double kMargin = 1.0;
constexpr int kLeaf = 8;  // points of the smallest boxes at most [-]

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

}  // namespace

Cartilage::Cartilage(int link_a, std::shared_ptr<const DistanceGrid> grid, int link_b,
                     FoundationSurface triangles, const FoundationSurface& points,
                     const CartilageModel& model)
    : Element({link_a, link_b}),
      link_a_(link_a),
      link_b_(link_b),
      grid_(std::move(grid)),
      triangles_(std::move(triangles)),
      points_(points),
      model_(model) {
  std::vector<Box> boxes;
  for (const Vec3& centre : points.centres) boxes.push_back({centre, centre});
  tree_ = BoxTree(boxes, kLeaf);
  regions.resize(1 + *std::max_element(points.regions.begin(), points.regions.end()));
  for (int i = 0; i < points.size(); ++i) {
    const int given = tree_.order()[i];
    points_.centres[i] = points.centres[given];
    points_.areas[i] = points.areas[given];
    points_.regions[i] = points.regions[given];
  }
  place_[0] = link_a < link_b ? 0 : 1;
  place_[1] = 1 - place_[0];
}

std::vector<double> Cartilage::depths(const std::vector<Link>& links) const {
  const Pose &a = links[link_a_].pose, &b = links[link_b_].pose;
  std::vector<double> out;
  for (const Vec3& centre : triangles_.centres)
    out.push_back(-grid_->estimate(to_local(a, to_world(b, centre))));
  return out;
}

std::vector<std::pair<int, double>> Cartilage::facing(const std::vector<Link>& links,
                                                      const std::vector<Vec3>& normals) const {
  const Frame frame = relative(links[link_a_].pose, links[link_b_].pose);
  std::vector<DistanceGrid::Behind> found;
  grid_->behind(frame.rotation, frame.origin, triangles_.centres, found);
  std::vector<std::pair<int, double>> out;
  for (const DistanceGrid::Behind& at : found)
    out.emplace_back(at.point, dot(frame.rotation * normals[at.point], at.gradient));
  return out;
}

double Cartilage::motion(const std::vector<Link>& links, const Twist& of_a, const Twist& of_b,
                         double enough) const {
  const Link &a = links[link_a_], &b = links[link_b_];
  const double turn = norm(of_b.angular - of_a.angular);
  auto moved = [&](Vec3 at) { return norm(of_b.at(at - b.centre) - of_a.at(at - a.centre)); };
  auto most_of = [&](const Box& box) {
    return moved(to_world(b.pose, box.middle())) + turn * box.half_diagonal();
  };
  const double bound = most_of(tree_.box());
  if (bound <= enough) return bound;
  double most = 0;
  tree_.each(
      [&](const Box& box) {
        const double far = most_of(box);
        const Vec3 at = to_local(a.pose, to_world(b.pose, box.middle()));
        return far <= most || grid_->bound(at, box.half_diagonal() + far) > 0;
      },
      [&](int i) { most = std::max(most, moved(to_world(b.pose, points_.centres[i]))); });
  return most;
}

uint64_t Cartilage::mark() const {
  uint64_t hash = grid_->mark();
  auto add = [&](double v) {
    uint64_t bits;
    std::memcpy(&bits, &v, sizeof bits);
    hash = (hash ^ bits) * 1099511628211ull;
  };
  for (int i = 0; i < points_.size(); ++i)
    for (double v : {points_.centres[i].x, points_.centres[i].y, points_.centres[i].z, points_.areas[i]})
      add(v);
  return hash;
}

void Cartilage::begin(const std::vector<Link>& links, double h) {
  if (model_.damping > 0) is_evaluated_ = false;  // the rates are those of this substep
  h_ = h;
  for (int side : {0, 1}) {
    const Link& link = links[side == 0 ? link_a_ : link_b_];
    start_[side] = {link.pose.rotation, link.pose.origin - link.centre};
    touched_[place_[side]].lever = side == 0
                                       ? to_world(links[link_b_].pose, tree_.box().middle()) - link.centre
                                       : link.arm_of(tree_.box().middle());
  }
  if (model_.damping == 0) return;
  start_depths_.assign(points_.size(), 0.0);
  find_behind(relative(links[link_a_].pose, links[link_b_].pose));
  for (const DistanceGrid::Behind& at : behind_)
    start_depths_[near_.points[at.point]] = std::max(0.0, -at.distance);
}

Cartilage::Frame Cartilage::relative(const Frame& a, const Frame& b) {
  return {transposed(a.rotation) * b.rotation, transposed_times(a.rotation, b.origin - a.origin)};
}

void Cartilage::find_behind(const Frame& b) {
  if (!is_listed(b)) list_near(b);
  grid_->behind(b.rotation, b.origin, near_.centres, behind_);
}

// The motion of a point x of B since the list was made is that of the box's middle c, and D (x - c) with the
// difference D of the rotations.
bool Cartilage::is_listed(const Frame& b) const {
  if (!near_.is_made) return false;
  const Mat3 change = b.rotation - near_.of.rotation;
  const Vec3 shift = change * tree_.box().middle() + (b.origin - near_.of.origin);
  const double turn =
      std::sqrt(dot(change.r0, change.r0) + dot(change.r1, change.r1) + dot(change.r2, change.r2));
  return norm(shift) + turn * tree_.box().half_diagonal() < kMargin * grid_->spacing();
}

void Cartilage::list_near(const Frame& b) {
  const double margin = kMargin * grid_->spacing();
  near_.is_made = true;
  near_.of = b;
  near_.points.clear();
  near_.centres.clear();
  auto is_far = [&](const Box& box) {
    return grid_->bound(to_world(b, box.middle()), box.half_diagonal() + margin) > 0;
  };
  tree_.each(is_far, [&](int i) {
    if (grid_->bound(to_world(b, points_.centres[i]), margin) > 0) return;
    near_.points.push_back(i);
    near_.centres.push_back(points_.centres[i]);
  });
}

Cartilage::Frame Cartilage::end_of(int side, const LinkEnd& end) const {
  return {end.rotation * start_[side].rotation, end.at(start_[side].origin)};
}

void Cartilage::press(const DistanceGrid::Behind& at) {
  const int i = near_.points[at.point];
  const double area = points_.areas[i], depth = -at.distance;
  const FoundationLaw::Value elastic = model_.law.at(depth);
  double pressure = elastic.pressure, slope = elastic.slope, energy = elastic.energy;
  if (model_.damping > 0 && h_ > 0) {
    const double rate = model_.damping / h_, start = start_depths_[i];
    const double factor = 1 + rate * (depth - start);
    if (factor <= 0) return;
    pressure *= factor;
    slope = elastic.slope * factor + rate * elastic.pressure;
    energy += rate * (elastic.moment - start * elastic.energy);
  }
  pressed_.push_back({i, depth, pressure, area * slope, at.place, at.gradient});
  potential_ += area * energy;
  stiffest_ += area * slope;
  largest_ += area * pressure;
}

BT_VECTOR void add_up(const std::vector<Cartilage::Pressed>& pressed, const std::vector<double>& areas,
                      Cartilage::Sums& sums) {
  Eight force{}, by_x{}, by_y{}, by_z{};  // of three numbers each
  Eight rows[6] = {};
  for (const Cartilage::Pressed& p : pressed) {
    const Vec3 n = p.normal, x = p.place;
    const double load = p.pressure * areas[p.point];
    const Eight f{load * n.x, load * n.y, load * n.z};
    force += f;
    by_x += x.x * f;
    by_y += x.y * f;
    by_z += x.z * f;
    const double six[6] = {
        n.x, n.y, n.z, x.y * n.z - x.z * n.y, x.z * n.x - x.x * n.z, x.x * n.y - x.y * n.x};
    const Eight column{six[0], six[1], six[2], six[3], six[4], six[5], 0, 0};
    const Eight weighted = p.weight * column;
    for (int r = 0; r < 6; ++r) rows[r] += six[r] * weighted;
  }
  auto three = [](const Eight& f) BT_WITHIN { return Vec3{f[0], f[1], f[2]}; };
  sums.force = three(force);
  sums.products = {three(by_x), three(by_y), three(by_z)};
  for (int r = 0; r < 6; ++r)
    for (int c = 0; c < 6; ++c) sums.matrix[6 * r + c] = rows[r][c];
}

void Cartilage::evaluate(const std::vector<LinkEnd>& ends) {
  frame_a_ = end_of(0, ends[link_a_]);
  centres_[0] = ends[link_a_].centre;
  centres_[1] = ends[link_b_].centre;
  const Frame b = relative(frame_a_, end_of(1, ends[link_b_]));
  // Iterates that differ in the tendons alone have the same pressures.
  if (!is_evaluated_ || !same(b, evaluated_)) {
    evaluated_ = b;
    is_evaluated_ = true;
    find_pressures();
  }
  give_wrenches();
}

void Cartilage::find_pressures() {
  potential_ = stiffest_ = largest_ = 0;
  pressed_.clear();
  find_behind(evaluated_);
  for (const DistanceGrid::Behind& at : behind_)
    if (at.distance < 0) press(at);
  add_up(pressed_, points_.areas, sums_);
}

void Cartilage::give_wrenches() {
  const Rot3& turn = frame_a_.rotation;
  const Vec3 force = turn * sums_.force, moment = turn * cross_of(sums_.products);
  // Sum of r f^T with r from A's origin, in the world's axes: R (sum x f^T) R^T.
  const Mat3 products = turn * sums_.products * transposed(turn);
  for (int side : {0, 1}) {
    const double sign = side == 0 ? -1 : 1;
    const Vec3 arm = centres_[side] - frame_a_.origin;
    TouchedLink& touched = touched_[place_[side]];
    touched.force = sign * force;
    touched.torque = sign * (moment - cross(arm, force));
    touched.pulls = sign * (products - outer_product(arm, force));
  }
}

void Cartilage::add_stiffness(std::vector<LinkPair>& pairs, bool) const {
  if (pressed_.empty()) return;
  const Shift shifts[2] = {{frame_a_.rotation, centres_[0] - frame_a_.origin},
                           {frame_a_.rotation, centres_[1] - frame_a_.origin}};
  const Shift &first = shifts[place_[0]], &second = shifts[place_[1]];
  transform(first, sums_.matrix, first, 1, pairs[pair(0, 0)]);
  transform(first, sums_.matrix, second, -1, pairs[pair(0, 1)]);
  transform(second, sums_.matrix, second, 1, pairs[pair(1, 1)]);
}

// By the relative twist about the origin of A, in its axes.
std::array<double, 36> Cartilage::curvature_of_distance() const {
  std::array<double, 36> out{};
  for (const Pressed& p : pressed_) {
    const Sym3 weighted = (-p.pressure * points_.areas[p.point]) * grid_->curvature(p.place);
    Vec3 moves[6];
    for (int a = 0; a < 3; ++a) {
      moves[a] = unit_axis(a);
      moves[3 + a] = cross(unit_axis(a), p.place);
    }
    for (int c = 0; c < 6; ++c) {
      const Vec3 column = weighted * moves[c];
      for (int r = 0; r <= c; ++r) out[6 * r + c] += dot(moves[r], column);
    }
  }
  for (int r = 0; r < 6; ++r)
    for (int c = 0; c < r; ++c) out[6 * r + c] = out[6 * c + r];
  return out;
}

void Cartilage::add_curvature(std::vector<LinkPair>& pairs) const {
  if (pressed_.empty()) return;
  std::array<double, 36> own = curvature_of_distance();
  // w . sum (dx x f) with dx = v + w' x x: rows by w, columns by v, w'.
  std::array<double, 36> turned{};
  const Vec3 f = sums_.force;
  const Mat3& xf = sums_.products;
  const Mat3 by_v = times_cross(full(identity(-1)), f), by_w = xf - full(identity(trace(xf)));
  for (int r = 0; r < 3; ++r) {
    const Vec3 v = by_v.row(r), w = by_w.row(r);
    const double row[6] = {v.x, v.y, v.z, w.x, w.y, w.z};
    std::copy(row, row + 6, &turned[6 * (3 + r)]);
  }
  auto flipped = [](const std::array<double, 36>& a) {
    std::array<double, 36> b;
    for (int r = 0; r < 6; ++r)
      for (int c = 0; c < 6; ++c) b[6 * r + c] = a[6 * c + r];
    return b;
  };
  const Shift a{frame_a_.rotation, centres_[0] - frame_a_.origin},
      b{frame_a_.rotation, centres_[1] - frame_a_.origin};
  const int of_a = pair(place_[0], place_[0]), of_b = pair(place_[1], place_[1]), between = pair(0, 1);
  transform(a, own, a, 1, pairs[of_a]);
  transform(a, turned, a, -1, pairs[of_a]);
  transform(a, flipped(turned), a, -1, pairs[of_a]);
  transform(b, own, b, 1, pairs[of_b]);
  if (place_[0] == 0) {
    transform(a, own, b, -1, pairs[between]);
    transform(a, turned, b, 1, pairs[between]);
  } else {
    transform(b, own, a, -1, pairs[between]);
    transform(b, flipped(turned), a, 1, pairs[between]);
  }
}

void Cartilage::accept() {
  std::fill(regions.begin(), regions.end(), PressedRegion{});
  std::vector<double> loads(regions.size());
  for (const Pressed& p : pressed_) {
    const double area = points_.areas[p.point];
    const Vec3 place = frame_a_.rotation * p.place + frame_a_.origin;
    const Vec3 force = (p.pressure * area) * (frame_a_.rotation * p.normal);
    PressedRegion& region = regions[points_.regions[p.point]];
    region.force += force;
    region.torque += cross(place - centres_[1], force);
    region.area += area;
    region.centre += (p.pressure * area) * place;
    region.max_pressure = std::max(region.max_pressure, p.pressure);
    region.max_depth = std::max(region.max_depth, p.depth);
    if (p.depth > model_.law.thickness) flattening.depth = std::max(flattening.depth, p.depth);
    loads[points_.regions[p.point]] += p.pressure * area;
  }
  for (size_t r = 0; r < regions.size(); ++r)
    if (loads[r] > 0) regions[r].centre = (1 / loads[r]) * regions[r].centre;
}

}  // namespace bt
