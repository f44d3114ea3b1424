"""What links make of the inertias of the bodies that move, for many robots at once.

A body's pseudo-inertia is ∫ r rᵀ dm with r = (x, y, z, 1) (4, 4): the mass, the first moments and
the second ones in one matrix, which is T J Tᵀ in another frame (P. M. Wensing, S. Kim and J.-J. E.
Slotine, "Linear matrix inequalities for physically consistent inertial parameter identification",
IEEE Robotics and Automation Letters 3, 2018). Those of links that move together add up.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.description.records import Link
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot


class LinkInertias:
    """The links of a robot that have a mass, and the bodies that they are parts of.

    Attributes:
        names: Names of the links, in file order; L of them.
        body: Index of each link's body (L,): that of its joint in the model, less the root's.
    """

    def __init__(self, robot: Robot) -> None:
        model = robot.model
        links = [link for link in robot.description.links if link.mass]
        self.names = tuple(link.name for link in links)
        frames = [model.frames[model.getFrameId(name, pin.FrameType.BODY)] for name in self.names]
        self.body: NDArray[np.intp] = np.array([f.parentJoint - ROOT_JOINT for f in frames], int)
        poses = np.array([f.placement.homogeneous for f in frames]).reshape(-1, 4, 4)
        self._poses = poses
        self._masses = np.array([link.mass for link in links])
        self._centres = np.array([link.com for link in links]).reshape(-1, 3)
        spread = np.array([_about_centre(link) for link in links]).reshape(-1, 4, 4)
        self._spread = poses @ spread @ np.swapaxes(poses, 1, 2)
        local = np.hstack([self._centres, np.ones((len(links), 1))])
        self._places = np.einsum("lij,lj->li", poses, local)
        self._points = (self._places[:, :, None] * self._places[:, None]).reshape(-1, 16)
        self.nominal = np.array([pseudo_inertia(i) for i in list(model.inertias)[ROOT_JOINT:]])
        self._own = self._sums(np.ones((1, len(links))), None, None)

    def bodies(
        self, masses: Array, centres: Array | None = None, inertias: Array | None = None
    ) -> Array:
        """Return the pseudo-inertias (K, n_bodies, 4, 4) of K robots like this one.

        Args:
            masses: Scales of the links' masses (K, L), and with them of their inertias.
            centres: Offsets of their centres of mass in their own frames (K, L, 3), m; None: none.
            inertias: Further scales of their inertias about these centres (K, L); None: ones.
        """
        return np.asarray(self.nominal + (self._sums(masses, centres, inertias) - self._own))

    def _sums(self, masses: Array, offsets: Array | None, inertias: Array | None) -> Array:
        """Return what the links alone make of the bodies; :meth:`bodies` has the arguments."""
        weights = masses * self._masses
        scales = masses if inertias is None else masses * inertias
        found = np.zeros((len(masses), len(self.nominal), 16))
        for link, body in enumerate(self.body.tolist()):  # no matrix product: robots are alone
            point: Array = self._points[link]
            if offsets is not None and (own := offsets[:, link]).any():
                R = self._poses[link, :, :3]
                place = self._places[link] + sum(own[:, k, None] * R[:, k] for k in range(3))
                point = (place[:, :, None] * place[:, None]).reshape(-1, 16)
            found[:, body] += scales[:, link, None] * self._spread[link].ravel()
            found[:, body] += weights[:, link, None] * point
        return found.reshape(*found.shape[:2], 4, 4)


def pseudo_inertia(inertia: pin.Inertia) -> Array:
    """Return the pseudo-inertia (4, 4) of Pinocchio's inertia, about its frame's origin."""
    m, c = inertia.mass, inertia.lever
    return _pseudo(m, c, _second_moments(inertia.inertia))


def inertia_of(pseudo: Array) -> pin.Inertia:
    """Return Pinocchio's inertia of a pseudo-inertia (4, 4) with a mass.

    It need not be that of a body alone: a robot is sound if its inertia matrix is.
    """
    m = float(pseudo[3, 3])
    c = pseudo[:3, 3] / m
    found = pin.Inertia.Zero()
    found.mass, found.lever = m, c
    found.inertia = _second_moments_to_inertia(pseudo[:3, :3] - m * np.outer(c, c))
    return found


def _about_centre(link: Link) -> Array:
    """Return the pseudo-inertia (4, 4) of a link's spread about its centre of mass alone."""
    return _pseudo(0.0, np.zeros(3), _second_moments(link.inertia))


def _pseudo(m: float, c: Array, about_centre: Array) -> Array:
    found = np.zeros((4, 4))
    found[:3, :3] = about_centre
    r = np.array([*c, 1.0])
    return np.asarray(found + m * np.outer(r, r))


def _second_moments(inertia: Array) -> Array:
    """Return ∫ r rᵀ dm (3, 3) for ∫ (r·r − r rᵀ) dm."""
    return np.asarray(0.5 * np.trace(inertia) * np.eye(3) - inertia)


def _second_moments_to_inertia(second: Array) -> Array:
    return np.asarray(np.trace(second) * np.eye(3) - second)
