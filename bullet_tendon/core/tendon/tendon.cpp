#include "tendon/tendon.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "math/rotation.h"
#include "math/rounding.h"

namespace bt {

namespace {

// Distance by which a particle is moved off a coincident neighbour, as a share of the rest length [-].
constexpr double kSpread = 1e-6;

}  // namespace

Tendon::Tendon(const std::vector<Vec3>& points, double radius_, double friction_, const Material& material_)
    : radius(radius_), friction(friction_), material(material_), n_(static_cast<int>(points.size())) {
  for (Field* f : {&x, &v, &force, &x_before, &v_before, &x_new, &dx, &correction, &residual, &v_new,
                   &displacement, &inertial_displacement, &cg_remainder, &cg_preconditioned, &cg_direction,
                   &cg_image, &column, &solved, &predicted})
    f->resize(n_);
  for (int i = 0; i < n_; ++i) x.set(i, points[i]);
  // A smaller share would be lost in rounding, and its strain at any force would be unbounded.
  if (material.shear_stiffness < kRoundingShare * material.stiffness) material.shear_stiffness = 0;
  mass.assign(n_, 0.0);
  point_mass.assign(n_, 0.0);
  tunnel_of.assign(n_, -1);
  slack.assign(n_, 0.0);
  structure.resize(1, n_);
  bool sheared = material.shear_stiffness > 0 && n_ > 2;
  shear.resize(2, sheared ? n_ : 0);
  const int half = sheared || (material.bending_stiffness > 0 && n_ > 2) ? 2 : 1;
  matrix.resize(n_, half);
  factor.resize(n_, half);
  inverse_blocks.resize(6, n_);
  std::vector<double> lengths(n_ - 1);
  for (int k = 0; k + 1 < n_; ++k) lengths[k] = norm(points[k + 1] - points[k]);
  set_rest(lengths);
  find_overlaid();
  reset_history();
}

double Tendon::shortest_rest() const { return *std::min_element(rest.begin(), rest.end()); }

double Tendon::rest_length() const { return std::accumulate(rest.begin(), rest.end(), 0.0); }

double Tendon::most_motion() const {
  double most = 0;
  for (int i = 0; i < n(); ++i) most = std::max(most, norm(predicted.at(i) - x.at(i)));
  return most;
}

void Tendon::set_rest(const std::vector<double>& lengths) {
  ++rest_set;
  rest = lengths;
  mass = point_mass;
  for (int k = 0; k + 1 < n_; ++k) {
    double half = 0.5 * material.linear_density * rest[k];
    mass[k] += half;
    mass[k + 1] += half;
  }
  share_out();
}

void Tendon::set_point_mass(int particle, double kilograms) {
  point_mass[particle] = kilograms;
  set_rest(std::vector<double>(rest));
}

// Structure spring k and the shear springs k-1 and k, where they exist, cross segment k. The structure spring
// gets the stiffness that the shear springs leave. Therefore every cross-section carries stiffness * s^p at a
// uniform strain s, also at the ends. What crosses a torn segment has none.
void Tendon::share_out() {
  auto shear_at = [&](int k) {
    return k < 0 || k >= shear.count || is_torn(k) || is_torn(k + 1) ? 0.0 : material.shear_stiffness;
  };
  const double share = material.damping / material.stiffness;
  for (int k = 0; k + 1 < n_; ++k)
    structure.stiffness[k] = is_torn(k) ? 0 : material.stiffness - shear_at(k - 1) - shear_at(k);
  for (int k = 0; k < shear.count; ++k) shear.stiffness[k] = shear_at(k);
  for (SpringSet* s : {&structure, &shear}) {
    s->damped = material.damping > 0;
    for (int k = 0; k < s->count; ++k) {
      s->rest[k] = s->reach == 1 ? rest[k] : rest[k] + rest[k + 1];
      s->inverse_rest[k] = 1 / s->rest[k];
      s->damping[k] = share * s->stiffness[k];
      s->lighter[k] = std::min(mass[k], mass[k + s->reach]);
    }
  }
}

void Tendon::begin_tissue(double h) {
  if (!material.tissue.relaxes()) return;
  relaxation.begin(material.tissue, h);
  for (SpringSet* s : {&structure, &shear}) begin_relaxation(*s, relaxation);
}

void Tendon::end_tissue(double h) {
  if (h > 0 && material.tissue.can_rupture()) rupture();
  if (!material.tissue.relaxes()) return;
  relaxation.begin(material.tissue, h);
  for (SpringSet* s : {&structure, &shear})
    end_relaxation(*s, material.law, material.tissue, relaxation, x, false);
}

// Tears the segment that is farthest beyond its largest force or strain. The others are unloaded by that:
// what exceeds its limit after the next substep tears then.
void Tendon::rupture() {
  const Tissue& tissue = material.tissue;
  tension(loads);
  int worst = -1;
  double most = 1;
  for (int k = 0; k + 1 < n_; ++k) {
    const double strain = norm(x.at(k + 1) - x.at(k)) / rest[k] - 1, excess = tissue.excess(loads[k], strain);
    if (!(excess > most) || is_torn(k)) continue;
    most = excess;
    worst = k;
  }
  if (worst < 0) return;
  torn.push_back(worst);
  share_out();
  for (SpringSet* s : {&structure, &shear})
    for (int k = std::max(0, worst + 1 - s->reach); k < std::min(s->count, worst + 1); ++k) {
      s->lambda[k] = s->elastic[k] = s->slope[k] = 0;
      if (!tissue.relaxes()) continue;
      s->unrelaxed[k] = 0;
      std::fill_n(s->memory.begin() + k * tissue.weights.size(), tissue.weights.size(), 0.0);
    }
  smooth = false;
}

bool Tendon::threads(int segment, int tunnel) const {
  return std::any_of(threaded.begin(), threaded.end(),
                     [&](const Threaded& of) { return of.segment == segment && of.tunnel == tunnel; });
}

bool Tendon::threads(int tunnel) const {
  return std::any_of(threaded.begin(), threaded.end(),
                     [&](const Threaded& of) { return of.tunnel == tunnel; });
}

bool Tendon::is_in_bore(int segment, int tunnel) const {
  return tunnel_of[segment] == tunnel || tunnel_of[segment + 1] == tunnel || threads(segment, tunnel);
}

bool Tendon::is_in_bore(int tunnel) const {
  return std::find(tunnel_of.begin(), tunnel_of.end(), tunnel) != tunnel_of.end() || threads(tunnel);
}

void Tendon::leave_bore(int tunnel) {
  std::replace(tunnel_of.begin(), tunnel_of.end(), tunnel, -1);
  const auto of_it = [&](const Threaded& of) { return of.tunnel == tunnel; };
  threaded.erase(std::remove_if(threaded.begin(), threaded.end(), of_it), threaded.end());
}

void Tendon::leave_bores() {
  std::fill(tunnel_of.begin(), tunnel_of.end(), -1);
  threaded.clear();
}

void Tendon::stop() {
  v.zero();
  v_before.zero();
  dt_before = 0;
}

void Tendon::keep_multipliers() {
  start_structure = structure;
  start_shear = shear;
}

void Tendon::restore_multipliers() {
  static_cast<SpringMultipliers&>(structure) = start_structure;
  static_cast<SpringMultipliers&>(shear) = start_shear;
}

void Tendon::move(int i, Vec3 by) {
  displacement.add(i, by);
  x_new.set(i, x.at(i) + displacement.at(i));
}

void Tendon::place(int i, Vec3 at) {
  displacement.set(i, at - x.at(i));
  x_new.set(i, at);
}

void Tendon::place_anchors() {
  for (const Anchor& h : anchors)
    if (h.rigid) place(h.particle, h.target.aim);
}

BT_VECTOR void Tendon::advance(double alpha, double second) {
  for (int k = 0; k < 3; ++k) {
    double *u = displacement[k], *at = x_new[k];
    const double *d = dx[k], *c = correction[k], *start = x[k];
#pragma GCC ivdep
    for (int i = 0; i < n_; ++i) {
      u[i] += alpha * d[i];
      if (second != 0) u[i] += second * c[i];
      at[i] = start[i] + u[i];
    }
  }
}

void Tendon::predict() {
  predicted = x_new;
  most_slack = kSlack * radius;
  std::fill(slack.begin(), slack.end(), most_slack);
}

const Anchor* fixed_anchor(const Tendon& c, int particle) {
  for (const Anchor& h : c.anchors)
    if (h.is_fixed() && h.particle == particle) return &h;
  return nullptr;
}

BT_VECTOR bool leaves_predicted_region(const Tendon& c) {
  int count = 0;
  const double *x = c.x_new[0], *y = c.x_new[1], *z = c.x_new[2], *slack = c.slack.data();
  const double *fx = c.predicted[0], *fy = c.predicted[1], *fz = c.predicted[2];
#pragma GCC ivdep
  for (int i = 0; i < c.n(); ++i) {
    const double dx = x[i] - fx[i], dy = y[i] - fy[i], dz = z[i] - fz[i];
    count += dx * dx + dy * dy + dz * dz > slack[i] * slack[i];
  }
  return count > 0;
}

// The directions are distributed evenly over a sphere, each rotated by the golden angle from the last (Saff
// and Kuijlaars 1997).
void Tendon::spread_coincident() {
  const Field given = x;
  for (int i = 1; i < n_; ++i) {
    if (norm(given.at(i) - given.at(i - 1)) >= kRoundingShare * rest[i - 1]) continue;
    const double height = 1 - (2 * i + 1.0) / (2 * n_ + 1), angle = kGoldenAngle * i;
    const double around = std::sqrt(1 - height * height);
    x.add(i, kSpread * rest[i - 1] * Vec3{around * std::cos(angle), around * std::sin(angle), height});
  }
}

void Tendon::reset_history() {
  dt_before = 0;
  with_body = false;
  if (material.tissue.relaxes()) {
    for (SpringSet* s : {&structure, &shear})
      end_relaxation(*s, material.law, material.tissue, relaxation, x, true);
    begin_tissue(0);
  }
  for (SpringSet* s : {&structure, &shear})
    if (s->count > 0)
      evaluate_at(*s, material.law, x, v, 1.0, 1.0);  // sets the multipliers to the true forces
}

void Tendon::guess_multipliers(Vec3 gravity) {
  double load = 0;
  for (int i = 0; i < n_; ++i) load += norm(mass[i] * gravity + force.at(i));
  for (SpringSet* s : {&structure, &shear})
    for (int k = 0; k < s->count; ++k) {
      const double guess = 0.5 * load * s->stiffness[k] / material.stiffness;
      s->lambda[k] = std::max(s->lambda[k], guess);
      s->elastic[k] = std::max(s->elastic[k], guess);
    }
}

// Evaluates copies of the springs, because the multipliers and slopes of the last step are part of the state.
// Rates are those of the lengths in the last substep. The velocities at its end include its rotation, which
// is the chord of an arc. The copies keep their memory from call to call, for those who ask often.
void Tendon::tension(std::vector<double>& out) const {
  static thread_local SpringSet s;
  static thread_local Field moved;
  static thread_local Relaxation relaxed;  // by no time since the last step
  out.assign(n_ - 1, 0.0);
  moved = x;
  for (int k = 0; k < 3; ++k)
    for (int i = 0; i < n_; ++i) moved[k][i] -= x_before[k][i];
  for (const SpringSet* own : {&structure, &shear}) {
    if (own->count == 0) continue;
    take_springs(s, *own);
    if (material.tissue.relaxes()) {
      relaxed.begin(material.tissue, 0);
      begin_relaxation(s, relaxed);
    }
    if (dt_before > 0) {
      measure(s, x_before);
      s.start = s.history = s.length;
      find_forces(s, material.law, {x_before, moved, x_before, 0, dt_before});
    } else {
      evaluate_at(s, material.law, x, v, 1.0, 1.0);
    }
    for (int k = 0; k < s.count; ++k)
      for (int j = k; j < k + s.reach; ++j) out[j] += s.force[k];
  }
}

double Tendon::energy() const {
  double sum = 0;
  for (const SpringSet* s : {&structure, &shear}) {
    if (s->memory.empty()) {
      sum += stored_energy(*s, material.law, x);
      continue;
    }
    for (int k = 0; k < s->count; ++k)
      sum += maxwell_energy(*s, material.law, material.tissue, k, norm(x.at(k + s->reach) - x.at(k)));
  }
  sum += bending_energy(*this, x);
  const Field& velocities = user_velocities();
  for (int i = 0; i < n_; ++i) sum += 0.5 * mass[i] * dot(velocities.at(i), velocities.at(i));
  return sum;
}

}  // namespace bt
