"""Backdrops: what is a picture of the sky, and what a wall."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fit.air import find_air
from fit.backdrop import backdrop_notes, find_backdrops
from fit.measure import place_probes
from fit.scene import Instance, Material, Mesh, Node, Scene
from fit.surface import from_scene

HOUSE = trimesh.creation.box((4.0, 3.0, 4.0))
DOME = trimesh.creation.icosphere(2, 40.0)


def scene_of(*parts: tuple[trimesh.Trimesh, bool]) -> Scene:
    """A scene of meshes, each unlit or not."""
    meshes = tuple(
        Mesh(str(i), mesh.vertices, mesh.vertex_normals, mesh.faces.astype(np.uint32), int(unlit))
        for i, (mesh, unlit) in enumerate(parts)
    )
    numbers = range(len(meshes))
    return Scene(
        source=Path("scene.gltf"),
        nodes=tuple(Node(f"node {i}", -1, np.eye(4), np.eye(4)) for i in numbers),
        instances=tuple(Instance(i, i, np.eye(4)) for i in numbers),
        meshes=meshes,
        materials=(Material(double_sided=True), Material(unlit=True, double_sided=True)),
    )


def moved(mesh: trimesh.Trimesh, by: tuple[float, float, float]) -> trimesh.Trimesh:
    copy = mesh.copy()
    copy.apply_translation(by)
    return copy


@pytest.mark.parametrize(
    ("parts", "backdrops"),
    [
        ([(HOUSE, False), (DOME, True)], (1,)),
        ([(HOUSE, True), (DOME, True)], (1,)),
        ([(HOUSE, False), (DOME, False)], ()),
        ([(HOUSE, False), (trimesh.creation.icosphere(2, 9.0), True)], ()),
        ([(HOUSE, False), (moved(DOME, (60.0, 0, 0)), True)], ()),
        ([(HOUSE, False), (trimesh.creation.box((40.0, 0.1, 40.0)), True)], ()),
        ([(DOME, True)], ()),
        ([(DOME, True), (HOUSE, False), (trimesh.creation.icosphere(2, 400.0), True)], (2, 0)),
    ],
    ids=["a dome", "all unlit", "a lit dome", "too near", "aside", "a plate below", "nothing within", "two"],
)
def test_unlit_meshes_that_surround_the_rest_from_afar_are_backdrops(parts, backdrops):
    assert find_backdrops(scene_of(*parts)) == backdrops


def test_a_backdrop_is_no_wall_and_sets_no_size():
    scene = scene_of((HOUSE, False), (DOME, True))
    surface = from_scene(scene)
    assert surface.walls().diagonal == pytest.approx(np.sqrt(41.0))
    air = find_air(surface, scene, resolution=60)
    assert air.cell == pytest.approx(np.sqrt(41.0) / 60)
    probes = place_probes(surface, air)
    assert probes.diagonal == pytest.approx(np.sqrt(41.0))
    assert np.abs(probes.surface).max() < 2.1


def test_the_report_says_what_was_left_out():
    (note,) = backdrop_notes(scene_of((HOUSE, False), (DOME, True)))
    assert "'node 1'" in note and "sky" in note
    assert backdrop_notes(scene_of((HOUSE, False))) == ()


def test_a_backdrop_without_a_node_is_called_by_its_mesh():
    scene = scene_of((HOUSE, False), (DOME, True))
    placed = tuple(replace(instance, node=-1) for instance in scene.instances)
    (note,) = backdrop_notes(replace(scene, instances=placed, nodes=()))
    assert note.startswith("'1' is unlit")
