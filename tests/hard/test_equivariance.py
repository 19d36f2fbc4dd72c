"""The same scene elsewhere, larger, turned or mirrored gives the same set there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np
import pytest

from fit.air import LostSeed
from fit.canonical import STEP, Pose, find_pose, moved_scene, to_canonical, world_primitives
from fit.measure import Metrics, measure
from fit.primitives import PrimitiveSet
from fit.scene import Camera, Scene
from fit.solve import Fit, FitSettings, find_scene_air, fit
from fit.surface import from_scene

QUICK = FitSettings(resolution=60, max_primitives=4)

SEED = (1.9, 0.4, -1.5)
"""A point of the furnished room's air, that no axis of symmetry goes through."""

WITHIN, WITHIN_TURNED = 0.01, 0.05
"""Relative changes that an error may show: after moves, mirroring and scale; after a rotation."""

FLOOR, FLOOR_TURNED = 1e-7, 2e-4
"""Changes that never count, as shares of the diagonal."""

RAY_NOISE = 0.012
"""Of shares of 20,000 rays: rays that are drawn anew, in the world's axes, differ by so much at most."""

ERRORS = ("surface_to_set_mean_m", "set_to_surface_mean_m", "air_distance_error_m")


@dataclass(frozen=True)
class Home:
    """A scene where it was made, its fit there, and whether its air is given by a seed."""

    make: Callable[[np.ndarray], Scene]
    fit: Fit
    seeded: bool


@pytest.fixture(scope="module")
def homes(meshes: ModuleType) -> Callable[[str], Home]:
    """Fits of the named meshes where they were made, each once."""
    known: dict[str, Home] = {}

    def home(name: str) -> Home:
        if name not in known:
            mesh, seeded = getattr(meshes, name)(), name == "furnished_room"

            def make(matrix: np.ndarray) -> Scene:
                return meshes.scene_of(mesh, matrix)

            settings = replace(QUICK, air=(SEED,) if seeded else ())
            known[name] = Home(make, fit(make(np.eye(4)), settings), seeded)
        return known[name]

    return home


def fitted_at(home: Home, matrix: np.ndarray) -> Fit:
    """The fit of the scene at a place, its seed there too."""
    seeds = (tuple((matrix @ [*SEED, 1.0])[:3].tolist()),) if home.seeded else ()
    return fit(home.make(matrix), replace(QUICK, air=seeds))


def brought_home(primitives: PrimitiveSet, matrix: np.ndarray) -> PrimitiveSet:
    """A set at a place as it would be where the scene was made; mirrored places too."""
    scale = np.abs(np.linalg.det(matrix[:3, :3])) ** (1 / 3)
    turned = world_primitives(primitives, Pose(matrix[:3, :3].T / scale, np.zeros(3)))
    origin = (turned.positions - matrix[:3, 3] @ matrix[:3, :3] / scale) / scale
    return replace(turned, positions=origin, sizes=primitives.sizes / scale)


def assert_same_errors(home: Home, away: Fit, matrix: np.ndarray, within: float, floor: float) -> None:
    """By the figures that the fit itself reports, and by measuring its set against the scene at home."""
    scale = np.abs(np.linalg.det(matrix[:3, :3])) ** (1 / 3)
    there = brought_home(away.primitives, matrix)
    again = measure(there, home.fit.surface, home.fit.air)
    assert_close(away.metrics, home.fit.metrics, scale, within, floor, 1e-4)
    # Measured in the world's axes, whatever the move was: all points and rays are drawn anew there.
    assert_close(again, home.fit.metrics, 1.0, WITHIN_TURNED, FLOOR_TURNED, RAY_NOISE)


def assert_close(
    got: Metrics, expected: Metrics, unit: float, within: float, floor: float, noise: float
) -> None:
    for name in ERRORS:
        before, after = getattr(expected, name), getattr(got, name) / unit
        assert abs(after - before) <= max(within * before, floor * expected.diag_m), name
    for name in ("leaks", "blocked", "false_solid"):
        assert getattr(got, name) == pytest.approx(
            getattr(expected, name), abs=max(noise, within * getattr(expected, name))
        ), name


BASES = ("furnished_room", "table", "lumpy_ball")


def test_a_far_turned_mirrored_and_large_room_gives_the_same_errors(
    homes: Callable[[str], Home], meshes: ModuleType
) -> None:
    matrix = meshes.PLACES["all at once"]
    home = homes("furnished_room")
    assert_same_errors(home, fitted_at(home, matrix), matrix, WITHIN, FLOOR)


@pytest.mark.slow
@pytest.mark.parametrize("base", BASES)
def test_every_place_gives_the_same_errors(
    place: str, base: str, homes: Callable[[str], Home], meshes: ModuleType
) -> None:
    matrix = meshes.PLACES[place]
    home = homes(base)
    assert_same_errors(home, fitted_at(home, matrix), matrix, WITHIN, FLOOR)


@pytest.mark.slow
@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("seed", range(4))
def test_every_rotation_gives_the_same_errors(
    seed: int, base: str, homes: Callable[[str], Home], meshes: ModuleType
) -> None:
    matrix = meshes.any_rotation(np.random.default_rng(seed))
    home = homes(base)
    assert_same_errors(home, fitted_at(home, matrix), matrix, WITHIN_TURNED, FLOOR_TURNED)


