// Small dense matrices, by rows in vectors of n n numbers: what bodies' coordinates need.
#pragma once
#include <type_traits>
#include <vector>

namespace bt {

namespace dense {

using Numbers = std::vector<double>;

// Work space: nothing of it goes into a copy.
struct Scratch : Numbers {
  using Numbers::operator=;
  Scratch() = default;
  Scratch(const Scratch&) {}
  Scratch& operator=(const Scratch&) { return *this; }
  Scratch(Scratch&&) = default;
  Scratch& operator=(Scratch&&) = default;
};

// do_it(n), which knows n beforehand where it is that of a rigid body: loops of that length are unrolled.
template <class Do>
inline void of_size(int n, Do do_it) {
  constexpr std::integral_constant<int, 6> kRigid;
  n == kRigid ? do_it(kRigid) : do_it(n);
}

void set_identity(int n, Numbers& a);
// y = A x, and y = A^T x.
void multiply(const Numbers& a, const Numbers& x, Numbers& y);
void multiply_transposed(const Numbers& a, const Numbers& x, Numbers& y);
// c = A B^T of matrices with rows of n numbers.
void product_transposed(int n, const Numbers& a, const Numbers& b, Numbers& c);
// c = A B, both n x n.
void product(int n, const Numbers& a, const Numbers& b, Numbers& c);
// C -= A B, of rows of n numbers of B and C.
void subtract_product(int n, const Numbers& a, const Numbers& b, Numbers& c);
// y += A^T x, of as many rows of A.
void add_rows(const Numbers& a, int rows, const double* x, Numbers& y);
// L of a positive semidefinite A = L L^T; columns of pivots that are nothing are zero.
void root(int n, const Numbers& a, Numbers& l);
// x <- L^-1 x; zero where a pivot is nothing.
void forward(const Numbers& l, Numbers& x);
// B <- L^-1 B, of rows of n numbers.
void forward_rows(const Numbers& l, int n, Numbers& b);
// Eigenvalues, and eigenvectors in the columns of u, of a symmetric matrix, which is overwritten (Jacobi).
void eigen(int n, Numbers& a, Numbers& u);
double dot(const Numbers& a, const Numbers& b);
// a = E E^T w; half is work space.
void respond(const Numbers& e, const Numbers& w, Numbers& half, Numbers& a);
// x <- A^-1 x by the root L of A; zero where a pivot is nothing.
void solve(const Numbers& l, Numbers& x);

}  // namespace dense

}  // namespace bt
