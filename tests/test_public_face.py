"""`import endolock`: light, complete, and helpful with a misspelt name."""

import ast
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

import endolock
from endolock.scripts import cli

ROOT = Path(__file__).parents[1]


def test_every_public_name_loads() -> None:
    assert sorted([*endolock.HOMES, "__version__"]) == list(endolock.__all__)
    for name in endolock.__all__:
        assert getattr(endolock, name) is not None
    assert set(endolock.__all__) <= set(dir(endolock))


def test_type_checkers_see_the_same_names() -> None:
    tree = ast.parse((ROOT / "src/endolock/__init__.py").read_text())
    (block,) = (
        node for node in tree.body if isinstance(node, ast.If) and isinstance(node.test, ast.Name)
    )
    seen = {
        alias.asname: f"{node.module}:{alias.name}".removeprefix("endolock.")
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    homes = {
        name: f"{home}:{name}" if ":" not in home else home for name, home in endolock.HOMES.items()
    }
    assert seen == homes


def test_import_endolock_loads_no_libraries() -> None:
    heavy = ("numpy", "mujoco", "cv2", "pyarrow", "rerun", "scipy", "control", "pydantic")
    code = f"import endolock, sys; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_a_misspelt_name_lists_similar_ones() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'TwinRg'; did you mean TwinRig"):
        _ = endolock.TwinRg  # type: ignore[attr-defined]
    with pytest.raises(AttributeError, match=r"see endolock\.__all__"):
        _ = endolock.zzz  # type: ignore[attr-defined]


def test_a_checkout_that_is_not_installed_has_a_version(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> str:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.delitem(vars(endolock), "__version__", raising=False)
    monkeypatch.setattr(metadata, "version", missing)
    try:
        assert endolock.__version__ == "0+unknown"
    finally:
        vars(endolock).pop("__version__", None)


def test_the_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out.strip() == endolock.__version__
    assert f'version = "{endolock.__version__}"' in (ROOT / "pyproject.toml").read_text()
