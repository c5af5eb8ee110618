// Module _core.testing: what only tests call.
#include <pybind11/stl.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <random>
#include <tuple>
#include <utility>
#include <vector>

#include "bindings/arrays.h"
#include "bodies/finite_rotation.h"
#include "solver/assembly.h"
#include "solver/body_schur.h"
#include "solver/solver.h"

namespace bt {

namespace {

// (3, 3)
Array full_of(const Sym3& s) {
  Array out({3, 3});
  const Mat3 block = full(s);
  std::memcpy(out.mutable_data(), &block, sizeof block);
  return out;
}

// A band as a full matrix, the coordinates of a particle together.
Array dense_of(const Band& a) {
  const int m = 3 * a.n;
  Array full({m, m});
  Field unit(a.n), image(a.n);
  for (int j = 0; j < m; ++j) {
    unit.zero();
    unit[j % 3][j / 3] = 1;
    a.multiply(unit, image);
    for (int i = 0; i < m; ++i) full.mutable_at(i, j) = image[i % 3][i / 3];
  }
  return full;
}

// A term of the potential: energy [J] (elastic: damping has none), gradient (n, 3) [N], and Hessian
// (3 n, 3 n) [N/m]. Structure or shear springs at x, and at `before` one step of weight b [s] earlier, with
// the plain Newton linearisation.
py::tuple spring_term(const World& w, int slot, bool shear, const Field& x, const Field& before, double b) {
  const Tendon& c = *w.scene.tendons[slot];
  SpringSet s = shear ? c.shear : c.structure;
  measure(s, before);
  s.start = s.history = s.length;
  Field displacement(c.n()), gradient(c.n());
  for (int i = 0; i < c.n(); ++i) displacement.set(i, x.at(i) - before.at(i));
  const Motion motion{before, displacement, before, 0, b};
  evaluate(s, c.material.law, motion);
  scatter_forces(s, gradient);
  const double energy = stored_energy(s, c.material.law);
  linearise(s, c.material.law, Linearisation::position, 0, motion, 0);
  Band matrix;
  matrix.resize(c.n(), c.matrix.half);
  scatter_blocks(s, matrix);
  return py::make_tuple(energy, gradient, dense_of(matrix));
}

// The same of bending and clamps at x.
py::tuple bending_term(const World& w, int slot, const Field& x) {
  Tendon c(*w.scene.tendons[slot]);
  c.residual.zero();
  c.matrix.zero();
  add_bending_forces(c, x);
  add_bending_blocks(c);
  return py::make_tuple(bending_energy(c, x), c.residual, dense_of(c.matrix));
}

// An element where each of the links that it touches is displaced by a shift [m] and turned by a rotation
// vector [rad] about its centre, at the end of a substep of h [s]: its potential [J], the gradient by the
// twists of the links (6 k), and the Hessian (ElementTerms). moves (k, 6): shift and rotation of each link.
py::tuple element_term(World& w, Element& element, const Array& moves, double h) {
  std::vector<LinkEnd> ends(w.scene.links.size());
  std::vector<int> slots;
  for (const TouchedLink& touched : element.touched()) {
    const double* of = moves.data() + 6 * slots.size();
    const Vec3 turn = vec(of + 3);
    ends[touched.link] = {w.scene.links[touched.link].centre + vec(of), rotation_by(turn)};
    slots.push_back(touched.link);
  }
  PairList pairs;
  pairs.include(element);
  element.begin(w.scene.links, h);
  element.evaluate(ends);
  element.add_stiffness(pairs.all, false);
  element.add_curvature(pairs.all);
  w.scene.pair_elements();
  ElementTerms terms(w.scene.links.size(), slots);
  terms.add(element);
  terms.add(pairs.all);
  Array gradient(terms.wrenches.size());
  std::transform(terms.wrenches.data(), terms.wrenches.data() + terms.wrenches.size(),
                 gradient.mutable_data(), std::negate<>());
  return py::make_tuple(element.potential(), gradient, terms.stiffness);
}

// A grip with a force limit, for the force R without the limit: the force, that of its linearisation, and the
// block for the stiffness k of R [N/m].
py::tuple grip_term(Vec3 raw, double most_force, bool slips, double k) {
  Anchor h;
  h.raw = raw;
  h.most_force = most_force;
  h.slips = slips;
  return py::make_tuple(h.limited(h.raw), h.linearised(), full_of(h.block(identity(k))));
}

// A contact without friction.
Contact contact_of(ContactKind kind, double offset, double stiffness, double lambda) {
  Contact contact;
  contact.key.kind = kind;
  contact.geometry.offset = offset;
  contact.normal_force.stiffness = stiffness;
  contact.normal_force.lambda = lambda;
  return contact;
}

// A contact, evaluated at a relative position [m]: gap, normal, force, block, and whether it slides.
py::tuple contact_term(int kind, Vec3 relative, Vec3 normal, double offset, Vec3 centre, Vec3 axis,
                       double radius, Vec3 slope, double stiffness, double lambda, double tangent_stiffness,
                       double limit, Vec3 tangent_anchor, bool definite) {
  Contact contact = contact_of(static_cast<ContactKind>(kind), offset, stiffness, lambda);
  contact.geometry.rim = rim_of(centre, axis, radius, slope);
  contact.geometry.normal = normal;
  contact.friction.coefficient = limit > 0 ? 1 : 0;
  contact.friction.limit = limit;
  contact.friction.stiffness = tangent_stiffness;
  contact.friction.anchor = tangent_anchor;
  contact.evaluate(relative, true);
  contact.linearise(definite);
  return py::make_tuple(contact.geometry.gap, contact.geometry.normal, contact.force.total,
                        full_of(contact.force.block), contact.friction.sliding);
}

// Distance [m] of a point from the half of an elliptic edge that is ended for a line at a distance [m].
double distance_from_half(Vec3 x, Vec3 centre, Vec3 axis, double radius, Vec3 slope, int half,
                          double distance, Vec3 along) {
  Rim rim = rim_of(centre, axis, radius, slope);
  rim.half = half;
  end_halves(rim, distance, along);
  return norm(x - nearest_on_rim(rim, x).point);
}

// Parameter of the point of a bent segment a-b that is nearest to half of an edge, searched from u [-].
double slid_to_rim(double u, Vec3 a, Vec3 b, const std::array<Vec3, 2>& bend, Vec3 centre, Vec3 axis,
                   double radius, Vec3 slope, int half) {
  Rim rim = rim_of(centre, axis, radius, slope);
  rim.half = half;
  RimPoint at;
  return slide_to_rim({a, b - a, {bend[0], bend[1]}}, u, rim, at);
}

// The matrix of a contact on its particles.
Array full_block(const Contact& contact) {
  ContactMatrix k;
  find_matrix(contact, nullptr, nullptr, false, k);
  const int particles = contact.b.tendon >= 0 ? 4 : 2;
  Array full({3 * particles, 3 * particles});
  for (int i = 0; i < 3 * particles; ++i)
    for (int j = 0; j < 3 * particles; ++j) {
      const bool above = i / 3 <= j / 3;
      const Mat3 block = above ? k.at(i / 3, j / 3) : transposed(k.at(j / 3, i / 3));
      full.mutable_at(i, j) = block.entry(i % 3, j % 3);
    }
  return full;
}

// A segment against the edge of a mouth, or a round bone, at the nearest point of the segment: gap, forces on
// its ends, and the full block. threads: it passed through the mouth at the start of the step. bend: of the
// segment at its start and its end (geometry/bent_segment.h) [m].
py::tuple edge_term(int kind, Vec3 a, Vec3 b, double offset, Vec3 centre, Vec3 axis, double radius,
                    Vec3 slope, double stiffness, double lambda, bool threads,
                    const std::array<Vec3, 2>& bend) {
  Contact contact = contact_of(static_cast<ContactKind>(kind), offset, stiffness, lambda);
  contact.geometry.rim = rim_of(centre, axis, radius, slope);
  contact.geometry.threads_mouth = threads;
  std::copy_n(bend.begin(), 2, contact.geometry.bend);
  contact.a = {0, 0, 0.5, 0.5};
  for (int i = 0; i < 50; ++i) contact.follow(a, b);
  const double P[2] = {contact.a.w0, contact.a.w1};
  contact.evaluate(P[0] * a + P[1] * b, true);
  contact.linearise(false);
  contact.add_sliding_term(a, b, false);
  return py::make_tuple(contact.geometry.gap, P[0] * contact.force.total, P[1] * contact.force.total,
                        full_block(contact));
}

// Two segments (4, 3) that touch, at their nearest points: gap, forces on the four ends, and the full block.
// before: their ends at the start of the step (4, 3).
py::tuple pair_term(const Field& ends, double offset, double stiffness, double lambda, const Field& before) {
  Contact contact = contact_of(ContactKind::tendon, offset, stiffness, lambda);
  contact.a = {0, 0, 0.5, 0.5};
  contact.b = {1, 0, 0.5, 0.5};
  const Vec3 x[4] = {ends.at(0), ends.at(1), ends.at(2), ends.at(3)};
  const Vec3 along = before.at(1) - before.at(0), other = before.at(3) - before.at(2);
  const auto [u, w] = nearest_parameters(before.at(0), before.at(1), before.at(2), before.at(3));
  contact.friction.anchored_at = u;
  contact.friction.anchored_at_other = w;
  contact.friction.relative_start = before.at(0) + u * along - (before.at(2) + w * other);
  contact.geometry.normal = unit_or(contact.friction.relative_start, {0, 0, 1});
  contact.begin_pair(along, other);
  contact.follow_pair(x);
  const double P[4] = {contact.a.w0, contact.a.w1, -contact.b.w0, -contact.b.w1};
  contact.evaluate(P[0] * x[0] + P[1] * x[1] + P[2] * x[2] + P[3] * x[3], true);
  contact.linearise(false);
  contact.add_pair_sliding_terms(x, false);
  Field force(4);
  for (int i = 0; i < 4; ++i) force.set(i, P[i] * contact.force.total);
  return py::make_tuple(contact.geometry.gap, force, full_block(contact));
}

// Parameters (k, 2) of the ends of the stretch along which two segments (4, 3) touch
// (geometry/segment_distance.h).
std::vector<std::array<double, 2>> touching_parameters(const Field& x, double sag) {
  PairParameters found[2];
  const double distance = segment_distance(x.at(0), x.at(1), x.at(2), x.at(3));
  const int count = touching_stretch(x.at(0), x.at(1), x.at(2), x.at(3), distance, sag, found);
  std::vector<std::array<double, 2>> out;
  for (int k = 0; k < count; ++k) out.push_back({found[k].u, found[k].w});
  return out;
}

// Triangles (t, 3, 3) listed for a segment (2, 3), and what is nearest of them to that segment after it has
// moved: how far the list is whole, how many it has, and distance, point and u.
py::tuple listed_nearest(const std::vector<Triangle>& triangles, const Field& from, double reach,
                         const Field& to) {
  const Surface surface(triangles);
  std::vector<Nearby> listed;
  const double whole = surface.list(from.at(0), from.at(1), reach, listed);
  const Nearest found = surface.nearest(listed, to.at(0), to.at(1));
  return py::make_tuple(whole, listed.size(), found.distance, found.point, found.u);
}

// What is nearest of triangles (t, 3, 3) to segments (k, 6), no farther than `within` (k): rows of distance,
// point, u, and whether the way between the ends leads through a triangle.
std::vector<std::array<double, 6>> searched_nearest(const std::vector<Triangle>& triangles,
                                                    const std::vector<Vec3>& ends,
                                                    const std::vector<double>& within) {
  const Surface surface(triangles);
  std::vector<std::array<double, 6>> out;
  for (size_t k = 0; k < within.size(); ++k) {
    const Vec3 a = ends[2 * k], b = ends[2 * k + 1];
    const Nearest found = surface.search(a, b, within[k]);
    const double through = surface.is_between(a, b);
    out.push_back({found.distance, found.point.x, found.point.y, found.point.z, found.u, through});
  }
  return out;
}

// The rotation that a body has turned by, about the axis first unless it is zero, the torque of forces at
// arms (both (m, 3)) on theta, the stiffness that it reports, and what pybullet's rotation vector changes by
// more.
py::tuple finite_rotation_term(Vec3 axis, Vec3 begun, Vec3 by, const Field& arms, const Field& forces) {
  FiniteRotation turned;
  turned.begin(axis, begun, {});
  turned.turn_by(by);
  turned.pulls = {};
  Vec3 torque;
  for (int i = 0; i < arms.size(); ++i) {
    const Vec3 arm = turned.rotation * arms.at(i), f = forces.at(i), about_centre = cross(arm, f);
    turned.add_pull(arm, f, about_centre);
    torque += transposed_times(turned.rate, about_centre);
  }
  return py::make_tuple(turned.rotation, torque, full_of(turned.stiffness()), turned.beyond_theta());
}

// Newton's linear model of an island, for tests: a random force g on particles and bodies is solved for by
// the matrix at the solution. The iterate moves along the result, and the residual has to change by -g.
class ModelCheck {
 public:
  explicit ModelCheck(Island& island) : island_(island) {}

