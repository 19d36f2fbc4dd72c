"""A mesh that is a union of primitives comes back as those primitives."""

from __future__ import annotations

from collections import Counter

import manifold3d
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from fit import gltf
from fit.explain import explain
from fit.facets import find_facets, find_patches
from fit.primitives import Kind
from fit.shapes import Shapes, join, make_shapes, to_primitives
from fit.solve import FitSettings, fit
from fit.volume import primitive_solid

Part = tuple[Kind, np.ndarray, np.ndarray, np.ndarray, int]
"""Kind, centre (3,), frame (3, 3), half extents (3,), segments."""


def box(center, size) -> Part:
    return Kind.BOX, np.array(center, float), np.eye(3), np.array(size, float) / 2, 4


def cylinder(center, radius, height, segments=32) -> Part:
    return Kind.CYLINDER, np.array(center, float), np.eye(3), np.array([radius, height / 2, radius]), segments


def sphere(center, radius, segments=32) -> Part:
    return Kind.SPHERE, np.array(center, float), np.eye(3), np.full(3, float(radius)), segments


def turned(parts: list[Part]) -> list[Part]:
    turn = Rotation.from_euler("xyz", [20, 50, -10], degrees=True).as_matrix()
    return [(kind, turn @ c, turn @ frame, halves, n) for kind, c, frame, halves, n in parts]


def random_parts(seed: int, count: int | None = None, segments=(8, 16, 32, 64)) -> list[Part]:
    """1 to 30 primitives, dense enough to overlap or not, half of the scenes mostly along the axes."""
    rng = np.random.default_rng(seed)
    count = count or int(rng.integers(1, 31))
    aligned, spread = rng.random() < 0.5, rng.uniform(0.5, 2.5) * count ** (1 / 3)
    parts = []
    for _ in range(count):
        kind = (Kind.BOX, Kind.SPHERE, Kind.CYLINDER)[rng.integers(3)]
        turn = Rotation.random(random_state=int(rng.integers(1 << 31))).as_matrix()
        frame = np.eye(3) if aligned and rng.random() < 0.8 else turn
        radius, half = rng.uniform(0.15, 0.6), rng.uniform(0.1, 0.9)
        halves = {
            Kind.BOX: rng.uniform(0.1, 0.8, 3),
            Kind.SPHERE: np.full(3, radius),
            Kind.CYLINDER: np.array([radius, half, radius]),
        }[kind]
        center = rng.uniform(-spread / 2, spread / 2, 3)
        parts.append((kind, center, frame, halves, int(rng.choice(segments))))
    return parts


def solid_of(part: Part) -> manifold3d.Manifold:
    kind, center, frame, halves, segments = part
    if kind is Kind.BOX:
        solid = manifold3d.Manifold.cube(tuple(2 * halves), True)
    elif kind is Kind.SPHERE:
        solid = manifold3d.Manifold.sphere(halves[0], segments)
    else:
        upright = manifold3d.Manifold.cylinder(2 * halves[1], halves[0], halves[0], segments, True)
        solid = upright.rotate((-90, 0, 0))
    return solid.transform(np.column_stack([frame, center]))


def union_of(parts: list[Part]) -> tuple[np.ndarray, np.ndarray]:
    """One mesh around all parts, in float32 as files hold it."""
    mesh = manifold3d.Manifold.batch_boolean([solid_of(p) for p in parts], manifold3d.OpType.Add).to_mesh64()
    return np.array(mesh.vert_properties)[:, :3].astype(np.float32), np.array(mesh.tri_verts).astype(
        np.uint32
    )


def shells_of(parts: list[Part]) -> tuple[np.ndarray, np.ndarray]:
    """A shell for each part, overlapping or not, as other modellers tessellate them."""
    shells = []
    for kind, center, frame, halves, segments in parts:
        if kind is Kind.BOX:
            shell = trimesh.creation.box(2 * halves)
        elif kind is Kind.SPHERE:
            shell = trimesh.creation.uv_sphere(halves[0], count=[segments // 2, segments])
        else:
            upright = trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0))
            shell = trimesh.creation.cylinder(halves[0], 2 * halves[1], sections=segments)
            shell.apply_transform(upright)
        place = np.eye(4)
        place[:3, :3], place[:3, 3] = frame, center
        shells.append(shell.apply_transform(place))
    mesh = trimesh.util.concatenate(shells)
    return mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32)


