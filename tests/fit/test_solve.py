"""The fit of whole scenes: what it must find, keep free, colour and leave out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fit.primitives import Kind, PrimitiveSet
from fit.scene import Camera, Instance, Material, Mesh, Node, Scene
from fit.sdf import distance, union_distance
from fit.solve import Fit, FitSettings, fit

QUICK = FitSettings(resolution=90)


GREY = Material(base_color=(0.5, 0.5, 0.5, 1.0))


@dataclass(frozen=True)
class Item:
    """A mesh with a plain material, and where it stands."""

    mesh: trimesh.Trimesh
    material: Material = GREY
    world_from_local: np.ndarray | None = None
    name: str = "item"


def scene_of(items: Sequence[Item], cameras: Sequence[Sequence[float]] = ()) -> Scene:
    """One node, mesh and material for each item; cameras are positions."""
    meshes, materials, nodes, instances = [], [], [], []
    for i, item in enumerate(items):
        matrix = np.eye(4) if item.world_from_local is None else item.world_from_local
        vertices = np.asarray(item.mesh.vertices, np.float64).copy()
        triangles = np.asarray(item.mesh.faces, np.uint32).copy()
        meshes.append(Mesh(item.name, vertices, np.zeros_like(vertices), triangles, i))
        materials.append(item.material)
        nodes.append(Node(item.name, -1, matrix, matrix))
        instances.append(Instance(i, i, matrix))
    places = [Camera(f"camera {k}", moved_by(c), yfov=1.0) for k, c in enumerate(cameras)]
    return Scene(
        Path("made.glb"), tuple(meshes), tuple(materials), nodes=tuple(nodes), instances=tuple(instances),
        cameras=tuple(places),
    )  # fmt: skip


def moved_by(offset: Sequence[float]) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


def turned(axis: Sequence[float], angle: float, offset: Sequence[float] = (0, 0, 0)) -> np.ndarray:
    matrix = trimesh.transformations.rotation_matrix(angle, axis)
    matrix[:3, 3] = offset
    return matrix


def box(size: Sequence[float], center: Sequence[float] = (0, 0, 0)) -> trimesh.Trimesh:
    return trimesh.creation.box(size, moved_by(center))


def sheet(corners: Sequence[Sequence[float]]) -> trimesh.Trimesh:
    return trimesh.Trimesh(np.array(corners, float), [[0, 1, 2], [0, 2, 3]], process=False)


def room(size: Sequence[float], center: Sequence[float] = (0, 0, 0)) -> trimesh.Trimesh:
    """Six sheets that face inwards."""
    walls = box(size, center)
    walls.invert()
    return walls


def bytes_of(primitives: PrimitiveSet) -> bytes:
    arrays = ("kinds", "positions", "rotations", "sizes", "albedo", "emission")
    return b"".join(getattr(primitives, name).tobytes() for name in arrays)


TABLE = [
    ((2.0, 0.1, 1.2), (0, 1.05, 0)),
    *[((0.1, 1.0, 0.1), (x, 0.5, z)) for x in (-0.9, 0.9) for z in (-0.5, 0.5)],
]


@pytest.fixture(scope="module")
def table() -> Fit:
    """Five boxes in one mesh of one node, turned in space."""
    joined = trimesh.util.concatenate([box(size, center) for size, center in TABLE])
    return fit(scene_of([Item(joined, world_from_local=turned((1, 2, 3), 0.7, (5, -3, 2)))]), QUICK)


def test_table_of_five_boxes_is_five_boxes(table: Fit) -> None:
    primitives = table.primitives
    assert len(primitives) == 5
    assert set(primitives.kinds) == {Kind.BOX}
    expected = sorted(np.prod(size) for size, _ in TABLE)
    np.testing.assert_allclose(sorted(np.prod(primitives.sizes, axis=1)), expected, rtol=1e-4)
    world = np.array([turned((1, 2, 3), 0.7, (5, -3, 2)) @ [*center, 1] for _, center in TABLE])[:, :3]
    gaps = np.linalg.norm(primitives.positions[:, None] - world[None], axis=2)
    assert gaps.min(axis=0).max() < 1e-5


def test_table_meets_its_mesh(table: Fit) -> None:
    assert table.metrics.surface_to_set_max_m < 1e-5
    assert table.metrics.false_solid == 0
    assert table.metrics.leaks == 0


def test_six_mixed_primitives_are_found_exactly() -> None:
    cylinder = trimesh.creation.cylinder(0.4, 2.0, sections=32)
    items = [
        Item(box((1, 2, 1), (-4, 0, 0))),
        Item(box((2, 0.5, 1)), world_from_local=turned((0, 1, 0), 0.5, (-1, 0, 0))),
        Item(trimesh.creation.icosphere(3, 0.7), world_from_local=moved_by((2, 0, 0))),
        Item(trimesh.creation.uv_sphere(0.5, count=[24, 24]), world_from_local=moved_by((4, 0, 0))),
        Item(cylinder, world_from_local=turned((1, 0, 0), np.pi / 2, (6, 0, 0))),
        Item(cylinder, world_from_local=turned((1, 1, 0), 0.9, (9, 0, 0))),
    ]
    primitives = fit(scene_of(items), QUICK).primitives
    order = np.argsort(primitives.positions[:, 0])
    assert [Kind(k).name for k in primitives.kinds[order]] == [
        "BOX",
        "BOX",
        "SPHERE",
        "SPHERE",
        "CYLINDER",
        "CYLINDER",
    ]
    np.testing.assert_allclose(primitives.positions[order, 0], [-4, -1, 2, 4, 6, 9], atol=1e-4)
    np.testing.assert_allclose(
        primitives.sizes[order[2:]], [[1.4] * 3, [1.0] * 3, [0.8, 2, 0.8], [0.8, 2, 0.8]], rtol=1e-4
    )


def test_sealed_room_is_closed_and_free_inside() -> None:
    result = fit(scene_of([Item(room((4, 3, 5)))], cameras=[(0, 0, 0)]), QUICK)
    assert len(result.primitives) == 6
    assert result.metrics.leaks == 0
    assert result.metrics.blocked == 0
    free, _ = union_distance(result.primitives, np.array([[0.0, 0, 0], [1.9, 1.4, 2.4]]))
    np.testing.assert_allclose(free, [1.5, 0.1], atol=0.02)
    outwards = np.random.default_rng(0).normal(size=(2000, 3))
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    assert stops(result.primitives, np.zeros(3), outwards).all()


def stops(primitives: PrimitiveSet, origin: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Which rays meet the set, by sphere tracing out to 20 m."""
    along = np.zeros(len(directions))
    for _ in range(200):
        step, _ = union_distance(primitives, origin + along[:, None] * directions)
        along += np.maximum(step, 0)
    return along < 20


