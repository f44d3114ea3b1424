"""Pinocchio's scratch memory of a model."""

from __future__ import annotations

import threading

import pinocchio as pin


class Workspace(threading.local):
    """A ``pinocchio.Data`` for each thread that asks: threads that share one overwrite it.

    Attributes:
        data: That of the calling thread.
    """

    def __init__(self, model: pin.Model) -> None:
        self.data = model.createData()  # in every thread anew