  // The largest error of the change, relative to the largest g, where particles move by at most `move` [m] to
  // both sides. Negative: the matrix is indefinite.
  double error(const StepContext& context, double move) {
    island_.curved = false;
    evaluate();
    assemble(island_, Linearisation::multiplier, false, false);
    if (!solve_linear(island_, context, false)) return -1;
    draw_forces();
    const std::vector<double> forces = residuals();
    solve_again(island_, context.options, &Tendon::residual, &Tendon::dx);
    combine(island_, -1, &Tendon::dx, 0, &Tendon::dx);
    move_bodies(island_, -1, &Tendon::dx);
    double most = 0;
    for (const Tendon* c : island_.tendons) most = std::max(most, c->dx.largest());
    const double by = move / most;
    const std::vector<double> ahead = residuals_at(0, by), behind = residuals_at(by, -by);
    residuals_at(-by, 0);
    double error = 0, largest = 0;
    for (size_t k = 0; k < forces.size(); ++k) {
      error = std::max(error, std::fabs((ahead[k] - behind[k]) / (2 * by) + forces[k]));
      largest = std::max(largest, std::fabs(forces[k]));
    }
    return error / largest;
  }

 private:
  void evaluate() {
    Assembly a = residual_of(island_, false);
    measure_residual(island_, a);
  }

