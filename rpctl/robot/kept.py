"""Answers about robots that are kept: a run asks what the run before it asked."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar

from rpctl.robot.model import Robot

P = ParamSpec("P")
T = TypeVar("T")


def kept(
    count: int,
) -> Callable[[Callable[Concatenate[Robot, P], T]], Callable[Concatenate[Robot, P], T]]:
    """Return a decorator that keeps the last answers of a function of a robot.

    Robots are the same if they are one object; they and the answers must not be changed.
    """

    def decorate(
        function: Callable[Concatenate[Robot, P], T],
    ) -> Callable[Concatenate[Robot, P], T]:
        answers = deque[tuple[Robot, object, T]](maxlen=count)

        @wraps(function)
        def ask(robot: Robot, /, *args: P.args, **options: P.kwargs) -> T:
            for known, asked, answer in tuple(answers):
                if known is robot and asked == (args, options):
                    return answer
            found = function(robot, *args, **options)
            answers.append((robot, (args, options), found))
            return found

        return ask

    return decorate
