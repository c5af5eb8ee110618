// Single terms of a step's potential, for tests of derivatives.
#include "bindings.h"
#include "sparse.h"
#include "terms.h"

namespace bt {

namespace {

py::tuple term_of(const Term& term) {
  const py::ssize_t m = 3 * term.gradient.size();
  Array matrix({m, m});
  std::copy(term.matrix.begin(), term.matrix.end(), matrix.mutable_data());
  return py::make_tuple(term.energy, rows_of(term.gradient), matrix);
}

py::tuple spring_term_of(const World& w, int c, bool shear, const Array& x, const Array& before, double b) {
  return term_of(spring_term(*w.chains[c], shear, field_of(x), field_of(before), b));
}

// A contact row at a position, as the position has it.
py::tuple row_term(int kind, const Array& relative, const Array& normal, double offset, const Array& point,
                   const Array& axis, double ring, double stiffness, double carried, double grip,
                   double limit, const Array& stuck, bool definite) {
  Row row;
  row.kind = static_cast<ContactKind>(kind);
  row.normal = vec(normal), row.offset = offset, row.axis_point = vec(point), row.axis = vec(axis);
  row.ring = ring, row.stiffness = stiffness, row.carried = carried;
  row.friction = limit > 0 ? 1 : 0, row.limit = limit, row.grip = grip, row.stuck = vec(stuck);
  row.evaluate(vec(relative), true, definite);
  Array block({3, 3});
  const Block3 b = block_of(row.block);
  std::copy(b.v, b.v + 9, block.mutable_data());
  return py::make_tuple(row.gap, tuple(row.normal), tuple(row.total_force), block, row.sliding);
}

// All of a row's block on the particles that it touches with the weights P: P^T block P, and the levers.
Array full_block(const Row& row, const double* P, int particles) {
  const Block3 block = block_of(row.block);
  Array full({3 * particles, 3 * particles});
  for (int i = 0; i < particles; ++i)
    for (int j = 0; j < particles; ++j) {
      Block3 part = block;
      for (double& v : part.v) v *= P[i] * P[j];
      for (int k = 0; k < row.levers; ++k) {
        const Vec3 p = row.lever_share[k] * row.lever[k][i], q = row.lever[k][j];
        const double rows[3] = {p.x, p.y, p.z}, columns[3] = {q.x, q.y, q.z};
        for (int e = 0; e < 9; ++e) part.v[e] += rows[e / 3] * columns[e % 3];
      }
      for (int e = 0; e < 9; ++e) full.mutable_at(3 * i + e / 3, 3 * j + e % 3) = part.v[e];
    }
  return full;
}

// A segment against the edge of a mouth, its point followed: gap, forces on its ends, and all of its block.
py::tuple edge_term(const Array& start, const Array& end, double offset, const Array& centre,
                    const Array& axis, double ring, double stiffness, double carried) {
  Row row;
  row.kind = ContactKind::mouth, row.a = {0, 0, 0.5, 0.5};
  row.offset = offset, row.axis_point = vec(centre), row.axis = vec(axis), row.ring = ring;
  row.stiffness = stiffness, row.carried = carried;
  const Vec3 a = vec(start), b = vec(end);
  for (int i = 0; i < 50; ++i) row.follow(a, b);
  row.evaluate(row.a.w0 * a + row.a.w1 * b, true, false);
  row.add_lever(a, b, false);
  const double P[2] = {row.a.w0, row.a.w1};
  return py::make_tuple(row.gap, tuple(row.a.w0 * row.total_force), tuple(row.a.w1 * row.total_force),
                        full_block(row, P, 2));
}

// Two segments (4, 3) that touch, their points followed: gap, forces on the four ends, and all of the block.
py::tuple pair_term(const Array& ends, double offset, double stiffness, double carried) {
  Row row;
  row.kind = ContactKind::tendon, row.a = {0, 0, 0.5, 0.5}, row.b = {1, 0, 0.5, 0.5};
  row.offset = offset, row.stiffness = stiffness, row.carried = carried;
  const Field f = field_of(ends);
  const Vec3 x[4] = {f.at(0), f.at(1), f.at(2), f.at(3)};
  row.normal = row.side = unit_or(x[0] + x[1] - x[2] - x[3], {0, 0, 1});
  row.follow_pair(x, 1e300);
  const double P[4] = {row.a.w0, row.a.w1, -row.b.w0, -row.b.w1};
  row.evaluate(P[0] * x[0] + P[1] * x[1] + P[2] * x[2] + P[3] * x[3], true, false);
  row.add_pair_levers(x, false);
  Field force(4);
  for (int i = 0; i < 4; ++i) force.set(i, P[i] * row.total_force);
  return py::make_tuple(row.gap, rows_of(force), full_block(row, P, 4));
}

// Triangles (t, 3, 3) listed for a segment (2, 3), and what is nearest of them to that segment after it has
// moved: how far the list is whole, how many it has, and distance, point and u.
py::tuple listed_nearest(const Array& corners, const Array& segment, double reach, const Array& moved) {
  const Surface surface(triangles_of(corners));
  const Field from = field_of(segment), to = field_of(moved);
  std::vector<Nearby> listed;
  const double whole = surface.list(from.at(0), from.at(1), reach, listed);
  const Nearest found = surface.nearest(listed, to.at(0), to.at(1));
  return py::make_tuple(whole, listed.size(), found.distance, tuple(found.point), found.u);
}

// What is nearest of triangles (t, 3, 3) to segments (k, 6), no farther than `within` (k): rows of distance,
// point and u.
Array searched_nearest(const Array& corners, const Array& segments, const Array& within) {
  const Surface surface(triangles_of(corners));
  Array out({within.size(), static_cast<py::ssize_t>(5)});
  double* to = out.mutable_data();
  for (py::ssize_t k = 0; k < within.size(); ++k) {
    const double* from = segments.data() + 6 * k;
    const Nearest found = surface.search(vec(from), vec(from + 3), within.data()[k]);
    for (const double value : {found.distance, found.point.x, found.point.y, found.point.z, found.u})
      *to++ = value;
  }
  return out;
}

}  // namespace

void bind_terms(py::module_& testing) {
  testing.def("row_term", &row_term);
  testing.def("edge_term", &edge_term);
  testing.def("pair_term", &pair_term);
  testing.def("listed_nearest", &listed_nearest);
  testing.def("searched_nearest", &searched_nearest);
  testing.def("spring_term", &spring_term_of);
  testing.def("bending_term", [](const World& w, int c, const Array& x) {
    return term_of(bending_term(*w.chains[c], field_of(x)));
  });
}

}  // namespace bt
