// Material and cross-section of a tendon.
#pragma once
#include "tendon/axial_law.h"
#include "tendon/tissue.h"

namespace bt {

struct Material {
  Law law;
  double stiffness = 0;          // K of the cross-section [N]
  double damping = 0;            // C of the cross-section [N s^q]
  double shear_stiffness = 0;    // K of each shear spring [N], part of `stiffness`
  double bending_stiffness = 0;  // EI [N m^2]
  double linear_density = 0;     // [kg/m]
  Tissue tissue;
};

}  // namespace bt
