// Per-particle vectors, stored by component (x plane, y plane, z plane), so that loops over particles or
// springs are vectorised.
#pragma once
#include <algorithm>
#include <vector>

#include "math/vec3.h"

namespace bt {

// Largest |a| of n numbers; NaN if one of them is not finite.
double largest_of(const double* a, int n);

// `planes` rows of n doubles, each padded to whole vector registers with zeros.
class Planes {
 public:
  Planes() = default;
  Planes(int planes, int n) { resize(planes, n); }
  void resize(int planes, int n);
  void zero() { std::fill(data_.begin(), data_.end(), 0.0); }
  int size() const { return n_; }
  int stride() const { return stride_; }
  double* operator[](int plane) { return data_.data() + static_cast<size_t>(plane) * stride_; }
  const double* operator[](int plane) const { return data_.data() + static_cast<size_t>(plane) * stride_; }

 private:
  int n_ = 0, stride_ = 0;
  std::vector<double> data_;
};

class Field : public Planes {
 public:
  Field() = default;
  explicit Field(int n) : Planes(3, n) {}
  void resize(int n) { Planes::resize(3, n); }
  Vec3 at(int i) const { return {(*this)[0][i], (*this)[1][i], (*this)[2][i]}; }
  void set(int i, Vec3 v) {
    (*this)[0][i] = v.x;
    (*this)[1][i] = v.y;
    (*this)[2][i] = v.z;
  }
  // Largest |component|; NaN if one of them is not finite.
  double largest() const { return largest_of((*this)[0], 3 * stride()); }  // the padding is 0
  void add(int i, Vec3 v) {
    (*this)[0][i] += v.x;
    (*this)[1][i] += v.y;
    (*this)[2][i] += v.z;
  }
};

// The sum of a_i . b_i.
double inner(const Field& a, const Field& b);

}  // namespace bt
