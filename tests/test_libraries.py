"""A library of one's own is lean, and leaves nothing behind."""

from __future__ import annotations

import subprocess
import sys
import threading
from importlib import metadata
from pathlib import Path

import pytest

from rpctl.libraries import install_command, lean_library

READ_A_FILE = """
import io, sys
from rpctl.equivalence.file_drive import UNUSED, YOURDFPY
from rpctl.libraries import install_command, lean_library
yourdfpy = lean_library("yourdfpy", YOURDFPY, UNUSED)
text = b'<robot name="r"><link name="a"/></robot>'
robot = yourdfpy.URDF.load(io.BytesIO(text), build_scene_graph=False, load_meshes=False).robot
assert [link.name for link in robot.links] == ["a"]
assert not {"trimesh", "yourdfpy", "networkx", "PIL", "scipy.spatial"} & sys.modules.keys()
"""


def test_yourdfpy_reads_without_what_trimesh_takes_along() -> None:
    done = subprocess.run([sys.executable, "-c", READ_A_FILE], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.fixture
def packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Three packages: one that takes another along, and does or must not do without a third."""
    texts = {
        "lean_host": "import lean_guest\ntry:\n    import lean_extra\nexcept ImportError:\n"
        "    lean_extra = None\n",
        "lean_guest": "",
        "lean_extra": "",
        "lean_needy": "import lean_extra\n",
    }
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


@pytest.mark.usefixtures("packages")
def test_it_is_forgotten_with_what_it_took_along() -> None:
    host = lean_library("lean_host", ("lean_host", "lean_guest"), ("lean_extra",))
    assert host.lean_extra is None
    assert not {"lean_host", "lean_guest", "lean_extra"} & sys.modules.keys()
    assert host is lean_library("lean_host", ("lean_host", "lean_guest"), ("lean_extra",))
    import lean_host  # type: ignore[import-not-found]

    assert lean_host is not host
    assert lean_host.lean_extra.__name__ == "lean_extra"


def test_another_thread_finds_what_this_one_does_not() -> None:
    from rpctl.libraries import _absent

    found: list[str] = []

    def imports() -> None:
        import colorsys

        found.append(colorsys.__name__)

    sys.modules.pop("colorsys", None)
    with _absent(("colorsys",)):
        with pytest.raises(ModuleNotFoundError, match="colorsys is left out"):
            import colorsys  # noqa: F401
        thread = threading.Thread(target=imports)
        thread.start()
        thread.join()
    assert found == ["colorsys"]


def test_a_command_installs_an_extra_s_packages_without_rpctl(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From a checkout as from a wheel: no package index has rpctl."""
    needed = [
        "casadi<4,>=3.6",
        "sympy<2,>=1.12; extra == 'derive'",
        "mujoco<5,>=3.14; (python_version >= '3.11') and extra == 'mujoco'",
        "av<19,>=13; extra == 'film'",
        "playwright<2,>=1.45; extra == 'film'",
        "sympy<2,>=1.12; extra == 'dev'",
    ]
    monkeypatch.setattr(metadata, "requires", lambda name: needed)
    assert install_command("derive") == "pip install 'sympy<2,>=1.12'"
    assert install_command("mujoco") == "pip install 'mujoco<5,>=3.14'"
    assert install_command("film") == "pip install 'av<19,>=13' 'playwright<2,>=1.45'"
    assert install_command("casadi") == "pip install 'casadi<4,>=3.6'"


def test_without_an_installed_rpctl_the_command_is_for_its_checkout(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def requires(name: str) -> list[str]:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "requires", requires)
    assert install_command("derive") == "pip install '.[derive]'"
