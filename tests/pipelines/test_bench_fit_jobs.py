"""What the processes of `bench fit` compute: the same points for every set, and sets of what is allowed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from fit.air import find_air
from fit.objective import error, penalties
from fit.primitives import Kind
from fit.recognize import Piece
from fit.shapes import (
    KINDS,
    Shapes,
    distances_to_one,
    make_shapes,
    no_shapes,
    rotation_matrices,
    to_primitives,
)
from fit.solve import STEPS
from fit.surface import from_triangles
from fit.targets import make_targets, see_surface
from pipelines import bench_fit_jobs, bench_fit_peers
from pipelines.bench_fit_jobs import Trial, fit_once, from_primitives, prepare, relative_error, run_peer


def quiet(stage: str, fraction: float) -> None:
    """A progress that nobody watches."""


@pytest.fixture(scope="module")
def store(wall: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The smallest scene, made ready."""
    path = tmp_path_factory.mktemp("bench") / "wall.pickle"
    facts = prepare(wall, 1.0, (), 0, path, quiet)
    assert facts["triangles"] == 24
    assert facts["cpu_seconds"] > 0
    return path


@pytest.fixture(scope="module")
def whole(store: Path) -> dict[str, Any]:
    """The wall's set with nothing left out."""
    return fit_once(store, Trial(8, KINDS, STEPS), 0, quiet)


def test_a_trial_is_judged_and_timed(whole: dict[str, Any]) -> None:
    assert 0 < whole["primitives"] <= 8
    assert whole["primitives"] == sum(whole["kinds"].values())
    assert whole["error"] < 0.02
    assert whole["metrics"]["leaks"] < 0.01
    assert sum(kind["surface_share"] for kind in whole["by_kind"].values()) == pytest.approx(1)
    assert whole["cpu_seconds"] >= sum(whole["stages"].values()) > 0


def test_what_is_left_out_is_not_in_the_set(store: Path, whole: dict[str, Any]) -> None:
    used = max(KINDS, key=lambda kind: whole["kinds"][kind])
    others = tuple(kind for kind in KINDS if kind != used)
    assert fit_once(store, Trial(1, others, STEPS), 0, quiet)["kinds"][used] == 0


def test_no_set_has_all_the_error_there_is(store: Path) -> None:
    prepared = bench_fit_jobs._read(store)
    nothing = to_primitives(bench_fit_peers.join([]))
    assert relative_error(nothing, prepared.targets) == 1
    assert prepared.air.rays.first_hit(np.array([[0.0, 50, 0]]), np.array([[0.0, -1, 0]]))[1][0] >= 0


def test_a_wall_a_third_of_a_cell_off_has_the_fits_own_error() -> None:
    """Rays meet it within their ways behind the front: by distances at points alone, they would leak."""
    size = np.array([4.0, 2.0, 0.2])
    air = find_air(from_triangles(np.asarray(trimesh.creation.box(size).triangles)), resolution=60)
    seen = see_surface(air, 2000, 0)
    targets = make_targets(seen, air, seen.weights, 2000, 0)
    off = make_shapes(Kind.BOX, np.array([[0, 0, 0.3 * air.cell]]), np.eye(3), size / 2)
    nothing = error(no_shapes(), targets)
    found = relative_error(to_primitives(off), targets)
    assert found == pytest.approx(error(off, targets) / nothing)
    at_points = np.minimum(distances_to_one(off, 0, targets.points), targets.reach)
    assert found < 0.8 * penalties(targets, at_points).sum() / nothing


