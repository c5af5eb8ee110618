// The points at which an elastic foundation is integrated.
//
// Each point stands for a triangle, or for a patch of triangles that are close to each other and face the
// same way. It carries their area and lies at their centre of area. So a patch has the force of its
// triangles, and its moment, wherever the pressure is linear over it.
#pragma once
#include <vector>

#include "math/vec3.h"

namespace bt {

// Triangles, or what they are merged into, in the frame of their link.
struct FoundationSurface {
  std::vector<Vec3> centres;
  std::vector<double> areas;
  std::vector<int> regions;  // number of the connected patch
  int size() const { return static_cast<int>(centres.size()); }
};

// Merges triangles whose centres are within a box with sides of `resolution` at most [m], of one region, and
// whose unit normals differ by no more than a third. 0: as given.
FoundationSurface merged(const FoundationSurface& triangles, const std::vector<Vec3>& normals,
                         double resolution);

// The pressure p of a layer of the thickness h that is pressed by the depth d.
//
//   p = K d                          linear
//   p = -K h ln(1 - d/h)             logarithmic (Blankevoort et al. 1991); beyond 0.95 h along its tangent
//
// The second one has the slope K where d is small, and grows without bound as d approaches h.
struct FoundationLaw {
  double stiffness = 0;  // K [Pa/m]
  double thickness = 0;  // h [m]
  bool logarithmic = false;

  struct Value {
    double pressure, slope;  // p [Pa], dp/dd [Pa/m]
    double energy, moment;   // int p dd [J/m^2], int d p dd [J/m]
  };
  Value at(double depth) const;
};

}  // namespace bt
