#include "terms.h"

#include "chain_bending.h"

namespace bt {

namespace {

std::vector<double> dense(const Band& a) {
  const int m = 3 * a.n;
  std::vector<double> full(static_cast<size_t>(m) * m, 0.0);
  Field unit(a.n), image(a.n);
  for (int j = 0; j < m; ++j) {
    unit.zero();
    unit[j % 3][j / 3] = 1;
    a.multiply(unit, image);
    for (int i = 0; i < m; ++i) full[static_cast<size_t>(i) * m + j] = image[i % 3][i / 3];
  }
  return full;
}

}  // namespace

Term spring_term(const Chain& c, bool shear, const Field& x, const Field& before, double b) {
  Term term;
  SpringSet s = shear ? c.shear : c.structure;
  measure(s, before);
  s.start = s.history = s.length;
  evaluate(s, c.material.law, x, Field(c.n()), before, b);
  term.gradient.resize(c.n());
  scatter_forces(s, term.gradient);
  term.energy = stored_energy(s, c.material.law);
  linearise(s, c.material.law, Linearisation::position, 0, b, false);
  Band matrix;
  matrix.resize(c.n(), c.matrix.half);
  scatter_blocks(s, matrix);
  term.matrix = dense(matrix);
  return term;
}

Term bending_term(const Chain& c, const Field& x) {
  Term term;
  Chain at(c);
  at.residual.zero(), at.matrix.zero();
  add_bending_forces(at, x);
  add_bending_blocks(at, x, false);
  term.energy = bending_energy(at, x);
  term.gradient = at.residual;
  term.matrix = dense(at.matrix);
  return term;
}

}  // namespace bt