  void draw_forces() {
    auto draw = [this] { return std::uniform_real_distribution<double>(-1, 1)(random_); };
    for (Tendon* c : island_.tendons)
      for (int i = 0; i < c->n(); ++i) c->residual.set(i, {draw(), draw(), draw()});
    project_anchors(island_, &Tendon::residual);
    for (int m : island_.bodies.indices) {
      BodyUnknowns& of = island_.bodies.body(m).unknowns;
      for (double& r : of.residual) r = of.lever * draw();
    }
  }

  // Of all particles and bodies [N].
  std::vector<double> residuals() const {
    std::vector<double> all;
    for (const Tendon* c : island_.tendons)
      for (int i = 0; i < c->n(); ++i)
        for (const double r : {c->residual[0][i], c->residual[1][i], c->residual[2][i]}) all.push_back(r);
    for (int m : island_.bodies.indices) {
      const BodyUnknowns& of = island_.bodies.body(m).unknowns;
      for (const double r : of.residual) all.push_back(r / of.lever);
    }
    return all;
  }

  std::vector<double> residuals_at(double from, double to) {
    advance_along_arc(island_, from, to);
    evaluate();
    return residuals();
  }

  Island& island_;
  std::mt19937 random_{1};
};

// The search for tendons that touch, by itself, for tests.

struct Probe {
  std::vector<Tendon> tendons;
  BroadPhase search;