def test_wall_between_two_rooms_is_as_thick_as_it_is() -> None:
    thickness = 0.3
    left, right = (
        room((3, 2.5, 4), (-1.5 - thickness / 2, 0, 0)),
        room((3, 2.5, 4), (1.5 + thickness / 2, 0, 0)),
    )
    scene = scene_of([Item(trimesh.util.concatenate([left, right]))], cameras=[(-1.5, 0, 0), (1.5, 0, 0)])
    result = fit(scene, QUICK)
    assert len(result.air.spaces) == 2
    assert result.metrics.leaks == 0
    across = np.stack([np.linspace(-1.5, 1.5, 601), np.zeros(601), np.zeros(601)], axis=1)
    solid = union_distance(result.primitives, across)[0] <= 0
    wall = across[solid, 0]
    assert wall.min() == pytest.approx(-thickness / 2, abs=0.02)
    assert wall.max() == pytest.approx(thickness / 2, abs=0.02)


def test_curtain_with_air_on_both_sides_is_a_plane() -> None:
    floor = sheet([(-3, 0, -3), (-3, 0, 3), (3, 0, 3), (3, 0, -3)])
    curtain = sheet([(-1, 0.5, 0.2), (1, 0.5, 0.2), (1, 2.5, 0.2), (-1, 2.5, 0.2)])
    cloth = Material(double_sided=True)
    result = fit(scene_of([Item(floor, cloth, name="floor"), Item(curtain, cloth, name="curtain")]), QUICK)
    primitives = result.primitives
    assert sorted(Kind(k) for k in primitives.kinds) == [Kind.PLANE, Kind.PLANE]
    hung = int(np.argmax(primitives.positions[:, 1]))
    assert primitives.sizes[hung, 1] <= 0.05 * 2.0
    np.testing.assert_allclose(primitives.positions[hung], (0, 1.5, 0.2), atol=0.02)
    np.testing.assert_allclose(primitives.sizes[hung, [0, 2]], (2, 2), atol=0.05)


