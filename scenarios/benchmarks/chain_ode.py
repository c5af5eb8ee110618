"""The equations of a chain of springs as an ordinary differential equation, for scipy's solvers.

Written apart from the compiled core, with the material's law as Material states it: a segment of rest
length l at strain s and strain rate r pulls with K sgn(s)|s|^p + C sgn(r)|r|^q along its axis. Motion
stays in the plane of x and z. No shear springs, no toe.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from scipy.sparse import csc_matrix

PLANE = [0, 2]  # x and z
GRAVITY = 9.81  # m/s^2


@dataclasses.dataclass(frozen=True)
class ChainOde:
    """masses (n,) [kg]; rest (n-1,) [m]; held: particles that do not move; gravity along z [m/s^2].

    contact: further forces (n, 2) [N] at x and v, each from particles that are neighbours at most.
    """

    masses: np.ndarray
    rest: np.ndarray
    material: object
    held: tuple[int, ...]
    gravity: float = 0.0
    contact: Callable | None = None

    def accelerations(self, x, v) -> np.ndarray:
        """(n, 2) [m/s^2] at positions x and velocities v, both (n, 2)."""
        m = self.material
        edge, speed = np.diff(x, axis=0), np.diff(v, axis=0)
        length = np.sqrt(np.einsum("ij,ij->i", edge, edge))
        axis = edge / length[:, None]
        strain = length / self.rest - 1
        rate = np.einsum("ij,ij->i", axis, speed) / self.rest
        pull = m.stiffness * np.sign(strain) * np.abs(strain) ** m.exponent
        pull += m.damping * np.sign(rate) * np.abs(rate) ** m.damping_exponent
        force = np.zeros_like(x)
        force[:-1] += pull[:, None] * axis
        force[1:] -= pull[:, None] * axis
        if self.contact is not None:
            force += self.contact(x, v)
        result = force / self.masses[:, None] + [0.0, self.gravity]
        result[list(self.held)] = 0.0
        return result

    def solve(self, x, v, times, method, tolerance) -> np.ndarray:
        """(times, n, 2) positions [m] at the times [s] from the state x, v at time 0.

        method: of scipy.integrate.solve_ivp; tolerance: relative, and of every step in m and m/s times
        0.01. Raises ArithmeticError where scipy gives up.
        """
        count = len(self.masses)
        shape = (2, count, 2)

        def slope(_, state):
            x, v = state.reshape(shape)
            return np.concatenate([v.ravel(), self.accelerations(x, v).ravel()])

        more = {} if method == "DOP853" else {"jac_sparsity": self._pattern()}
        state = np.concatenate([np.ravel(x), np.ravel(v)])
        limits = {"rtol": tolerance, "atol": 0.01 * tolerance}
        found = solve_ivp(slope, (0.0, times[-1]), state, method, t_eval=times, **limits, **more)
        if not found.success:
            raise ArithmeticError(f"reference: {found.message}")
        return found.y.T.reshape(-1, *shape)[:, 0]

    def _pattern(self):
        """Which entries of the Jacobian can be other than zero."""
        count = len(self.masses)
        near = np.abs(np.subtract.outer(np.arange(count), np.arange(count))) <= 1
        block = np.kron(near, np.ones((2, 2)))
        top = np.hstack([np.zeros_like(block), np.eye(2 * count)])
        return csc_matrix(np.vstack([top, np.hstack([block, block])]))
