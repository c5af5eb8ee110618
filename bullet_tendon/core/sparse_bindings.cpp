// The sparse solver by itself, for tests.
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

}  // namespace

void bind_sparse(py::module_& m) { m.def("sparse_solutions", &sparse_solutions); }

}  // namespace bt
