#include "cartilage/distance_grid.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "math/simd.h"

namespace bt {

namespace {

constexpr int kBrick = 8;                // cells along the side of a brick
constexpr int kBorder = 3;               // cells around the box of the mesh
constexpr double kHalfDiagonal = 0.867;  // half of the diagonal of a cube of side 1, rounded up
// Of a spacing, by which the splines may be below the distance at a crease [-]. Smaller: points there jump
// from no depth to this. Larger: more points are evaluated that are not behind.
constexpr double kOvershoot = 0.15;

// Weights of the four nodes around a point, and their derivatives, at the fraction t of its cell.
struct Weights {
  double w[4], d[4];
};

// Four numbers side by side in a vector.
typedef double Four __attribute__((vector_size(32), aligned(8), may_alias));

BT_WITHIN inline Weights catmull_rom(double t) {
  const double s = t * t, c = s * t;
  return {{0.5 * (-c + 2 * s - t), 0.5 * (3 * c - 5 * s + 2), 0.5 * (-3 * c + 4 * s + t), 0.5 * (c - s)},
          {0.5 * (-3 * s + 4 * t - 1), 0.5 * (9 * s - 10 * t), 0.5 * (-9 * s + 8 * t + 1),
           0.5 * (3 * s - 2 * t)}};
}

// Second derivatives of the weights.
struct Curves {
  double c[4];
};

Curves second_derivatives(double t) { return {{2 - 3 * t, 9 * t - 5, 4 - 9 * t, 3 * t - 1}}; }

}  // namespace

double DistanceGrid::nodes_of(const Box& box, double spacing) {
  const Vec3 cells = (1 / spacing) * (box.hi - box.lo);
  auto along = [](double v) { return v + 2 * kBorder + kBrick; };
  return along(cells.x) * along(cells.y) * along(cells.z);
}

void DistanceGrid::size(const Box& box) {
  inverse_ = 1 / spacing_;
  const Vec3 cells = inverse_ * (box.hi - box.lo);
  const double along[3] = {cells.x, cells.y, cells.z};
  for (int a = 0; a < 3; ++a) {
    b_[a] = static_cast<int>(std::ceil((along[a] + 2 * kBorder) / kBrick));
    n_[a] = kBrick * b_[a] + 3;  // one node before the first cell, two after the last
  }
  origin_ = box.lo - (kBorder + 1) * spacing_ * Vec3{1, 1, 1};
  known_.assign(static_cast<size_t>(b_[0]) * b_[1] * b_[2], 0);
  of_bricks_.assign(known_.size(), 0.0);
  values_.assign(static_cast<size_t>(n_[0]) * n_[1] * n_[2], HUGE_VAL);
}

DistanceGrid::DistanceGrid(const SignedDistance& distance, double spacing, double depth)
    : spacing_(spacing), depth_(depth), slope_(distance.open() ? std::sqrt(2.0) : 1.0) {
  size(distance.box(depth));
  const double half = kHalfDiagonal * kBrick * spacing;
  int triangle = 0;  // nearest to the last brick's centre
  for (int k = 0; k < b_[2]; ++k)
    for (int j = 0; j < b_[1]; ++j)
      for (int i = 0; i < b_[0]; ++i) {
        const Vec3 centre =
            origin_ + spacing * Vec3{kBrick * (i + 0.5) + 1, kBrick * (j + 0.5) + 1, kBrick * (k + 0.5) + 1};
        const double at = of_bricks_[brick(i, j, k)] = distance(centre, triangle);
        // Points behind the surface need the nodes around their cell.
        const bool near = at - slope_ * (half + 4 * spacing) < 0 && at + slope_ * half > -depth;
        if (near) fill(distance, i, j, k, triangle);
      }
  limit_slope();
  find_mark();
}

// Behind an open mesh the distance jumps where the nearest point goes from a face to a border elsewhere, from
// -d to what is beside the mesh. There the surface recedes as it does beyond its border: a node's depth is at
// most the slope times its way to any node, plus the depth there. The way goes from neighbour to neighbour,
// which is not shorter than the straight one, so that depths that already keep the slope stay.
void DistanceGrid::limit_slope() {
  if (slope_ <= 1) return;
  struct Step {
    int i, j, k;
    double most;
  };
  std::vector<Step> steps;  // to the neighbours that a sweep has passed before
  for (int k : {-1, 0})
    for (int j : {-1, 0, 1})
      for (int i : {-1, 0, 1})
        if (k < 0 || j < 0 || (j == 0 && i < 0))
          steps.push_back({i, j, k, slope_ * spacing_ * std::sqrt(i * i + j * j + k * k)});
  auto raise = [&](int i, int j, int k, int sign) {
    double& value = values_[node(i, j, k)];
    if (value >= 0) return false;
    const double before = value;
    for (const Step& step : steps) {
      const int a = i + sign * step.i, b = j + sign * step.j, c = k + sign * step.k;
      if (a < 0 || b < 0 || c < 0 || a >= n_[0] || b >= n_[1] || c >= n_[2]) continue;
      const double there = values_[node(a, b, c)];
      if (there < HUGE_VAL) value = std::max(value, std::min(there, 0.0) - step.most);
    }
    return value != before;
  };
  for (bool is_raised = true; is_raised;) {
    is_raised = false;
    for (int k = 0; k < n_[2]; ++k)
      for (int j = 0; j < n_[1]; ++j)
        for (int i = 0; i < n_[0]; ++i) is_raised |= raise(i, j, k, 1);
    for (int k = n_[2] - 1; k >= 0; --k)
      for (int j = n_[1] - 1; j >= 0; --j)
        for (int i = n_[0] - 1; i >= 0; --i) is_raised |= raise(i, j, k, -1);
  }
}

// FNV-1a over the values, eight bytes at a time.
void DistanceGrid::find_mark() {
  mark_ = 14695981039346656037ull;
  for (double v : values_) {
    uint64_t bits;
    std::memcpy(&bits, &v, sizeof bits);
    mark_ = (mark_ ^ bits) * 1099511628211ull;
  }
}

// triangle: nearest to the centre of the brick. That of a node is often that of the node before it.
void DistanceGrid::fill(const SignedDistance& distance, int i, int j, int k, int triangle) {
  known_[brick(i, j, k)] = 1;
  for (int c = kBrick * k; c < kBrick * (k + 1) + 3; ++c)
    for (int b = kBrick * j; b < kBrick * (j + 1) + 3; ++b)
      for (int a = kBrick * i; a < kBrick * (i + 1) + 3; ++a) {
        double& value = values_[node(a, b, c)];
        if (value == HUGE_VAL)
          value = distance(origin_ + spacing_ * Vec3{double(a), double(b), double(c)}, triangle);
      }
}

std::vector<double> DistanceGrid::numbers() const {
  std::vector<double> out{origin_.x,     origin_.y,     origin_.z,     spacing_,
                          depth_,        slope_,        double(n_[0]), double(n_[1]),
                          double(n_[2]), double(b_[0]), double(b_[1]), double(b_[2])};
  out.insert(out.end(), of_bricks_.begin(), of_bricks_.end());
  out.insert(out.end(), known_.begin(), known_.end());
  for (double v : values_) out.push_back(v == HUGE_VAL ? std::numeric_limits<double>::max() : v);
  return out;
}

DistanceGrid::DistanceGrid(const std::vector<double>& numbers) {
  const double* p = numbers.data();
  origin_ = {p[0], p[1], p[2]};
  spacing_ = p[3];
  depth_ = p[4];
  slope_ = p[5];
  inverse_ = 1 / spacing_;
  for (int a = 0; a < 3; ++a) {
    n_[a] = static_cast<int>(p[6 + a]);
    b_[a] = static_cast<int>(p[9 + a]);
  }
  const size_t bricks = static_cast<size_t>(b_[0]) * b_[1] * b_[2];
  p += 12;
  of_bricks_.assign(p, p + bricks);
  known_.assign(p + bricks, p + 2 * bricks);
  values_.assign(p + 2 * bricks, numbers.data() + numbers.size());
  for (double& v : values_)
    if (v == std::numeric_limits<double>::max()) v = HUGE_VAL;
  find_mark();
}

// Whether the cell of a point, by its coordinates in cells, has all nodes around it.
BT_WITHIN inline bool DistanceGrid::is_within(Vec3 cells) const {
  return cells.x >= 1 && cells.y >= 1 && cells.z >= 1 && cells.x < n_[0] - 2 && cells.y < n_[1] - 2 &&
         cells.z < n_[2] - 2;
}

double DistanceGrid::bound(Vec3 x, double radius) const {
  const Vec3 size = spacing_ * Vec3{double(n_[0] - 1), double(n_[1] - 1), double(n_[2] - 1)};
  const Vec3 off = highest(highest(origin_ - x, x - origin_ - size), Vec3{});
  if (dot(off, off) > radius * radius) return norm(off) - radius;  // outside the grid there is nothing
  const Vec3 cells = inverse_ * (x - origin_);
  auto index = [](double v, int count) {
    return std::clamp(static_cast<int>(std::floor((v - 1) / kBrick)), 0, count - 1);
  };
  const int i = index(cells.x, b_[0]), j = index(cells.y, b_[1]), k = index(cells.z, b_[2]);
  if (known_[brick(i, j, k)] && is_within(cells))
    return nearest(cells) - slope_ * (kHalfDiagonal * spacing_ + radius);
  const Vec3 centre =
      origin_ + spacing_ * Vec3{kBrick * (i + 0.5) + 1, kBrick * (j + 0.5) + 1, kBrick * (k + 0.5) + 1};
  return of_bricks_[brick(i, j, k)] - slope_ * (norm(x - centre) + radius);
}

BT_WITHIN inline bool DistanceGrid::is_near(Vec3 x) const {
  const Vec3 cells = inverse_ * (x - origin_);
  if (!is_within(cells)) return false;
  const int i = static_cast<int>(cells.x), j = static_cast<int>(cells.y), k = static_cast<int>(cells.z);
  if (!known_[brick((i - 1) / kBrick, (j - 1) / kBrick, (k - 1) / kBrick)]) return false;
  // The distance at the nearest node, of which that at the point differs by its way from there at most.
  const int a = static_cast<int>(cells.x + 0.5), b = static_cast<int>(cells.y + 0.5),
            c = static_cast<int>(cells.z + 0.5);
  const double beyond = inverse_ * values_[node(a, b, c)] - kOvershoot;
  const Vec3 off = cells - Vec3{double(a), double(b), double(c)};
  return beyond <= 0 || beyond * beyond <= slope_ * slope_ * dot(off, off);
}

// The value at the nearest node of a point, by its coordinates in cells. It is at most half of the diagonal
// of a cell away.
double DistanceGrid::nearest(Vec3 cells) const {
  return values_[node(static_cast<int>(cells.x + 0.5), static_cast<int>(cells.y + 0.5),
                      static_cast<int>(cells.z + 0.5))];
}

// The four nodes along x that go with a node along y and z are next to each other.
BT_WITHIN inline DistanceGrid::Sample DistanceGrid::interpolate(Vec3 x) const {
  const Vec3 cells = inverse_ * (x - origin_);
  const int i = static_cast<int>(cells.x), j = static_cast<int>(cells.y), k = static_cast<int>(cells.z);
  const Weights u = catmull_rom(cells.x - i), v = catmull_rom(cells.y - j), w = catmull_rom(cells.z - k);
  Four all{}, by_y{}, by_z{};  // sums over y and z: with the weights, with a derivative by y, by z
  const double* plane = &values_[node(i - 1, j - 1, k - 1)];
  const size_t next_row = n_[0], next_plane = static_cast<size_t>(n_[0]) * n_[1];
  for (int c = 0; c < 4; ++c, plane += next_plane) {
    Four row_sum{}, slope_sum{};
    const double* row = plane;
    for (int b = 0; b < 4; ++b, row += next_row) {
      const Four nodes = *reinterpret_cast<const Four*>(row);
      row_sum += v.w[b] * nodes;
      slope_sum += v.d[b] * nodes;
    }
    all += w.w[c] * row_sum;
    by_y += w.w[c] * slope_sum;
    by_z += w.d[c] * row_sum;
  }
  const Four uw = *reinterpret_cast<const Four*>(u.w), ud = *reinterpret_cast<const Four*>(u.d);
  const Four sum = uw * all, x_slope = ud * all, y_slope = uw * by_y, z_slope = uw * by_z;
  auto total = [](const Four& f) BT_WITHIN { return (f[0] + f[1]) + (f[2] + f[3]); };
  return {total(sum), inverse_ * Vec3{total(x_slope), total(y_slope), total(z_slope)}};
}

BT_VECTOR Sym3 DistanceGrid::curvature(Vec3 x) const {
  const Vec3 cells = inverse_ * (x - origin_);
  const int i = static_cast<int>(cells.x), j = static_cast<int>(cells.y), k = static_cast<int>(cells.z);
  const Weights u = catmull_rom(cells.x - i), v = catmull_rom(cells.y - j), w = catmull_rom(cells.z - k);
  const Curves a = second_derivatives(cells.x - i), b = second_derivatives(cells.y - j),
               c = second_derivatives(cells.z - k);
  // Sums over y and z of the nodes along x, by the derivatives along y and z that they are weighted with.
  Four all{}, by_y{}, by_z{}, by_yy{}, by_yz{}, by_zz{};
  for (int n = 0; n < 4; ++n) {
    Four row_sum{}, slope_sum{}, curve_sum{};
    for (int m = 0; m < 4; ++m) {
      const Four nodes = *reinterpret_cast<const Four*>(&values_[node(i - 1, j - 1 + m, k - 1 + n)]);
      row_sum += v.w[m] * nodes;
      slope_sum += v.d[m] * nodes;
      curve_sum += b.c[m] * nodes;
    }
    all += w.w[n] * row_sum;
    by_y += w.w[n] * slope_sum;
    by_z += w.d[n] * row_sum;
    by_yy += w.w[n] * curve_sum;
    by_yz += w.d[n] * slope_sum;
    by_zz += c.c[n] * row_sum;
  }
  auto along_x = [](const double* weights, const Four& f) {
    return (weights[0] * f[0] + weights[1] * f[1]) + (weights[2] * f[2] + weights[3] * f[3]);
  };
  return (inverse_ * inverse_) * Sym3{along_x(a.c, all),   along_x(u.d, by_y),  along_x(u.d, by_z),
                                      along_x(u.w, by_yy), along_x(u.w, by_yz), along_x(u.w, by_zz)};
}

BT_VECTOR void DistanceGrid::behind(const Rot3& turn, Vec3 shift, const std::vector<Vec3>& points,
                                    std::vector<Behind>& out) const {
  out.clear();
  for (size_t i = 0; i < points.size(); ++i) {
    const Vec3 x = turn * points[i] + shift;
    if (!is_near(x)) continue;
    const Sample found = interpolate(x);
    out.push_back({static_cast<int>(i), x, found.distance, found.gradient});
  }
}

double DistanceGrid::estimate(Vec3 x) const {
  return is_near(x) ? interpolate(x).distance : std::max(0.0, bound(x, 0));
}

}  // namespace bt
