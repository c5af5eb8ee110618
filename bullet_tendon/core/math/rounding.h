// Rounding errors.
#pragma once

namespace bt {

// Share of a quantity below which a difference of it is taken for rounding [-]: of lengths, distances, rates,
// masses, stiffnesses and energies. Rounding errors of coordinates a thousand times as large as the quantity
// are smaller. Larger: small but real differences are lost. Smaller: rounding decides.
constexpr double kRoundingShare = 1e-9;

}  // namespace bt