def blob() -> trimesh.Trimesh:
    """A lumpy closed body without any flat or exactly round part."""
    mesh = trimesh.creation.icosphere(4)
    x, y, z = mesh.vertices.T
    swell = 1 + 0.25 * np.sin(2.2 * x + 1) * np.cos(1.7 * y) + 0.15 * np.sin(3.1 * z)
    mesh.vertices = mesh.vertices * swell[:, None] * [1.4, 1.0, 0.8]
    return mesh


@pytest.fixture(scope="module")
def blobs() -> dict[int, Fit]:
    """The blob at rising budgets."""
    scene = scene_of([Item(blob())])
    return {count: fit(scene, replace(QUICK, max_primitives=count)) for count in (1, 8, 24)}


def test_larger_budgets_are_never_worse(blobs: dict[int, Fit]) -> None:
    assert all(len(f.primitives) <= count for count, f in blobs.items())
    surface = [f.metrics.surface_to_set_mean_m for f in blobs.values()]
    air = [f.metrics.air_distance_error_m for f in blobs.values()]
    for errors in (surface, air):
        assert all(after <= 1.02 * before for before, after in pairwise(errors)), errors
    assert surface[-1] < 0.4 * surface[0]


def test_free_form_body_is_filled(blobs: dict[int, Fit]) -> None:
    metrics = blobs[24].metrics
    assert metrics.iou is not None and metrics.iou > 0.88
    assert metrics.false_solid < 0.001
    assert metrics.covered_half_pct > 0.5


def test_same_input_gives_same_bytes(blobs: dict[int, Fit]) -> None:
    again = fit(scene_of([Item(blob())]), replace(QUICK, max_primitives=8))
    assert bytes_of(again.primitives) == bytes_of(blobs[8].primitives)


def test_small_parts_are_skipped_and_listed() -> None:
    items = [Item(box((4, 1, 4)), name="block"), Item(box((0.02, 0.02, 0.02), (0, 0.6, 0)), name="crumb")]
    result = fit(scene_of(items), QUICK)
    assert [part["name"] for part in result.skipped_parts] == ["crumb"]
    assert 0 <= result.skipped_parts[0]["projected_area_share"] < 0.001
    assert len(result.primitives) == 1
    kept = fit(scene_of(items), replace(QUICK, skip_below=0.0))
    assert kept.skipped_parts == []


@pytest.mark.parametrize(
    ("settings", "count"),
    [({"max_bytes": 3 * 64 + 63}, 3), ({"max_primitives": 2}, 2), ({"max_bytes": 64}, 1)],
)
def test_caps_hold(settings: dict[str, int], count: int) -> None:
    joined = trimesh.util.concatenate([box(size, center) for size, center in TABLE])
    assert len(fit(scene_of([Item(joined)]), replace(QUICK, **settings)).primitives) == count


def test_max_error_ends_the_growth(blobs: dict[int, Fit]) -> None:
    scene = scene_of([Item(blob())])
    loose = fit(scene, replace(QUICK, max_error=0.25))
    assert not any("not reached" in note for note in loose.notes)
    assert loose.metrics.surface_to_set_p95_m < 0.26
    assert len(loose.primitives) < len(blobs[24].primitives)
    impossible = fit(scene, replace(QUICK, max_error=1e-9, max_primitives=1, steps=("growing",)))
    assert any("not reached" in note for note in impossible.notes)


@pytest.mark.parametrize(
    "settings", [{"preset": "medium"}, {"max_primitives": 0}, {"max_bytes": 63}, {"max_error": -1.0}]
)
def test_senseless_settings_are_refused(settings: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(settings))):
        FitSettings(**settings)  # type: ignore[arg-type]


