"""Primitive sets as .npz, and what every format shares: the choice by suffix, whole files, same bytes."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fit import export, rotation
from fit.primitives import (
    Kind,
    PrimitiveSet,
    make_box,
    make_cylinder,
    make_half_space,
    make_plane,
    make_sphere,
)

FIELDS = ("kinds", "positions", "rotations", "sizes", "albedo", "emission")


def random_set(seed: int) -> PrimitiveSet:
    """Up to ten primitives of all kinds and magnitudes."""
    rng = np.random.default_rng(seed)

    def one() -> PrimitiveSet:
        scale = 10.0 ** rng.uniform(-4, 5)
        turn, place = rotation.normalized(rng.normal(size=4)), rng.normal(size=3) * scale * 10
        albedo, emission = rng.random((6, 3)), rng.random((6, 3)) * 10.0 ** rng.uniform(-3, 3)
        name = rng.choice(["", "Wand ü", "lamp \0 😀"])
        return [
            lambda: make_box(place, rng.uniform(0.1, 1, 3) * scale, turn, albedo, emission, name),
            lambda: make_sphere(place, scale, albedo[0], emission[0], name),
            lambda: make_cylinder(place, scale, scale * rng.random() + 1e-5, turn, albedo, emission, name),
            lambda: make_plane(place, scale, 2 * scale, 0.01 * scale, turn, albedo, emission, name),
            lambda: make_half_space(place, turn, albedo[0], emission[0], name),
        ][rng.integers(0, 5)]()

    return PrimitiveSet.concatenate([one() for _ in range(rng.integers(0, 10))])


def same_bits(a: PrimitiveSet, b: PrimitiveSet) -> bool:
    names = [s.names if any(s.names) else () for s in (a, b)]
    return names[0] == names[1] and all(
        getattr(a, f).tobytes() == getattr(b, f).tobytes() and getattr(a, f).dtype == getattr(b, f).dtype
        for f in FIELDS
    )


@pytest.mark.parametrize("suffix", [".prims.npz", ".prims.glb"])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_round_trip_is_exact_to_the_bit(tmp_path_factory, suffix, seed):
    path = tmp_path_factory.mktemp("trip") / f"set{suffix}"
    primitives = random_set(seed)
    notes: list[str] = []
    export.write(primitives, path)
    assert same_bits(export.read(path, notes), primitives)
    assert notes == []


def test_names_survive_even_when_they_look_made_up(tmp_path):
    primitives = PrimitiveSet.concatenate(
        [make_box(name=n) for n in ("box_0001", "", "box", "a mesh", "a" * 300)]
    )
    for suffix in (".npz", ".glb"):
        export.write(primitives, tmp_path / f"set{suffix}")
        assert export.read(tmp_path / f"set{suffix}").names == primitives.names


@pytest.mark.parametrize("suffix", [".npz", ".glb", ".usda", ".wgsl"])
def test_same_set_gives_same_bytes_in_any_process_at_any_time(tmp_path, suffix):
    """Another process, hash seed and clock: nothing but the set decides the bytes."""
    primitives = random_set(3)
    export.write(primitives, tmp_path / "set.npz")
    export.write(primitives, tmp_path / f"here{suffix}")
    code = (
        "import sys, time; time.time = lambda: 0.0; time.localtime = lambda *a: time.gmtime(0)\n"
        "from fit import export; export.write(export.read(sys.argv[1]), sys.argv[2])"
    )
    there = tmp_path / f"there{suffix}"
    environment = os.environ | {"PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo"}
    environment["PYTHONPATH"] = os.pathsep.join(p for p in sys.path if p)
    subprocess.run(
        [sys.executable, "-c", code, tmp_path / "set.npz", there], check=True, env=environment, cwd=tmp_path
    )
    assert there.read_bytes() == (tmp_path / f"here{suffix}").read_bytes()


@pytest.mark.parametrize("suffix", [".npz", ".glb", ".usda", ".wgsl"])
def test_an_invalid_set_is_refused_and_leaves_the_old_file(tmp_path, suffix):
    path = tmp_path / f"set{suffix}"
    export.write(make_box(), path)
    before = path.read_bytes()
    broken = make_box()
    broken.sizes[0, 0] = -1
    with pytest.raises(ValueError, match="primitive 0, box: sizes"):
        export.write(broken, path)
    assert path.read_bytes() == before


def test_a_failed_write_leaves_no_half_file(tmp_path, monkeypatch):
    path = tmp_path / "set.npz"
    export.write(make_box(), path)
    before = path.read_bytes()

    def full_disk(*_):
        raise OSError("no space left")

    monkeypatch.setattr(os, "replace", full_disk)
    with pytest.raises(OSError, match="no space left"):
        export.write(make_sphere(), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["set.npz"]


def test_suffixes_that_are_none_are_named(tmp_path):
    with pytest.raises(export.FormatError, match=r"set\.obj: suffix: .*\.npz, \.glb, \.usda, \.wgsl"):
        export.write(make_box(), tmp_path / "set.obj")
    with pytest.raises(export.FormatError, match=r"can't be read; use a \.npz"):
        export.read(tmp_path / "set.usda")
    with pytest.raises(FileNotFoundError):
        export.read(tmp_path / "none.npz")


def archive(**changes) -> bytes:
    """A written set of one box with entries replaced, or left out for None."""
    box = make_box()
    entries = {name: getattr(box, name) for name in FIELDS} | {
        "format": np.array("sdfprim"),
        "version": np.array(1),
        "names": np.frombuffer(b"[]", np.uint8),
    }
    content = io.BytesIO()
    np.savez(content, **{k: v for k, v in (entries | changes).items() if v is not None})
    return content.getvalue()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "archive: is no whole .npz"),
        (b"PK\x03\x04 nonsense", "archive: is no whole .npz"),
        (archive()[:-300], "archive: is no whole .npz"),
        (archive(sizes=None, names=None), "has no names, sizes; it is no primitive set"),
        (archive(version=np.array(2)), "version: is sdfprim 2; this program reads sdfprim 1"),
        (archive(format=np.array("other")), "version: is other 1"),
        (archive(names=np.frombuffer(b'{"a": 1}', np.uint8)), "names: is no list of strings"),
        (archive(names=np.frombuffer(b"[", np.uint8)), "arrays: hold no valid set"),
        (archive(sizes=np.ones((2, 3))), r"arrays: hold no valid set: sizes is float64 \(2, 3\)"),
        (archive(sizes=np.zeros((1, 3))), "arrays: hold no valid set: primitive 0, box: sizes"),
        (archive(kinds=np.array(["box"], object)), "arrays: hold no valid set: Object arrays"),
    ],
)
def test_broken_archives_are_named_errors(tmp_path, content, message):
    path = tmp_path / "set.npz"
    path.write_bytes(content)
    with pytest.raises(export.FormatError, match=message) as error:
        export.read(path)
    assert str(error.value).startswith(str(path))


def test_an_archive_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("fit.export.npz.LARGEST_ARRAY", 1 << 20)
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as bomb:
        bomb.writestr("kinds.npy", b"\0" * (2 << 20))
    assert path.stat().st_size < 10_000
    with pytest.raises(export.FormatError, match=r"kinds\.npy: claims"):
        export.read(path)


def test_arrays_have_their_own_names_in_the_archive(tmp_path):
    """Other programs read the file with NumPy alone, as docs/formats.md says."""
    export.write(make_plane(name="sheet"), tmp_path / "set.npz")
    with np.load(tmp_path / "set.npz") as arrays:
        assert set(arrays) == {"format", "version", "names", *FIELDS}
        assert arrays["kinds"].tolist() == [Kind.PLANE] and int(arrays["version"]) == 1
        assert json.loads(arrays["names"].tobytes()) == ["sheet"]
