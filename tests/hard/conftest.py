"""The hard meshes, as a fixture and as parameters: every case alone, and combinations of them."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

FAST = {
    "one triangle", "flat", "needle rod", "coplanar sheets",
    "zero-area triangles", "near-duplicate vertices", "mixed winding", "doubled faces",
}  # fmt: skip
"""Meshes and damage of the fast part, which takes a minute; places take no fit, so all are in it."""

COMBINED_FAST = (2,)
COMBINED_SLOW = tuple(seed for seed in range(64) if seed not in COMBINED_FAST)


def _load() -> ModuleType:
    spec = importlib.util.spec_from_file_location("hard_meshes", Path(__file__).with_name("meshes.py"))
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


_MESHES = _load()


@pytest.fixture(scope="session")
def meshes() -> ModuleType:
    """The generators of `meshes.py`."""
    return _MESHES


def _case(name: str, argument: str) -> object:
    is_fast = argument == "place" or name in FAST
    return pytest.param(name, marks=() if is_fast else pytest.mark.slow)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """One test for each mesh, kind of damage, place or combination that the test asks for by name."""
    for argument, names in (
        ("hard_mesh", _MESHES.MESHES),
        ("damage", _MESHES.DAMAGES),
        ("place", [name for name in _MESHES.PLACES if name != "at home"]),
    ):
        if argument in metafunc.fixturenames:
            metafunc.parametrize(argument, [_case(name, argument) for name in names])
    if "combination" in metafunc.fixturenames:
        slow = [pytest.param(seed, marks=pytest.mark.slow) for seed in COMBINED_SLOW]
        metafunc.parametrize("combination", [*COMBINED_FAST, *slow])