def shapes_of(parts: list[Part]) -> Shapes:
    return join([make_shapes(kind, c[None], frame, halves[None]) for kind, c, frame, halves, _ in parts])


def kinds_of(shapes: Shapes) -> Counter[Kind]:
    return Counter(Kind(kind) for kind in shapes.kinds)


def overlap(found: Shapes, parts: list[Part]) -> float:
    """Intersection over union of two sets of true primitives."""
    true = shapes_of(parts)
    center, scale = true.centers.mean(axis=0), float(np.ptp(true.centers, axis=0).max() + true.halves.max())
    first, second = (primitive_solid(to_primitives(s), center, scale) for s in (true, found))
    common = (first ^ second).volume()
    return common / (first.volume() + second.volume() - common)


def required(parts: list[Part]) -> Counter[Kind]:
    """Kinds of the parts that must come back: they show 5 % of their area, and 0.1 % of the union."""
    solids = [solid_of(p) for p in parts]
    whole = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add)
    kinds: Counter[Kind] = Counter()
    for i, solid in enumerate(solids):
        rest = manifold3d.Manifold.batch_boolean(solids[:i] + solids[i + 1 :], manifold3d.OpType.Add)
        # area(solid - rest) = shown + covered of rest; area(whole) - area(rest) = shown - covered of rest.
        shown = ((solid - rest).surface_area() + whole.surface_area() - rest.surface_area()) / 2
        matters = whole.volume() - rest.volume() >= 1e-3 * whole.volume()
        kinds[parts[i][0]] += bool(matters and shown >= 0.05 * solid.surface_area())
    return kinds


def check(parts: list[Part], vertices: np.ndarray, faces: np.ndarray) -> None:
    found = explain(vertices[faces].astype(np.float64)).shapes
    assert overlap(found, parts) >= 0.998
    if kinds_of(found) != kinds_of(shapes_of(parts)):
        assert required(parts) <= kinds_of(found) <= kinds_of(shapes_of(parts))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("make", [union_of, shells_of])
def test_random_primitives_come_back(make, seed: int) -> None:
    parts = random_parts(seed)
    check(parts, *make(parts))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 300))
@pytest.mark.parametrize("make", [union_of, shells_of])
def test_many_random_primitives_come_back(make, seed: int) -> None:
    parts = random_parts(seed, segments=(8, 16, 32, 64, 128))
    check(parts, *make(parts))


LEGS = [box((x, 0.36, z), (0.1, 0.75, 0.1)) for x in (-0.75, 0.75) for z in (-0.4, 0.4)]
FLUSH = {
    "table": [box((0, 0.735, 0), (1.6, 0.05, 0.9)), *LEGS],
    "boxes on the ground": [
        box((0, 0.5, 0), (1, 1, 1)),
        box((0.6, 0.3, 0.4), (1, 0.6, 1)),
        box((-0.7, 0.2, 0.3), (1, 0.4, 0.5)),
    ],
    "mixed on the ground": [
        box((0, 0.5, 0), (1, 1, 1)),
        cylinder((0.6, 0.3, 0.4), 0.4, 0.6),
        cylinder((-0.6, 0.25, -0.3), 0.3, 0.5),
        sphere((0.2, 0.9, 0.1), 0.4),
    ],
    "corner": [box((0, 0.5, 0), (2, 1, 0.2)), box((0.9, 0.5, 0.5), (0.2, 1, 1.2))],
}


@pytest.mark.parametrize("name", FLUSH)
@pytest.mark.parametrize("place", [list, turned])
def test_flush_faces_are_told_apart(place, name: str) -> None:
    parts = place(FLUSH[name])
    check(parts, *union_of(parts))


def test_a_hidden_middle_is_one_primitive() -> None:
    """A rod through a box shows two ends, a bar across it two pieces; each is one."""
    parts = [box((0, 0, 0), (1, 1, 1)), cylinder((0.1, 0, 0.2), 0.2, 3), box((0, 0.1, 0), (4, 0.3, 0.4))]
    found = explain(np.asarray(union_of(parts)[0])[union_of(parts)[1]].astype(np.float64)).shapes
    assert kinds_of(found) == {Kind.BOX: 2, Kind.CYLINDER: 1}
    assert overlap(found, parts) > 1 - 1e-6


