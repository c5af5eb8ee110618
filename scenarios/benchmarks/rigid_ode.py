"""Exact equations of rigid bodies on massless springs, solved by scipy. They share no code with the core.

A spring of stiffness K [N] and rest length L [m] pulls its two ends together with K (length/L - 1): Hooke's
law of a tendon without mass. Free bodies: Newton's and Euler's equations in three dimensions, turns as unit
quaternions. Arm: Lagrange's equations of two hinges in the xz plane.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

GRAVITY = 9.81  # m/s^2
RELATIVE, ABSOLUTE = 1e-10, 1e-12  # tolerances of solve_ivp


def pull(start, end, stiffness, rest) -> np.ndarray:
    """(3,) force on `start` [N]; start, end (3,) [m]."""
    along = end - start
    length = np.linalg.norm(along)
    return stiffness * (1 / rest - 1 / length) * along


class FreeBodies:
    """n free bodies. masses (n,) [kg], inertias (n, 3) about their own axes [kg m^2].

    springs: (body, point, body, point, K, L), with points in the body's frame; body -1: in the world's.
    """

    def __init__(self, masses, inertias, springs):
        self.masses, self.inertias, self.springs = np.array(masses), np.array(inertias), springs

    def paths(self, positions, turns, times) -> np.ndarray:
        """(len(times), n, 3) centres of mass [m], from rest at positions (n, 3) and quaternions (n, 4)."""
        state = np.concatenate([np.ravel(positions), np.ravel(turns), np.zeros(6 * len(self.masses))])
        return _solve(self._rates, state, times)[:, : 3 * len(self.masses)].reshape(len(times), -1, 3)

    def _rates(self, _, state):
        n = len(self.masses)
        x, turn, v, spin = np.split(state, [3 * n, 7 * n, 10 * n])
        x, turn, v, spin = x.reshape(n, 3), turn.reshape(n, 4), v.reshape(n, 3), spin.reshape(n, 3)
        axes = Rotation.from_quat(turn).as_matrix()
        force, torque = np.zeros((n, 3)), np.zeros((n, 3))
        force[:, 2] = -GRAVITY * self.masses
        for a, at, b, bt, stiffness, rest in self.springs:
            arms = [points if body < 0 else axes[body] @ points for body, points in ((a, at), (b, bt))]
            start, end = (arm if body < 0 else x[body] + arm for body, arm in zip((a, b), arms, strict=True))
            force_on_a = pull(start, end, stiffness, rest)
            for body, arm, f in ((a, arms[0], force_on_a), (b, arms[1], -force_on_a)):
                if body >= 0:
                    force[body] += f
                    torque[body] += np.cross(arm, f)
        inertia = np.einsum("nij,nj,nkj->nik", axes, self.inertias, axes)
        gyroscopic = np.cross(spin, np.einsum("nij,nj->ni", inertia, spin))
        angular = np.linalg.solve(inertia, (torque - gyroscopic)[..., None])[..., 0]
        vector, scalar = turn[:, :3], turn[:, 3:]
        turning = np.hstack(
            [scalar * spin + np.cross(spin, vector), -np.sum(spin * vector, 1, keepdims=True)]
        )
        linear = force / self.masses[:, None]
        return np.concatenate([v.ravel(), turning.ravel() / 2, linear.ravel(), angular.ravel()])


class Arm:
    """Two equal links on hinges about y. At angles (0, 0) they lie along x; angles turn x towards -z.

    length [m], mass [kg], inertia about y at the link's middle [kg m^2]; the spring (anchor (3,), K, L) is on
    the second link's tip.
    """

    def __init__(self, length, mass, inertia, anchor, stiffness, rest):
        self.length, self.mass, self.inertia = length, mass, inertia
        self.anchor, self.spring = np.array(anchor), (stiffness, rest)

    def points(self, angles) -> np.ndarray:
        """(..., 3, 3) middles of both links and the tip [m]; angles (..., 2) [rad]."""
        along = self._along(angles)
        first, second = along[..., 0, :], along[..., 1, :]
        return np.stack([first / 2, first + second / 2, first + second], axis=-2)

    def paths(self, angles, times) -> np.ndarray:
        """(len(times), 2, 3) middles of the links [m], from rest at angles (2,) [rad]."""
        found = _solve(self._rates, np.concatenate([angles, np.zeros(2)]), times)
        return self.points(found[:, :2])[:, :2]

    def _along(self, angles) -> np.ndarray:
        """(..., 2, 3) from a link's hinge to its end [m]."""
        turned = np.cumsum(angles, axis=-1)
        return self.length * np.stack([np.cos(turned), np.zeros_like(turned), -np.sin(turned)], axis=-1)

    def _rates(self, _, state):
        """By the sum of the wrenches over the hinges: M(q) q'' + h(q, q') = Q."""
        angles, rates = state[:2], np.cumsum(state[2:])
        along = self._along(angles)
        across = np.array([[a[2], 0, -a[0]] for a in along])  # derivative by the link's own direction
        jacobians = [(across[0] / 2, 0 * across[1]), (across[0], across[1] / 2), (across[0], across[1])]
        drift = [-along[0] / 2 * rates[0] ** 2, -along[0] * rates[0] ** 2 - along[1] / 2 * rates[1] ** 2]
        matrix, load = self.inertia * np.eye(2), np.zeros(2)  # of the directions of the links
        for jacobian, centripetal in zip(np.array(jacobians[:2]), drift, strict=True):
            matrix = matrix + self.mass * jacobian @ jacobian.T
            load += jacobian @ (self.mass * (np.array([0, 0, -GRAVITY]) - centripetal))
        load += np.array(jacobians[2]) @ pull(along.sum(axis=0), self.anchor, *self.spring)
        directions = np.linalg.solve(matrix, load)
        return np.concatenate([state[2:], [directions[0], directions[1] - directions[0]]])


def _solve(rates, state, times) -> np.ndarray:
    """(len(times), len(state)) from time 0; times in ascending order [s]."""
    found = solve_ivp(rates, (0, times[-1]), state, "DOP853", times, rtol=RELATIVE, atol=ABSOLUTE)
    if not found.success:
        raise ArithmeticError(f"solve_ivp: {found.message}")
    return found.y.T