def test_thin_wall_keeps_the_colour_of_each_side() -> None:
    red, white = Material(base_color=(0.8, 0.1, 0.1, 1)), Material(base_color=(0.9, 0.9, 0.9, 1))
    front = sheet([(-2, -1, 0.02), (2, -1, 0.02), (2, 1, 0.02), (-2, 1, 0.02)])
    back = sheet([(-2, -1, -0.02), (-2, 1, -0.02), (2, 1, -0.02), (2, -1, -0.02)])
    scene = scene_of([Item(front, red), Item(back, white)])
    primitives = fit(scene, replace(QUICK, max_primitives=1)).primitives
    assert len(primitives) == 1, "one wall carries both colours"
    for point, color in (((0, 0, 0.5), (0.8, 0.1, 0.1)), ((0, 0, -0.5), (0.9, 0.9, 0.9))):
        nearest = int(distance(primitives, np.array([point]))[0].argmin())
        matrix = primitives.rotation_matrices()[nearest]
        local = matrix.T @ np.sign(point)
        axis = int(np.abs(local).argmax())
        face = 2 * axis + int(local[axis] < 0)
        np.testing.assert_allclose(primitives.albedo[nearest, face], color, atol=0.02)


def test_lamp_in_a_wall_keeps_its_own_primitive() -> None:
    lamp = Material(base_color=(0, 0, 0, 1), emission=(10.0, 8.0, 6.0))
    panel = sheet([(-0.2, 1.49, -0.2), (0.2, 1.49, -0.2), (0.2, 1.49, 0.2), (-0.2, 1.49, 0.2)])
    scene = scene_of([Item(room((4, 3, 4))), Item(panel, lamp, name="lamp")], cameras=[(0, 0, 0)])
    primitives = fit(scene, replace(QUICK, preset="coarse")).primitives
    lit = np.flatnonzero(primitives.emission.max(axis=(1, 2)) > 0)
    assert len(lit) == 1
    np.testing.assert_allclose(primitives.positions[lit[0]], (0, 1.49, 0), atol=0.02)
    np.testing.assert_allclose(np.sort(primitives.sizes[lit[0]])[1:], (0.4, 0.4), atol=0.02)
    np.testing.assert_allclose(primitives.emission[lit[0]].max(axis=0), (10, 8, 6), rtol=0.03)


def test_closing_adds_no_primitives_where_few_are_good_enough() -> None:
    angles = np.linspace(0, np.pi, 9)
    arch = [(4 + 1.8 * np.sin(angle), 4 - 4 * np.cos(angle)) for angle in angles]
    vault = [sheet([(0, y, z), (0, b, c), (9, b, c), (9, y, z)]) for (y, z), (b, c) in pairwise(arch)]
    floor = sheet([(0, 0, 0), (0, 0, 8), (9, 0, 8), (9, 0, 0)])
    scene = scene_of([Item(mesh) for mesh in (floor, *vault)])
    settings = replace(QUICK, max_error=0.2)
    grown = fit(scene, replace(settings, steps=settings.steps[:-1]))
    assert len(fit(scene, settings).primitives) <= len(grown.primitives)


def test_stages_are_reported_in_order() -> None:
    calls: list[tuple[str, float]] = []
    result = fit(scene_of([Item(box((1, 1, 1)))]), QUICK, progress=lambda *call: calls.append(call))
    stages = list(dict.fromkeys(name for name, _ in calls))
    assert stages == ["air", "samples", "parts", "build", "close", "color", "measure"] == list(result.seconds)
    assert all(0 <= fraction <= 1 for _, fraction in calls)


HARD = {
    "one triangle": trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False),
    "flat": trimesh.creation.annulus(0.5, 1.0, 1e-9),
    "needle": box((10, 1e-3, 1e-3)),
    "doubled faces": trimesh.util.concatenate([box((1, 2, 3)), box((1, 2, 3))]),
    "inside out": room((1, 2, 3)),
    "tiny": box((1e-4, 2e-4, 1e-4)),
    "huge": box((1e5, 2e5, 1e5)),
    "far": box((1, 2, 1), (1e6, -1e6, 1e6)),
}


@pytest.mark.parametrize("name", HARD)
def test_hard_meshes_give_finite_sets_near_them(name: str) -> None:
    mesh = HARD[name]
    result = fit(scene_of([Item(mesh)]), QUICK)
    primitives = result.primitives
    assert len(primitives) >= 1
    assert all(
        np.isfinite(getattr(primitives, a)).all() for a in ("positions", "rotations", "sizes", "albedo")
    )
    primitives.validate()
    size = float(np.linalg.norm(mesh.extents))
    assert result.metrics.surface_to_set_mean_m < 0.01 * size


def test_scene_without_walls_is_refused() -> None:
    glass = Material(transmission=1.0)
    with pytest.raises(ValueError, match="nothing to fit"):
        fit(scene_of([Item(box((1, 1, 1)), glass)]), QUICK)
