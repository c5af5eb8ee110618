// The sparse and the banded solver by themselves, for tests.
#include "band.h"
#include "bindings.h"
#include "sparse.h"

namespace bt {

namespace {

SparseFactor::Edges edges_of(const Ints& pairs) {
  SparseFactor::Edges edges;
  for (py::ssize_t k = 0; k < pairs.shape(0); ++k) edges.push_back({pairs.at(k, 0), pairs.at(k, 1)});
  return edges;
}

Block3 block_at(const Array& blocks, py::ssize_t k) {
  Block3 b;
  std::copy(blocks.data() + 9 * k, blocks.data() + 9 * (k + 1), b.v);
  return b;
}

void fill_factor(SparseFactor& factor, const SparseFactor::Edges& edges, const Array& diagonal,
                 const Array& beside) {
  factor.start();
  for (int i = 0; i < factor.blocks(); ++i) factor.add(i, i, block_at(diagonal, i));
  for (size_t k = 0; k < edges.size(); ++k)
    factor.add(edges[k].first, edges[k].second, block_at(beside, static_cast<py::ssize_t>(k)));
}

// One factor for several systems, one after the other: (edges (m, 2), diagonal (n, 3, 3), beside (m, 3, 3),
// right (n, 3)) each. Solutions (n, 3), or None where a matrix is not definite, with the number of blocks
// below the diagonal of the factor.
py::list sparse_solutions(const py::list& systems) {
  SparseFactor factor;
  py::list out;
  for (const py::handle& system : systems) {
    auto [pairs, diagonal, beside, right] = system.cast<std::tuple<Ints, Array, Array, Array>>();
    const SparseFactor::Edges edges = edges_of(pairs);
    factor.analyse(static_cast<int>(diagonal.shape(0)), edges);
    fill_factor(factor, edges, diagonal, beside);
    std::vector<Vec3> b;
    for (py::ssize_t i = 0; i < right.shape(0); ++i) b.push_back(vec(right.data() + 3 * i));
    const bool definite = factor.factorise();
    if (definite) factor.solve(b);
    out.append(py::make_tuple(definite ? py::object(rows_of(b)) : py::none(), factor.below()));
  }
  return out;
}

// A band of blocks: its diagonal (n, 3, 3), and below it (reach, n, 3, 3), of which the last ones are not
// there.
Band band_of(const Array& diagonal, const Array& below) {
  Band a;
  a.resize(static_cast<int>(diagonal.shape(0)), static_cast<int>(below.shape(0)));
  for (int i = 0; i < a.n; ++i) {
    const double* d = diagonal.data() + 9 * i;
    a.add(i, {d[0], d[1], d[2], d[4], d[5], d[8]});
    for (int o = 0; o < a.half; ++o)
      for (int e = 0; e < 9; ++e) a.below[o][e][i] = below.data()[9 * (o * a.n + i) + e];
  }
  return a;
}

// Eight right-hand sides (n, 3, 8), zero but for the blocks first to last: solutions there (last - first + 1,
// 3, 8); that of the first of them, solved for by itself (n, 3); and what solves for that, there alone.
py::tuple band_solutions(const Array& diagonal, const Array& below, const Array& right, int first, int last) {
  const Band a = band_of(diagonal, below);
  BandFactor factor;
  factor.resize(a.n, a.half);
  if (!factor.factorise(a)) throw py::value_error("not definite");
  Columns b, x;
  b.resize(a.n), x.resize(a.n);
  std::copy(right.data(), right.data() + right.size(), b.number(0));
  factor.solve(b, first, last, x);
  Field one(a.n);
  for (int i = 0; i < a.n; ++i) one.set(i, {b.at(i)[0][0], b.at(i)[1][0], b.at(i)[2][0]});
  factor.solve(one, one);
  std::vector<Vec3> alone;
  for (int i = 0; i < a.n; ++i) alone.push_back(one.at(i));
  factor.solve(one, one, first, last);
  std::vector<Vec3> within;
  for (int i = first; i <= last; ++i) within.push_back(one.at(i));
  Array solved({py::ssize_t{last} - first + 1, py::ssize_t{3}, py::ssize_t{kLanes}});
  std::copy(x.number(first), x.number(last + 1), solved.mutable_data());
  return py::make_tuple(solved, rows_of(alone), rows_of(within));
}

}  // namespace

void bind_sparse(py::module_& testing) {
  testing.def("sparse_solutions", &sparse_solutions).def("band_solutions", &band_solutions);
}

}  // namespace bt
