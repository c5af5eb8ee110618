#include "bodies/bounded_rows.h"

#include <algorithm>
#include <cmath>

namespace bt {

namespace {

// Maximum number of pivots, per row, and violation, as a share of the rates involved, that is rounding [-].
constexpr size_t kPivotsPerRow = 10;
constexpr double kSettled = 1e-11;

// Sweeps of pybullet's own solver (its default), backwards and forwards in turn. It also ends them when no
// rate changes by more than kSolverResidual.
constexpr int kPybulletSweeps = 50;

}  // namespace

// Principal pivoting (Murty 1974; with upper bounds, Judice and Pires 1994): one row, the first that pulls
// beyond its bounds or is violated, changes sides at a time.
bool BoundedRows::solve(Numbers& pushes) const {
  const size_t m = rows_.size();
  Sides sides(m);
  for (size_t a = 0; a < m; ++a) sides[a] = side_of(a, pushes[a]);
  const std::vector<size_t> motors = find_motors();
  leave_to_motors(motors, sides);
  Numbers solved(m);
  for (size_t pivot = 0; pivot < kPivotsPerRow * m; ++pivot) {
    solve_acting(sides, solved);
    const std::pair<size_t, int> wrong = first_wrong(motors, sides, solved);
    if (wrong.first == m) {
      pushes = solved;
      return true;
    }
    sides[wrong.first] = wrong.second;
    leave_to_motors(motors, sides);
  }
  return false;
}

// Of every limit, the row of the motor of its joint. Of other rows, and where there is none: the number of
// rows.
std::vector<size_t> BoundedRows::find_motors() const {
  const size_t m = rows_.size();
  std::vector<size_t> motors(m, m);
  for (size_t b = 0; b < m; ++b) {
    if (!rows_[b].motor) continue;
    for (size_t a = 0; a < m; ++a)
      if (!rows_[a].motor && rows_[a].coordinate == rows_[b].coordinate) motors[a] = b;
  }
  return motors;
}

// A motor that holds its joint does so within its limits: these do not act as well, which would be singular.
void BoundedRows::leave_to_motors(const std::vector<size_t>& motors, Sides& sides) {
  for (size_t a = 0; a < sides.size(); ++a)
    if (held_by_motor(a, motors, sides)) sides[a] = -1;
}

bool BoundedRows::held_by_motor(size_t row, const std::vector<size_t>& motors, const Sides& sides) {
  return motors[row] < sides.size() && sides[motors[row]] == 0;
}

// Sets pushes to the impulses of all rows: of those that are within their bounds, such that they lack
// nothing.
void BoundedRows::solve_acting(const Sides& sides, Numbers& pushes) const {
  const size_t m = sides.size();
  std::vector<size_t> acting;
  Numbers among, root, solved;
  for (size_t a = 0; a < m; ++a) {
    pushes[a] = sides[a] == 0 ? 0 : bound(a, sides[a]);
    if (sides[a] == 0) acting.push_back(a);
  }
  for (size_t a : acting) {
    solved.push_back(lacks(a, pushes));
    for (size_t b : acting) among.push_back(within_[a * m + b]);
  }
  dense::root(static_cast<int>(acting.size()), among, root);
  dense::solve(root, solved);
  for (size_t k = 0; k < acting.size(); ++k) pushes[acting[k]] = solved[k];
}

// The first row with a wrong side, and the side that it changes to; none: the number of rows.
std::pair<size_t, int> BoundedRows::first_wrong(const std::vector<size_t>& motors, const Sides& sides,
                                                const Numbers& pushes) const {
  const size_t m = sides.size();
  for (size_t a = 0; a < m; ++a) {
    const Stop& row = rows_[a];
    if (sides[a] == 0) {
      if (pushes[a] < bound(a, -1)) return {a, -1};
      if (pushes[a] > bound(a, 1)) return {a, 1};
    } else if (row.least < row.most && row.admitted && !held_by_motor(a, motors, sides)) {
      const double lacking = lacks(a, pushes);
      const double rounding = kSettled * (whole_[a] + std::fabs(left_[a] - lacking));
      if (-sides[a] * lacking > rounding) return {a, 0};
    }
  }
  return {m, 0};
}

// One sweep of projected Gauss-Seidel. Returns the largest change of a rate [m/s], [rad/s].
double BoundedRows::sweep(Numbers& pushes, bool backwards) const {
  const size_t m = rows_.size();
  double most = 0;
  for (size_t k = 0; k < m; ++k) {
    const size_t a = backwards ? m - 1 - k : k;
    if (!rows_[a].admitted || rows_[a].given > 0) continue;
    const double before = pushes[a], own = within_[a * m + a];
    pushes[a] = std::min(bound(a, 1), std::max(bound(a, -1), before + lacks(a, pushes) / own));
    most = std::max(most, own * std::fabs(pushes[a] - before));
  }
  return most;
}

void BoundedRows::sweep_as_pybullet(const Numbers& solved, Numbers& swept) const {
  swept.assign(rows_.size(), 0.0);
  for (size_t a = 0; a < rows_.size(); ++a)
    if (rows_[a].given > 0) swept[a] = solved[a];
  double change = 2 * kSolverResidual;
  for (int k = 0; k < kPybulletSweeps && change > kSolverResidual; ++k) change = sweep(swept, k % 2 == 0);
}

double BoundedRows::differs(const Numbers& a, const Numbers& b) const {
  double most = 0;
  for (size_t row = 0; row < rows_.size(); ++row)
    most = std::max(most, std::fabs(lacks(row, a) - lacks(row, b)));
  return most;
}

}  // namespace bt
