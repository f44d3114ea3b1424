"""A reader of meshes that does what a bad mesh might make it do."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from typing import Any

from rpctl.description.meshes import worker as mesh_worker
from rpctl.description.meshes.jobs import Answer
from rpctl.files.worker import Channel


def echo(head: Mapping[str, Any], arrays: Sequence[Any]) -> Answer:
    """Answer what was asked."""
    return dict(head), list(arrays)


def process(head: Mapping[str, Any], arrays: Sequence[Any]) -> Answer:
    """Return the process's number."""
    return {"id": os.getpid()}, []


def abort(head: Mapping[str, Any], arrays: Sequence[Any]) -> Answer:
    """End the process, as a fault of a library in C does."""
    os._exit(3)


def sleep(head: Mapping[str, Any], arrays: Sequence[Any]) -> Answer:
    """Never answer."""
    while True:
        time.sleep(1.0)


def grow(head: Mapping[str, Any], arrays: Sequence[Any]) -> Answer:
    """Take more memory than there may be."""
    return {"size": len(bytearray(2**40))}, []


def main(channel: Channel) -> None:
    """Answer jobs until nobody asks any more."""
    jobs = (echo, process, abort, sleep, grow)
    mesh_worker.main(channel, {job.__name__: job for job in jobs})