def test_every_kind_is_judged_as_the_solid_that_it_is() -> None:
    rng = np.random.default_rng(3)
    frames = rotation_matrices(rng.normal(size=(4, 3)))
    halves = np.array([(1, 2, 3), (2, 2, 2), (1, 2, 1), (2, 1e-4, 3)])
    kinds = np.array([Kind.BOX, Kind.SPHERE, Kind.CYLINDER, Kind.BOX], np.uint8)
    shapes = Shapes(kinds, rng.normal(size=(4, 3)), frames, halves, np.zeros(4, bool))
    primitives = to_primitives(shapes)
    assert primitives.kinds[3] == Kind.PLANE
    back = from_primitives(primitives)
    points = rng.normal(size=(50, 3)) * 3
    for which in range(4):
        np.testing.assert_allclose(
            distances_to_one(back, which, points), distances_to_one(shapes, which, points), atol=1e-9
        )


def test_a_peer_is_judged_at_the_same_points(
    store: Path, whole: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def one_hull(peer: str, walls: Any, count: int, seed: int) -> list[Piece]:
        return [hull_of(trimesh.convex.convex_hull(walls.vertices.reshape(-1, 3)))]

    monkeypatch.setattr(bench_fit_jobs, "hulls", one_hull)
    rows = run_peer(store, "vhacd", 1, 0, quiet)
    assert set(rows) == {"boxes", "best primitives"}
    assert rows["boxes"]["primitives"] == 1
    assert rows["boxes"]["metrics"]["diag_m"] == whole["metrics"]["diag_m"]
    assert rows["boxes"]["error"] >= whole["error"]


def hull_of(mesh: Any) -> Piece:
    surface = from_triangles(np.asarray(mesh.triangles))
    return Piece(surface.vertices, surface.normals, surface.areas)


TURN = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [0, 0, 0])


@pytest.mark.parametrize(
    ("mesh", "kind", "halves"),
    [
        (trimesh.creation.box((1, 2, 3), TURN), Kind.BOX, (0.5, 1, 1.5)),
        (trimesh.creation.icosphere(subdivisions=3, radius=2), Kind.SPHERE, (2, 2, 2)),
        (trimesh.creation.cylinder(1, 4, transform=TURN), Kind.CYLINDER, (1, 1, 2)),
    ],
)
def test_a_hull_becomes_the_primitive_that_it_is(mesh: Any, kind: Kind, halves: tuple[float, ...]) -> None:
    found = bench_fit_peers.best_primitive(hull_of(mesh))
    assert Kind(found.kinds[0]) is kind
    assert np.sort(found.halves[0]) == pytest.approx(halves, rel=0.01)
    box = bench_fit_peers.smallest_box(hull_of(mesh))
    assert Kind(box.kinds[0]) is Kind.BOX


@pytest.mark.parametrize("peer", sorted(bench_fit_peers.PACKAGES))
def test_a_peer_cuts_two_boxes_apart(peer: bench_fit_peers.Peer) -> None:
    pytest.importorskip(bench_fit_peers.PACKAGES[peer], reason="pip install 'sdfprim[peers]'")
    boxes = [trimesh.creation.box((1, 1, 1)), trimesh.creation.box((1, 1, 1)).apply_translation([3, 0, 0])]
    walls = from_triangles(np.concatenate([np.asarray(box.triangles) for box in boxes]))
    pieces = bench_fit_peers.hulls(peer, walls, 8, 0)
    assert len(pieces) == 2, "a box is one hull however many are allowed"
    shapes = bench_fit_peers.to_shapes(pieces, "boxes")
    assert np.sort(shapes.centers[:, 0]) == pytest.approx([0, 3], abs=0.05)
    assert shapes.volumes() == pytest.approx(1, rel=0.1)


@pytest.mark.slow
def test_the_whole_command_on_a_scene(sdfprim: Any, wall: Path, tmp_path: Path) -> None:
    ran = sdfprim("bench", "fit", wall, "-o", tmp_path, "--budgets", "2,8", "--json")
    assert ran.code == 0, ran.err
    runs = ran.report["scenes"][0]["runs"]
    assert all(run["status"] == "ok" for run in runs)
    small, large = (run for run in runs if run["series"] == "budget")
    assert large["error"] < small["error"]
    assert ran.report["scenes"][0]["summary"]["monotony"]["holds"]
