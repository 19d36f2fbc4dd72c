"""`sdfprim render --gi reference`: layers that fit together, what is kept, and what is told."""

from __future__ import annotations

import builtins
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipelines.reference import mitsuba as loader
from pipelines.reference.store import FOLDER
from pipelines.reference.truth import Reference
from runtime.images import read_layers
from runtime.views import AOV_LAYERS

SIZE = "--size", "32x20", "--camera", "west", "--sky", "0.4,0.5,0.6", "--lights", "file"


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(FOLDER, str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def needs_mitsuba() -> None:
    pytest.importorskip("mitsuba", reason="Mitsuba is not installed: pip install 'sdfprim[reference]'")


def layers_of(path: Path) -> dict[str, np.ndarray]:
    """Layers (h, w, 3) of an EXR; the picture is called final."""
    pixels, names = read_layers(path)
    channel = dict(zip(names, np.moveaxis(pixels, -1, 0), strict=True))
    layers = {"final": np.stack([channel[c] for c in "RGB"], axis=-1)}
    for layer in AOV_LAYERS:
        kind = "XYZ" if f"{layer}.X" in channel else "RGB"
        layers[layer] = np.stack([channel[f"{layer}.{c}"] for c in kind], axis=-1)
    return layers


@pytest.mark.parametrize("gi", ["reference", "reference-gpu"])
def test_layers_make_the_picture(
    sdfprim: Callable[..., Any],
    gpu: Any,
    needs_mitsuba: None,
    wall: Path,
    tmp_path: Path,
    cache: Path,
    gi: str,
) -> None:
    """E was measured at our G-buffer's points, the picture through the camera: rho E / pi is the same."""
    ran = sdfprim(
        "render", wall, "--gi", gi, *SIZE, "--samples", 64, "--aov", "-o", tmp_path / "a.exr", "--json"
    )
    assert ran.code == 0, ran.err
    assert ran.report["reference"]["samples"] == 64
    assert 0 < ran.report["reference"]["noise"] < 0.2
    layers = layers_of(tmp_path / "a.exr")
    np.testing.assert_allclose(layers["direct"] + layers["indirect"], layers["final"], atol=1e-5)
    shown = (layers["normal"] != 0).any(axis=-1)
    reflected = (layers["albedo"] / np.pi * layers["irradiance"])[shown]
    assert reflected.mean() == pytest.approx(layers["indirect"][shown].mean(), rel=0.03)
    np.testing.assert_allclose(
        layers["final"][~shown], np.tile((0.4, 0.5, 0.6), (np.sum(~shown), 1)), rtol=1e-5
    )


def test_a_reference_is_kept(
    sdfprim: Callable[..., Any],
    gpu: Any,
    needs_mitsuba: None,
    wall: Path,
    tmp_path: Path,
    cache: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    command = ("render", wall, "--gi", "reference", *SIZE)
    assert sdfprim(*command, "-o", tmp_path / "a.exr").code == 0
    moved = tmp_path / "elsewhere.glb"
    moved.write_bytes(wall.read_bytes())
    monkeypatch.setattr(Reference, "picture", None)
    again = sdfprim("render", moved, *command[2:], "-o", tmp_path / "b.exr", "--json")
    assert again.code == 0, again.err
    np.testing.assert_array_equal(*(read_layers(tmp_path / f"{name}.exr")[0] for name in "ab"))
    with pytest.raises(TypeError):
        sdfprim("render", moved, *command[2:], "--sun", "0,1,0,3", "-o", tmp_path / "c.exr")


def test_a_reference_ends_at_the_noise_asked_for(
    sdfprim: Callable[..., Any], gpu: Any, needs_mitsuba: None, wall: Path, tmp_path: Path, cache: Path
) -> None:
    ran = sdfprim(
        "render",
        wall,
        "--gi",
        "reference",
        *SIZE,
        "--samples",
        4096,
        "--noise",
        0.1,
        "-o",
        tmp_path / "a.png",
    )
    assert ran.code == 0, ran.err
    assert "paths a pixel, noise" in ran.out
    assert "4096" not in ran.out


def test_a_missing_extra_is_told_before_anything_is_loaded(
    sdfprim: Callable[..., Any], wall: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = builtins.__import__

    def without_mitsuba(name: str, *rest: Any) -> Any:
        if name == "mitsuba":
            raise ImportError(name)
        return real(name, *rest)

    loader.load_mitsuba.cache_clear()
    monkeypatch.setattr(builtins, "__import__", without_mitsuba)
    ran = sdfprim("render", wall, "--gi", "reference", "-o", tmp_path / "a.png")
    monkeypatch.undo()
    loader.load_mitsuba.cache_clear()
    assert ran.code == 1
    assert "pip install 'sdfprim[reference]'" in ran.err
    assert "load" not in ran.err.splitlines()[0]


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--samples", 1), "--samples 1"),
        (("--noise", 0), "--noise 0"),
        (("--set", __file__), "needs no set"),
        (("--view", "sdfddgi/probe-atlas"), "no such view"),
    ],
)
def test_what_a_reference_does_not_take(
    sdfprim: Callable[..., Any], wall: Path, tmp_path: Path, options: tuple[Any, ...], word: str
) -> None:
    ran = sdfprim("render", wall, "--gi", "reference-gpu", *options, "-o", tmp_path / "a.png")
    assert ran.code == 2
    assert word in ran.err
