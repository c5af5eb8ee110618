// Small dense row-major matrices (n n numbers in a vector), for the bodies' coordinates.
#pragma once
#include <type_traits>
#include <vector>

#include "math/sym3.h"

namespace bt {

namespace dense {

using Numbers = std::vector<double>;

// Work space, whose content is not copied.
struct Scratch : Numbers {
  using Numbers::operator=;
  Scratch() = default;
  Scratch(const Scratch&) {}
  Scratch& operator=(const Scratch&) { return *this; }
  Scratch(Scratch&&) = default;
  Scratch& operator=(Scratch&&) = default;
};

// Calls do_it(n). For n = 6, a rigid body, n is a compile-time constant, so that loops are unrolled.
template <class Do>
inline void of_size(int n, Do do_it) {
  constexpr std::integral_constant<int, 6> kRigid;
  n == kRigid ? do_it(kRigid) : do_it(n);
}

void set_identity(int n, Numbers& a);
// y = A x, and y = A^T x.
void multiply(const Numbers& a, const Numbers& x, Numbers& y);
void multiply_transposed(const Numbers& a, const Numbers& x, Numbers& y);
// c = A B^T, of matrices with rows of n numbers.
void product_transposed(int n, const Numbers& a, const Numbers& b, Numbers& c);
// c = A B, both n x n.
void product(int n, const Numbers& a, const Numbers& b, Numbers& c);
// C -= A B, where B and C have rows of n numbers.
void subtract_product(int n, const Numbers& a, const Numbers& b, Numbers& c);
// y += A^T x, where A has `rows` rows.
void add_rows(const Numbers& a, int rows, const double* x, Numbers& y);
// L of a positive semidefinite A = L L^T. Columns whose pivot is zero but for rounding are zero.
void root(int n, const Numbers& a, Numbers& l);
// x <- L^-1 x; 0 where a pivot is zero.
void forward(const Numbers& l, Numbers& x);
// B <- L^-1 B, where B has rows of n numbers.
void forward_rows(const Numbers& l, int n, Numbers& b);
// Eigenvalues of a symmetric matrix, on the diagonal of a, which is overwritten. Eigenvectors in the columns
// of u (Jacobi).
void eigen(int n, Numbers& a, Numbers& u);
double dot(const Numbers& a, const Numbers& b);
// y += s x; nothing if x is empty.
void add(Numbers& y, double s, const Numbers& x);
// |L^-1 x|^2; half is work space.
double inverse_square(const Numbers& l, const Numbers& x, Numbers& half);
// a = E E^T w; half is work space.
void respond(const Numbers& e, const Numbers& w, Numbers& half, Numbers& a);
// x <- A^-1 x by the factor L of A; 0 where a pivot is zero.
void solve(const Numbers& l, Numbers& x);

}  // namespace dense

using dense::Numbers;

// The matrix with its negative eigenvalues set to zero.
Sym3 positive_part(const Sym3& s);

}  // namespace bt