  void add(const std::vector<Vec3>& points, double radius) {
    Material material;
    material.law = {1, 1e300, false, 1, false};
    material.stiffness = 1;
    material.linear_density = 1;
    tendons.emplace_back(points, radius, 0.0, material);
    search.clear();
  }

  // Tendons at x that are predicted to be at `ahead`: rows of tendon, segment, tendon, segment, u, w and
  // distance; and how many lists were collected and served again. swept: where tendons approach
  // (narrow_phase.h).
  py::tuple find(const std::vector<Field>& x, const std::vector<Field>& ahead, bool swept) {
    std::vector<Tendon*> slots;
    for (size_t c = 0; c < tendons.size(); ++c) {
      tendons[c].x = x[c];
      tendons[c].x_new = ahead[c];
      tendons[c].predict();
      slots.push_back(&tendons[c]);
    }
    std::vector<SegmentPair> found;
    const Foresight foresight = swept ? Foresight::swept : Foresight::near;
    const PairCounts counts = search.find(slots, CollisionFilter{}, 0, foresight, found);
    std::vector<std::array<double, 7>> rows;
    for (const SegmentPair& s : found)
      rows.push_back({double(s.tendon_a), double(s.segment_a), double(s.tendon_b), double(s.segment_b),
                      s.nearest.u, s.nearest.w, s.nearest.distance});
    return py::make_tuple(rows, counts.searches, counts.skipped);
  }
};

// The sparse and the banded solver by themselves, for tests.

using Edges = std::vector<std::array<int, 2>>;
using Blocks = std::vector<Mat3>;

// Analyses the pattern and adds the blocks: of the diagonal, and beside it at the edges.
void fill_factor(SparseFactor& factor, const Edges& pairs, const Blocks& diagonal, const Blocks& beside) {
  SparseFactor::Edges edges;
  for (const auto& [i, j] : pairs) edges.push_back({i, j});
  factor.analyse(static_cast<int>(diagonal.size()), edges);
  factor.start();
  for (int i = 0; i < factor.blocks(); ++i) factor.add(i, i, diagonal[i]);
  for (size_t k = 0; k < edges.size(); ++k) factor.add(edges[k].first, edges[k].second, beside[k]);
}

// One factor for several systems, one after the other: (edges (m, 2), diagonal (n, 3, 3), beside (m, 3, 3),
// right (n, 3)) each. Solutions (n, 3), or None where a matrix is not definite and not `through`, with the
// number of blocks below the diagonal of the factor.
py::list sparse_solutions(const py::list& systems, bool through) {
  SparseFactor factor;
  py::list out;
  for (const py::handle& system : systems) {
    auto [edges, diagonal, beside, b] = system.cast<std::tuple<Edges, Blocks, Blocks, std::vector<Vec3>>>();
    fill_factor(factor, edges, diagonal, beside);
    const bool solved = factor.factorise(through) || through;
    if (solved) factor.solve(b);
    out.append(py::make_tuple(solved ? py::cast(b) : py::none(), factor.below()));
  }
  return out;
}

// Eight right-hand sides, or their solutions: (n, 3, 8) in Python, which gets (n, 24).
using EightSides = std::vector<std::array<double, 3 * kLanes>>;

Columns columns_of(const EightSides& right) {
  Columns b;
  b.resize(static_cast<int>(right.size()));
  std::memcpy(b.number(0), right.data(), right.size() * sizeof(right[0]));
  return b;
}

// Of the blocks first to last.
EightSides solutions_of(Columns& x, int first, int last) {
  EightSides out(last + 1 - first);
  std::memcpy(static_cast<void*>(out.data()), x.number(first), out.size() * sizeof(out[0]));
  return out;
}

// Solutions of a system as in sparse_solutions for eight right-hand sides at once.
EightSides sparse_columns(const Edges& edges, const Blocks& diagonal, const Blocks& beside,
                          const EightSides& right) {
  SparseFactor factor;
  fill_factor(factor, edges, diagonal, beside);
  if (!factor.factorise()) throw py::value_error("not definite");
  Columns b = columns_of(right);
  factor.solve(b);
  return solutions_of(b, 0, factor.blocks() - 1);
}

// A band of blocks: its diagonal (n, 3, 3), and below it (reach, n, 3, 3), of which the last ones are not
// there.
Band band_of(const Blocks& diagonal, const std::vector<Blocks>& below) {
  Band a;
  a.resize(static_cast<int>(diagonal.size()), static_cast<int>(below.size()));
  for (int i = 0; i < a.n; ++i) {
    a.add(i, upper(diagonal[i]));
    for (int o = 0; o < a.half; ++o) set(a.below[o], i, below[o][i]);
  }
  return a;
}

// Solutions of the blocks first to last for eight right-hand sides, which are zero elsewhere; and that of the
// first of them, solved for by itself (n, 3).
py::tuple band_solutions(const Blocks& diagonal, const std::vector<Blocks>& below, const EightSides& right,
                         int first, int last) {
  const Band a = band_of(diagonal, below);
  BandFactor factor;
  factor.resize(a.n, a.half);
  if (!factor.factorise(a)) throw py::value_error("not definite");
  const Columns b = columns_of(right);
  Columns x;
  x.resize(a.n);
  factor.solve(b, first, last, x);
  Field one(a.n);
  for (int i = 0; i < a.n; ++i) one.set(i, {b.at(i)[0][0], b.at(i)[1][0], b.at(i)[2][0]});
  factor.solve(one, one);
  return py::make_tuple(solutions_of(x, first, last), one);
}

// The direction of negative curvature by right (n, 3): (n, 3), of the band and of a system as in
// sparse_solutions.
Field band_negative(const Blocks& diagonal, const std::vector<Blocks>& below, Field right) {
  const Band a = band_of(diagonal, below);
  BandFactor factor;
  factor.resize(a.n, a.half);
  factor.factorise(a);
  factor.solve_negative(right, right);
  return right;
}

std::vector<Vec3> sparse_negative(const Edges& edges, const Blocks& diagonal, const Blocks& beside,
                                  std::vector<Vec3> right) {
  SparseFactor factor;
  fill_factor(factor, edges, diagonal, beside);
  factor.factorise(true);
  factor.solve_negative(right);
  return right;
}

}  // namespace

void bind_testing(py::module_& testing) {
  testing.def("watch_substeps", [](World& w, py::object callback) {
    w.after_substep = [callback = std::move(callback)] {
      py::gil_scoped_acquire lock;
      callback();
    };
  });
  // Calls `found` with the error of the linear model of each island after its solution.
  testing.def("watch_models", [](World& w, double move, py::object found) {
    w.after_solution = [=](Island& island, const StepContext& context) {
      const double error = ModelCheck(island).error(context, move);
      py::gil_scoped_acquire lock;
      found(error);
    };
  });
  testing.def("grip_term", &grip_term);
  testing.def("contact_term", &contact_term);
  testing.def("edge_term", &edge_term);
  testing.def("distance_from_half", &distance_from_half);
  testing.def("slid_to_rim", &slid_to_rim);
  testing.def("pair_term", &pair_term);
  testing.def("touching_parameters", &touching_parameters);
  testing.def("listed_nearest", &listed_nearest);
  testing.def("searched_nearest", &searched_nearest);
  testing.def("spring_term", &spring_term);
  testing.def("ligament_term", [](World& w, int slot, const Array& moves, double h) {
    return element_term(w, *w.scene.ligaments.at(slot), moves, h);
  });
  testing.def("evaluate_cartilage", [](World& w, int slot, int times) {
    Cartilage& cartilage = *w.scene.cartilages.at(slot);
    std::vector<LinkEnd> ends;
    for (const Link& link : w.scene.links) ends.push_back({link.centre, {}});
    cartilage.begin(w.scene.links, 1);
    const int moved = cartilage.link_b();
    for (int k = 0; k < times; ++k) {
      ends[moved].centre.x += 1e-15;  // else the last pressures would be taken
      cartilage.evaluate(ends);
    }
  });
  testing.def("cartilage_term", [](World& w, int slot, const Array& moves, double h) {
    return element_term(w, *w.scene.cartilages.at(slot), moves, h);
  });
  testing.def("finite_rotation_term", &finite_rotation_term);
  testing.def("bending_term", &bending_term);
  py::class_<Probe>(testing, "BroadPhase")
      .def(py::init<>())
      .def("add", &Probe::add)
      .def("find", &Probe::find)
      .def("set_rest", [](Probe& p, int c, const std::vector<double>& rest) { p.tendons[c].set_rest(rest); })
      .def("forget", [](Probe& p) { p.search.clear(); });
  testing.def("root", [](int n, const dense::Numbers& a) {
    dense::Numbers l;
    dense::root(n, a, l);
    return l;
  });
  testing.def("sparse_solutions", &sparse_solutions, py::arg("systems"), py::arg("through") = false)
      .def("sparse_columns", &sparse_columns)
      .def("sparse_negative", &sparse_negative)
      .def("band_solutions", &band_solutions)
      .def("band_negative", &band_negative);
}

}  // namespace bt