def test_canonical_coordinates_are_the_same_bits_wherever_a_scene_stands(
    place: str, meshes: ModuleType
) -> None:
    """All but a rounding in a thousand, of one step: whatever is computed from them is the same, too."""
    matrix = meshes.PLACES[place]
    for make in (
        meshes.furnished_room,
        meshes.one_triangle,
        meshes.flat,
        meshes.coplanar_sheets,
        meshes.needle_rod,
    ):
        mesh = make()
        home, away = (to_canonical(meshes.scene_of(mesh, at))[2].vertices for at in (np.eye(4), matrix))
        np.testing.assert_allclose(away, home, rtol=0, atol=1.5 * STEP)
        assert np.mean(away != home) < 1e-3


def test_a_scene_agrees_with_its_canonical_surface(place: str, meshes: ModuleType) -> None:
    """Corners in the same order too, fronts of mirrored ones in front: colours are looked up by both."""
    _, scene, surface = to_canonical(meshes.scene_of(meshes.furnished_room(), meshes.PLACES[place]))
    placed = from_scene(scene)
    np.testing.assert_allclose(placed.vertices, surface.vertices, atol=1.5 * STEP)
    np.testing.assert_allclose(placed.normals, surface.normals, atol=1e-4)


def test_air_is_asked_in_the_world(meshes: ModuleType) -> None:
    """The air of a scaled, turned, mirrored room answers like that of the room at home."""
    matrix = meshes.moved_by((7, -5, 3)) @ meshes.turned_by((3, -1, 2), 2.1) @ meshes.MIRROR
    matrix = matrix @ meshes.scaled_by(3.0)
    at_home, away = (
        find_scene_air(meshes.scene_of(meshes.furnished_room(), at), replace(QUICK, air=(tuple(seed),)))
        for at, seed in ((np.eye(4), SEED), (matrix, (matrix @ [*SEED, 1.0])[:3]))
    )
    points = np.random.default_rng(0).uniform((-2.9, -1.5, -2.4), (2.9, 1.5, 2.4), (500, 3))
    there = points @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_array_equal(away.labels_at(there), at_home.labels_at(points))
    np.testing.assert_allclose(away.tree.nearest(there)[0], 3 * at_home.tree.nearest(points)[0], atol=1e-6)
    down, down_there = np.tile([0.0, -1, 0], (500, 1)), np.tile(matrix[:3, :3] @ [0, -1, 0] / 3, (500, 1))
    hits, hits_there = at_home.rays.first_hit(points, down), away.rays.first_hit(there, down_there)
    assert np.mean(hits[1] == hits_there[1]) > 0.99
    same = np.isfinite(hits[0]) & (hits[1] == hits_there[1])
    np.testing.assert_allclose(hits_there[0][same], 3 * hits[0][same], atol=1e-5)
    assert away.cell == pytest.approx(3 * at_home.cell)
    assert away.spaces[0].volume == pytest.approx(27 * at_home.spaces[0].volume)
    np.testing.assert_allclose(
        away.spaces[0].point, matrix[:3, :3] @ at_home.spaces[0].point + matrix[:3, 3], atol=1e-5
    )
    assert away.is_air(away.random_points(300, 1)).all()
    assert away.walls.areas.sum() == pytest.approx(9 * at_home.walls.areas.sum())


def test_lost_seeds_are_named_in_the_world(meshes: ModuleType) -> None:
    matrix = meshes.moved_by((70, -5, 3)) @ meshes.turned_by((3, -1, 2), 2.1)
    in_the_wall = (matrix @ [2.5, 0.0, 0.0, 1.0])[:3]
    scene = meshes.scene_of(meshes.furnished_room(), matrix)
    with pytest.raises(LostSeed, match=f"air {in_the_wall[0]:g},") as lost:
        find_scene_air(scene, replace(QUICK, air=(tuple(in_the_wall.tolist()),)))
    assert np.linalg.norm(np.array(lost.value.nearest) - in_the_wall) < 0.3


def test_a_mirrored_file_stands_like_the_file(meshes: ModuleType) -> None:
    """Mirrored vertices with turned faces, as programs write them, not a mirrored node."""
    vertices, triangles = meshes.furnished_room()
    mirrored = (vertices * [-1, 1, 1], triangles[:, ::-1])
    home, away = (to_canonical(meshes.scene_of(mesh))[2] for mesh in ((vertices, triangles), mirrored))
    np.testing.assert_allclose(np.sort(away.vertices, axis=1), np.sort(home.vertices, axis=1), atol=1e-9)
    np.testing.assert_allclose(away.normals, home.normals, atol=1e-9)


def test_axes_follow_the_faces_of_noisy_rooms(meshes: ModuleType) -> None:
    """Noise on every vertex turns the axes by less than half a degree."""
    room = meshes.finer(meshes.box((5.0, 2.5, 4.0)), 0.6)
    turn = meshes.turned_by((1, 2, 3), 0.7)
    noisy = meshes.noise(0.001)(*room, np.random.default_rng(0))
    axes = find_pose(from_scene(meshes.scene_of(noisy, turn))).axes
    aligned = np.abs(turn[:3, :3].T @ axes).max(axis=0)
    assert aligned.min() > np.cos(np.radians(0.5))


def test_moved_scenes_keep_their_cameras(meshes: ModuleType) -> None:
    scene = meshes.scene_of(meshes.table(), cameras=[(1, 2, 3)])
    pose = Pose(np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), np.array([1.0, 1, 1]))
    (camera,) = moved_scene(scene, pose).cameras
    assert isinstance(camera, Camera)
    np.testing.assert_allclose(camera.world_from_local[:3, 3], (1, 2, 0))
    np.testing.assert_allclose(pose.outwards(camera.world_from_local[:3, 3]), (1, 2, 3))