def test_two_rods_on_one_axis_stay_two() -> None:
    rods = [cylinder((0, height, 0), 0.2, 1) for height in (0.5, 2.5)]
    slab, beam = box((0, 0, 0), (3, 0.2, 3)), box((0, 2.6, 0), (3, 0.2, 0.2))
    parts = [slab, beam, box((1.2, 1.3, 0), (0.1, 2.8, 0.1)), *rods]
    vertices, faces = union_of(parts)
    assert kinds_of(explain(vertices[faces].astype(float)).shapes) == {Kind.BOX: 3, Kind.CYLINDER: 2}


def test_boxes_that_touch_in_a_face_are_two_shells() -> None:
    """Welded, their common edges have four triangles; each wedge of solid is a box's own."""
    lower, upper = trimesh.creation.box((1, 1, 1)), trimesh.creation.box((1, 2, 1))
    upper.apply_translation((0, 1.5, 0))
    mesh = trimesh.util.concatenate([lower, upper])
    found = explain(mesh.vertices[mesh.faces]).shapes
    np.testing.assert_allclose(sorted(found.volumes()), [1, 2], rtol=1e-6)


def test_missing_slivers_leave_a_shell_closed() -> None:
    """A collinear triangle that a loader has dropped leaves a T-junction, not a hole."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    triangles = trimesh.convex.convex_hull(corners).triangles
    first = triangles[0]
    middle = first[:2].mean(axis=0)
    split = np.array([[first[0], middle, first[2]], [middle, first[1], first[2]]])
    found = explain(np.concatenate([split, triangles[1:]]))
    assert len(found.shapes) == 1
    assert (found.of_triangle == 0).all()


def test_coarse_tessellations_keep_the_radius() -> None:
    """Eight segments: vertices and ridges lie at the radius, so it is exact, far within the sagitta."""
    parts = [cylinder((0, 0, 0), 0.5, 2, 8), sphere((0.9, 0.7, 0), 0.6, 8)]
    vertices, faces = union_of(parts)
    found = explain(vertices[faces].astype(float)).shapes
    assert kinds_of(found) == {Kind.CYLINDER: 1, Kind.SPHERE: 1}
    np.testing.assert_allclose(sorted(found.halves[:, 0]), [0.5, 0.6], atol=1e-5)


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.annulus(0.5, 1, 1),
        trimesh.creation.cone(1, 2),
        trimesh.creation.capsule(),
        trimesh.PointCloud([v for v in trimesh.creation.icosphere(3).vertices if v[2] > -1e-9]).convex_hull,
        trimesh.creation.torus(1, 0.3),
    ],
)
def test_other_meshes_are_not_explained(mesh: trimesh.Trimesh) -> None:
    assert len(explain(np.asarray(mesh.triangles)).shapes) == 0


def test_patches_of_a_cross_are_its_two_bars() -> None:
    vertices, faces = union_of([box((0, 0, 0), (3, 1, 1)), box((0, 0.1, 0), (1.2, 0.9, 3))])
    facets = find_facets(vertices[faces].astype(float), 5e-7)
    areas = np.bincount(find_patches(facets), facets.areas)
    assert (areas > 0.01).sum() == 2


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("table", {"box": 5}),
        ("six_solids", {"box": 2, "sphere": 2, "cylinder": 2}),
        ("colonnade", {"box": 14, "cylinder": 6}),
    ],
)
def test_bundled_scenes_of_primitives(bundled_assets, name: str, kinds: dict[str, int]) -> None:
    scene = gltf.load(bundled_assets / f"{name}.glb")
    result = fit(scene)
    assert Counter(Kind(kind).name.lower() for kind in result.primitives.kinds) == kinds
    assert result.metrics.iou > 0.998


@pytest.mark.slow
def test_a_budget_below_the_count_is_kept(bundled_assets) -> None:
    result = fit(gltf.load(bundled_assets / "table.glb"), FitSettings(max_primitives=4))
    assert len(result.primitives) <= 4
