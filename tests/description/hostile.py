"""A .xacro as somebody hostile writes it: its expression runs any Python, and tells what it got."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from pathlib import Path

from rpctl.description.xacro.expansion import expand
from tests.workspaces import xacro

# xacro looks for dunders in an expression, but not in functions within it. Each leads to builtins.
ROUTES = {
    "subclasses": "(lambda: [c for c in ().__class__.__base__.__subclasses__() "
    "if c.__name__ == '_wrap_close'][0].__init__.__globals__['sys'].modules['builtins'])()",
    "a function's globals": "(lambda: xacro.load_yaml.__globals__['sys'].modules['builtins'])()",
    "a generator's frame": "(lambda climb, run: [run.append((climb(climb, each.gi_frame) for each "
    "in run)), [f for f in run[0]]][1][0].f_globals['sys'].modules['builtins'])((lambda c, f: f if "
    "f.f_code.co_name == 'safe_eval' else c(c, f.f_back)), python.list())",
}
HOOK_OFF = """
sys.modules["rpctl.description.xacro.worker"].FORBIDDEN_EVENTS = ("nothing",)
"""
PROGRAM = """
import gc, io, os, sys
{before}
outside = sys.modules["xacro"].parse.__self__._outside
def tried(code):
    try:
        return "got " + repr(eval(code))[:500]
    except BaseException as error:
        return type(error).__name__ + ": " + str(error)
told = repr([tried(code) for code in {codes!r}]).encode().hex()
"""


def run_in_xacro(
    path: Path, codes: Iterable[str], hook: bool, route: str = "a function's globals"
) -> list[str]:
    """Return what each Python expression got, or the error it met, inside an expansion.

    Args:
        path: Where to write the .xacro.
        codes: The expressions; they see os, sys, io and ``outside``, the way to files.
        hook: Whether the audit hook stays on.
        route: By which it gets at Python's builtins, of :data:`ROUTES`.
    """
    program = PROGRAM.format(before="" if hook else HOOK_OFF, codes=list(codes)).encode().hex()
    names = "(lambda m: m if python.isinstance(m, python.dict) else m.__dict__)"
    call = f"b['exec'](b['bytes'].fromhex('{program}').decode(), d)"  # a brace would end it
    run = f"(lambda b: (lambda d: ({call}, d['told'])[1])(python.dict(__builtins__=b)))"
    content = f"${{{run}({names}({ROUTES[route]}))}}"
    xacro(path, f'<link name="{content}"/>'.replace("&", "&amp;"))
    text = expand(path).text
    told = bytes.fromhex(text.partition('<link name="')[2].partition('"')[0]).decode()
    answers = ast.literal_eval(told)
    assert isinstance(answers, list)
    return answers
