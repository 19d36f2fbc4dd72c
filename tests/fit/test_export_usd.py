"""The USD export: its text holds the set's places, shapes and colours."""

from __future__ import annotations

import re

import numpy as np
import pytest

from fit import export, rotation
from fit.primitives import (
    PrimitiveSet,
    make_box,
    make_cylinder,
    make_half_space,
    make_plane,
    make_sphere,
)


@pytest.fixture(scope="module")
def primitives() -> PrimitiveSet:
    rng = np.random.default_rng(0)
    turns = rotation.normalized(rng.normal(size=(3, 4)))
    return PrimitiveSet.concatenate(
        [
            make_box((1, 2, 3), (4, 5, 6), turns[0], (0.1, 0.2, 0.3), (7, 8, 9), 'the "door"'),
            make_box((0, 0, 0.1), (1, 1, 2), turns[1], rng.random((6, 3))),
            make_sphere((0, 1, 0), 0.25),
            make_cylinder(radius=0.5, height=3),
            make_plane(size_x=2, size_z=3, thickness=0.01, rotation=turns[2], albedo=rng.random((6, 3))),
            make_half_space((0, -1, 0)),
        ]
    )


@pytest.fixture(scope="module")
def text(primitives, tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("usd") / "set.usda"
    export.write(primitives, path)
    return path.read_text()


def vectors(text: str, name: str) -> np.ndarray:
    """Every value of a tuple-valued attribute, one row for each time it stands there."""
    found = re.findall(rf"^ *\w+ {re.escape(name)} = \((.*)\)$", text, re.MULTILINE)
    return np.array([[float(v) for v in row.split(",")] for row in found])


def blocks(text: str) -> list[str]:
    """The text of each prim below the root."""
    return re.split(r"\n    (?=def )", text)[1:]


def test_the_stage_says_its_units_and_axes(text):
    assert text.startswith("#usda 1.0\n")
    assert "metersPerUnit = 1\n" in text and 'upAxis = "Y"' in text and 'defaultPrim = "Primitives"' in text
    assert text.count("{") == text.count("}") and text.count("[") == text.count("]")


def test_each_kind_has_its_prim(text):
    types = re.findall(r'^    def (\w+) "(\w+)"', text, re.MULTILINE)
    assert types == [
        ("Cube", "box_0000"),
        ("Mesh", "box_0001"),
        ("Sphere", "sphere_0002"),
        ("Cylinder", "cylinder_0003"),
        ("Mesh", "plane_0004"),
        ("Mesh", "half_space_0005"),
    ]
    assert '"the \\"door\\""' in text
    assert 'uniform token axis = "Y"' in blocks(text)[3]


def test_places_are_exact(text, primitives):
    np.testing.assert_array_equal(vectors(text, "xformOp:translate"), primitives.positions)
    np.testing.assert_array_equal(vectors(text, "xformOp:orient"), primitives.rotations[:, [3, 0, 1, 2]])
    scale = vectors(text, "xformOp:scale")
    np.testing.assert_array_equal(scale[:5], primitives.sizes[:5])
    lower, upper = primitives.bounds()
    np.testing.assert_allclose(
        scale[5], [2 * np.linalg.norm(upper - lower), 1, 2 * np.linalg.norm(upper - lower)]
    )


def test_colours_are_per_face_where_faces_differ(text, primitives):
    shown = [re.search(r"displayColor = \[(.*)\] \(\n *interpolation = \"(\w+)\"", b) for b in blocks(text)]
    assert [s.group(2) for s in shown] == [
        "constant",
        "uniform",
        "constant",
        "constant",
        "uniform",
        "uniform",
    ]
    box = np.array([[float(v) for v in c.split(",")] for c in re.findall(r"\(([^)]*)\)", shown[1].group(1))])
    np.testing.assert_array_equal(box.astype(np.float32), np.repeat(primitives.albedo[1], 2, axis=0))
    glow = re.search(r"sdfprim:emission = \[(.*)\]", blocks(text)[0]).group(1)
    assert glow == ", ".join(["(7.0, 8.0, 9.0)"] * 6)


def test_face_meshes_point_outwards(text):
    """A box's triangles, wound counter-clockwise, enclose its volume of 1."""
    block = blocks(text)[1]
    points = np.array(
        [
            [float(v) for v in p.split(",")]
            for p in re.findall(r"\(([^)]*)\)", re.search(r"points = \[(.*)\]", block)[1])
        ]
    )
    indices = [int(i) for i in re.search(r"faceVertexIndices = \[(.*)\]", block)[1].split(",")]
    a, b, c = np.moveaxis(points[indices].reshape(-1, 3, 3), 1, 0)
    assert np.sum(np.cross(a, b) * c) / 6 == pytest.approx(1)
