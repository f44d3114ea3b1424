"""A worker that evaluates whatever it is told, as hostile code in one would."""

from __future__ import annotations

import builtins
import ctypes
import mmap
import os
import socket
import sys
from time import sleep

from rpctl.files.worker import Channel

HERE = {"ctypes": ctypes, "mmap": mmap, "os": os, "socket": socket, "sys": sys, "sleep": sleep}


def main(channel: Channel) -> None:
    """Answer each expression with its value's or its error's repr."""
    while True:
        code = channel.receive(2**16).decode()
        try:
            value = repr(eval(code, {**HERE, "__builtins__": builtins, "channel": channel}))
        except Exception as error:
            value = repr(error)
        channel.send(value.encode())
